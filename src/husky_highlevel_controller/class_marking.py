"""Marks a folder of packages: builds each in a workspace of its own, goes on where it was interrupted.

In: a folder, and how to mark one. Out: results, a CSV table and an HTML page.
Must not know: how one is judged.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Dict, List, Optional, Protocol, Sequence, Tuple

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException
from tqdm import tqdm

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.marking import Submission
from husky_highlevel_controller.network import MarkingError
from husky_highlevel_controller.processes import STOP, Process, end_all, wait
from husky_highlevel_controller.report import Result, from_json, to_csv, to_html, to_junit

BUILD_DEADLINE = 600.0  # [s] of wall time
SETUP_DEADLINE = 60.0  # [s] of wall time
NOT_COPIED = shutil.ignore_patterns(".git", "build", "devel", "install", "__pycache__", "*.bag")
PICTURES = ("drive.png", "rviz.png")


class Marker(Protocol):
    """Marks one submission."""

    @property
    def settings(self) -> Dict[str, object]:
        """What is the same for everybody."""

    def mark(self, submission: Submission, name: str, out: Path, notes: Sequence[str] = ()) -> Result:
        """Mark it and write everything about it into a folder."""


@dataclass(frozen=True)
class Package:
    """One package in the folder."""

    name: str  # of its results: its place in the folder
    path: Path
    package: str  # its own name


def find_packages(folder: Path) -> List[Package]:
    """Every catkin package, in order; what is inside of one belongs to it."""
    found: List[Package] = []
    manifests = sorted(folder.rglob("package.xml"), key=lambda path: (len(path.parts), path))
    for manifest in manifests:
        path = manifest.parent
        inside = any(package.path in path.parents for package in found)
        if inside or any((parent / "CATKIN_IGNORE").exists() for parent in (path, *path.parents)):
            continue
        try:
            package = str(ElementTree.parse(manifest).getroot().findtext("name", "")).strip()
        except (ElementTree.ParseError, DefusedXmlException, OSError):
            package = ""
        place = path.relative_to(folder).as_posix()
        found.append(Package(place if place != "." else path.name, path, package))
    return sorted(found, key=lambda package: package.name)


def fingerprint(path: Path) -> str:
    """Changes whenever a file of the package does."""
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        if file.is_file() and not file.is_symlink():
            status = file.stat()
            digest.update(f"{file.relative_to(path)} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def find_entry(package: Package, pattern: str) -> Optional[str]:
    """The launch file to start: the only one, else the first that fits the pattern; None if neither."""
    names = sorted({file.name for file in package.path.rglob("*.launch")})
    fitting = [name for name in names if fnmatch(name, pattern)]
    return (fitting or names)[0] if len(names) == 1 or fitting else None


# ---------------------------------------------------------------------------- a workspace each


def sourced(setup: Path) -> Dict[str, str]:
    """The environment after a setup.bash.

    Raises:
        MarkingError: it cannot be sourced.
    """
    command = ["bash", "-c", 'source "$0" >/dev/null && env -0', str(setup)]
    try:
        answer = subprocess.run(
            command, capture_output=True, stdin=subprocess.DEVNULL, timeout=SETUP_DEADLINE, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise MarkingError(f"{setup}: does not end") from error
    if answer.returncode:
        raise MarkingError(f"{setup}: {answer.stderr.decode(errors='replace').strip()[-300:]}")
    pairs = (word.partition("=") for word in answer.stdout.decode(errors="replace").split("\0") if word)
    return {name: value for name, _, value in pairs}


def build(package: Package, workspace: Path) -> Tuple[Dict[str, str], List[str]]:
    """Copy a package into a workspace and build it; the environment to run it in, and what went wrong."""
    source = workspace / "src" / (package.package or package.path.name)
    shutil.copytree(package.path, source, symlinks=True, ignore=NOT_COPIED)
    mark = f"http://127.0.0.1:1{workspace}"  # finds the compilers if they have to be ended
    env = {**os.environ, "ROS_MASTER_URI": mark}
    command = [
        "catkin_make",
        "-C",
        str(workspace),
        f"-DPYTHON_EXECUTABLE={sys.executable}",
        "-DCATKIN_ENABLE_TESTING=0",
    ]
    process = Process(command, workspace / "build.log", env, workspace, stranger=True)
    try:
        in_time = wait(lambda: not process.running, BUILD_DEADLINE, 0.2)
    finally:
        end_all([process], "ROS_MASTER_URI", mark)
    notes = []
    if not in_time:
        notes.append(f"it does not build within {BUILD_DEADLINE:g} s")
    elif process.popen.returncode:
        notes.append(f"it does not build: {build_error(process.output)}")
    setup = workspace / "devel" / "setup.bash"
    try:
        env = sourced(setup) if setup.is_file() else dict(os.environ)
    except MarkingError:
        env = dict(os.environ)
    # without a build, what needs none is still found
    paths = [str(workspace / "src"), *env.get("ROS_PACKAGE_PATH", "").split(os.pathsep)]
    env["ROS_PACKAGE_PATH"] = os.pathsep.join(dict.fromkeys(path for path in paths if path))
    return env, notes


def build_error(output: str) -> str:
    """The line of a build's output that says most."""
    lines = [line.strip() for line in output.splitlines()]
    missing = re.search(r'Could not find a package configuration file provided by\s+"([^"]+)"', output)
    if missing:
        return f"package '{missing.group(1)}' is missing"
    for pattern in (r"\berror:", r"^CMake Error", r"\bError\b|error"):
        for number, line in enumerate(lines):
            if re.search(pattern, line):
                return " ".join(lines[number : number + 2])[:300]
    return " ".join(lines[-2:])[:300]


# ---------------------------------------------------------------------------- everybody


def mark_all(marker: Marker, folder: Path, out: Path, jobs: int, entry: str) -> List[Optional[Result]]:
    """Mark every package; None for those that could not be marked.

    Args:
        marker: how to mark one.
        folder: of the packages.
        out: folder of the results: one folder each, results.csv, junit.xml and index.html.
        jobs: submissions at a time.
        entry: which launch file to start, where there are several.
    """
    packages = find_packages(folder)
    if not packages:
        raise HuskyError(f"no package.xml in {folder}")
    out.mkdir(parents=True, exist_ok=True)
    results: Dict[str, Optional[Result]] = {}
    with ThreadPoolExecutor(jobs) as pool, tqdm(total=len(packages), unit="submission") as bar:
        waiting: Dict[Future, Package] = {}
        for package in packages:
            done = _earlier(marker, package, out / package.name)
            if done is not None:
                results[package.name] = done
                bar.update()
            else:
                waiting[pool.submit(_mark_one, marker, package, out / package.name, entry)] = package
        for future in as_completed(waiting):
            package = waiting[future]
            try:
                results[package.name] = future.result()
            except (HuskyError, OSError) as error:
                results[package.name] = None
                if not STOP.is_set():
                    bar.write(f"{package.name}: {error}", file=sys.stderr)
            bar.update()
    if STOP.is_set():
        raise HuskyError("stopped; the same command goes on from here")
    ordered = [results[package.name] for package in packages]
    _write_summary([result for result in ordered if result is not None], out)
    for package, result in zip(packages, ordered):
        print(
            f"{package.name:<40}"
            + (f"{result.points:g}/{result.most:g}" if result else "could not be marked")
        )
    print(f"\ntable: {out / 'results.csv'}\npage:  {out / 'index.html'}")
    return ordered


def _earlier(marker: Marker, package: Package, out: Path) -> Optional[Result]:
    """The result of an earlier marking of the same package by the same rules."""
    try:
        result = from_json((out / "result.json").read_text())
        same = (out / "fingerprint").read_text() == fingerprint(package.path)
    except (OSError, HuskyError):
        return None
    return result if same and result.settings == marker.settings else None


def _mark_one(marker: Marker, package: Package, out: Path, entry: str) -> Result:
    if STOP.is_set():
        raise HuskyError("stopped")
    for name in ("result.json", "fingerprint"):
        (out / name).unlink(missing_ok=True)
    workspace = out / "ws"
    shutil.rmtree(workspace, ignore_errors=True)
    (workspace / "src").mkdir(parents=True)
    (workspace / "src" / ".catkin_workspace").touch()
    mark = fingerprint(package.path)
    notes: List[str] = []
    launch = find_entry(package, entry)
    if not package.package:
        notes.append("its package.xml has no name")
    if launch is None:
        names = ", ".join(sorted({file.name for file in package.path.rglob("*.launch")})) or "none"
        notes.append(f"no launch file fits '{entry}': there is {names}")
    env, problems = build(package, workspace)
    what = ("--launch", package.package or package.name, launch or entry)
    result = marker.mark(Submission(what, env), package.name, out, [*notes, *problems])
    (out / "fingerprint").write_text(mark)
    return result


def _write_summary(results: Sequence[Result], out: Path) -> None:
    images: Dict[str, Sequence[bytes]] = {
        result.name: [(out / result.name / name).read_bytes() for name in PICTURES
                      if (out / result.name / name).is_file()]
        for result in results
    }  # fmt: skip
    (out / "results.csv").write_text(to_csv(results))
    (out / "junit.xml").write_text(to_junit(results))
    (out / "index.html").write_text(to_html(results, images))
