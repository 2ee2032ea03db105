"""Unpacks zip and tar archives of hand-ins: nothing outside the folder, no links, no devices, bounded size.

In: an archive and an empty folder. Out: files in the folder. Must not know: what the files are.
"""

from __future__ import annotations

import shutil
import stat
import tarfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Iterator, Optional, Tuple

from husky_highlevel_controller.datatypes import HuskyError

SUFFIXES = (".zip", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz", ".tar")
MAX_FILES, MAX_BYTES = 20_000, 500_000_000  # of all archives of one hand-in, unpacked
CHUNK = 1 << 16  # [bytes]
_Member = Tuple[str, bool, bool, Optional[IO[bytes]]]  # name, executable, to be left out, content


class ArchiveError(HuskyError):
    """An archive that is broken, encrypted, too large, or that leads out of its folder."""


@dataclass
class Allowance:
    """How much may still be unpacked."""

    files: int = MAX_FILES
    size: int = MAX_BYTES  # [bytes]


def suffix_of(name: str) -> str:
    """The ending that makes a file an archive; empty: it is none."""
    return next((suffix for suffix in SUFFIXES if name.lower().endswith(suffix)), "")


def unpack(archive: Path, folder: Path, allowance: Allowance) -> int:
    """Unpack an archive into a folder.

    Args:
        archive: a regular file.
        folder: an existing, empty folder.
        allowance: what may be unpacked; it is used up.

    Returns:
        How many links and special files were left out.

    Raises:
        ArchiveError: see there; the folder may then hold a part of it.
    """
    left_out = 0
    members = _zip_members if suffix_of(archive.name) == ".zip" else _tar_members
    try:
        for name, executable, special, content in members(archive):
            left_out += special
            if content is not None:
                with content:
                    target = folder / _inside(name, archive)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    _copy(content, target, allowance, archive)
                    if executable:
                        target.chmod(0o755)
    except (zipfile.BadZipFile, tarfile.TarError, EOFError, zlib.error, NotImplementedError) as error:
        raise ArchiveError(f"{archive.name} is broken: {error}") from error
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: a password is needed
        raise ArchiveError(f"{archive.name} cannot be unpacked: {error}") from error
    return left_out


def _inside(name: str, archive: Path) -> PurePosixPath:
    """A member's name as a path below the folder."""
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or "\0" in name or not path.parts or ":" in path.parts[0]:
        raise ArchiveError(f"{archive.name} leads out of its folder: {name[:200]!r}")
    return path


def _copy(content: IO[bytes], target: Path, allowance: Allowance, archive: Path) -> None:
    allowance.files -= 1
    with target.open("xb") as file:
        while True:
            chunk = content.read(CHUNK)
            allowance.size -= len(chunk)
            if allowance.files < 0 or allowance.size < 0:
                raise ArchiveError(
                    f"{archive.name} is too large: more than {MAX_FILES} files or {MAX_BYTES} bytes, unpacked"
                )
            if not chunk:
                return
            file.write(chunk)


def _zip_members(archive: Path) -> Iterator[_Member]:
    with zipfile.ZipFile(archive) as opened:
        seen = set()
        for info in opened.infolist():
            mode = info.external_attr >> 16
            special = stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR)
            wanted = not special and not info.is_dir() and info.filename not in seen
            seen.add(info.filename)
            content = opened.open(info) if wanted else None
            yield info.filename, bool(mode & 0o100), special, content


def _tar_members(archive: Path) -> Iterator[_Member]:
    with tarfile.open(archive) as opened:
        seen = set()
        for info in opened:
            wanted = info.isfile() and info.name not in seen
            seen.add(info.name)
            content = opened.extractfile(info) if wanted else None
            yield info.name, bool(info.mode & 0o100), not (info.isfile() or info.isdir()), content


def free_space_error(folder: Path, needed: int) -> str:
    """A sentence if the file system of a folder has less than `needed` bytes left; else empty."""
    left = shutil.disk_usage(folder).free
    return "" if left >= needed else f"only {left / 1e6:.0f} MB are free in {folder}"
