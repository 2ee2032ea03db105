"""Fingerprints: of values, of this package's code, and of the machine that computes.

In: plain values, records, arrays, functions. Out: SHA-256 in hexadecimal digits; a machine's name.
"""

from __future__ import annotations

import hashlib
import inspect
import platform
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache, partial
from importlib import metadata
from pathlib import Path, PurePath
from typing import Any, Iterator, Mapping

import numpy as np

from husky_highlevel_controller.paths import share_folder

# packages of this project, whose code may change a result
OURS = (
    "husky_evaluation",
    "husky_grading",
    "husky_highlevel_controller",
)
GENERATED = ("msg", "srv", "cfg")  # folders of generated code that catkin adds to an installed package


def fingerprint(value: Any) -> str:
    """Return the SHA-256 of the content of a value, which is the same for equal values in every process.

    Raises:
        TypeError: a part of the value has a type without a fingerprint.
    """
    digest = hashlib.sha256()
    for piece in _pieces(value):
        # the length shows where a piece ends; otherwise "ab", "c" and "a", "bc" would give the same hash
        digest.update(b"%d:" % len(piece) + piece)
    return digest.hexdigest()


def _pieces(value: Any) -> Iterator[bytes]:
    """Yield bytes that describe a value: its type and content, and for a container the pieces of its parts.

    A set or a mapping has no order, so the fingerprints of its parts are sorted.

    Raises:
        TypeError: a part has a type without a fingerprint.
    """
    if value is None or type(value) in (bool, int, float, str, bytes):
        yield f"{type(value).__name__} {value!r}".encode(errors="backslashreplace")
    elif isinstance(value, Enum):
        yield f"{type(value).__qualname__}.{value.name}".encode()
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, np.generic):
        # a number of numpy gets the same fingerprint as the equal number of Python
        yield from _pieces(value.item())
    elif isinstance(value, (tuple, list)):
        yield f"{len(value)} values".encode()  # the length shows where a nested list ends
        for part in value:
            yield from _pieces(part)
    elif isinstance(value, (set, frozenset)):
        yield from _pieces(sorted(map(fingerprint, value)))
    elif isinstance(value, Mapping):
        yield from _pieces(sorted((fingerprint(key), fingerprint(part)) for key, part in value.items()))
    elif isinstance(value, PurePath):
        yield f"path {value}".encode()
    elif is_dataclass(value) and not isinstance(value, type):  # true for a record, not for its class
        yield type(value).__qualname__.encode()
        for item in fields(value):
            yield from _pieces(getattr(value, item.name))
    elif isinstance(value, partial):
        yield from _pieces((value.func, value.args, value.keywords))
    elif inspect.isfunction(value) or isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}".encode()
        # the source text is added only for other packages, because code_version has the code of our packages
        if value.__module__.split(".")[0] not in OURS:
            yield inspect.getsource(value).encode()
    else:
        raise TypeError(f"a {type(value).__name__} has no fingerprint: {value!r}"[:200])


@lru_cache(maxsize=1)
def code_version() -> str:
    """Return the version of the package, and a hash of its Python code, parameters, worlds and robots.

    Only the same version uses kept results again, and a worker of a cluster must have the same version.
    """
    digest, share = hashlib.sha256(), share_folder()
    sources = Path(__file__).resolve().parents[2]  # folder that contains the packages
    modules = [path for package in OURS for path in (sources / package).rglob("*.py")]
    # path of each file; the key is a name that does not depend on the place of the installation
    files = {f"src/{path.relative_to(sources).as_posix()}": path for path in modules}
    for folder in ("config", "urdf", "worlds"):
        data = [path for path in (share / folder).rglob("*") if path.is_file()]
        files.update({path.relative_to(share).as_posix(): path for path in data})
    for name in sorted(files):
        # Generated code is left out; catkin adds it as src/PACKAGE/FOLDER/..., but only to an installed
        # package. No data file has a folder of such a name.
        _, _, *below_package = name.split("/")
        is_generated = bool(below_package) and below_package[0] in GENERATED
        if not is_generated:
            digest.update(f"{name} {hashlib.sha256(files[name].read_bytes()).hexdigest()}\n".encode())
    # the version by package.xml, and 12 digits of the hash, which are enough to distinguish versions
    manifest = (share / "package.xml").read_text()
    number = manifest.split("<version>", 1)[1].split("<", 1)[0]
    return f"{number}+{digest.hexdigest()[:12]}"


def processor() -> str:
    """Return the name of this machine's processor; empty if unknown."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # the system is not Linux
        lines = []
    for line in lines:
        key, colon, name = line.partition(": ")
        if key.startswith("model name") and colon:
            return name
    return platform.processor()


@lru_cache(maxsize=1)
def machine() -> str:
    """Return processor, Python and libraries; if these differ, the last bits of results may differ, too."""
    parts = [platform.machine(), processor(), f"Python {platform.python_version()}"]
    for library in ("numpy", "pybullet"):
        try:
            parts.append(f"{library} {metadata.version(library)}")
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(part for part in parts if part)
