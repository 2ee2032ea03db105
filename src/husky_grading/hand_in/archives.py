"""Unpacking of zip and tar archives: nothing outside the folder, no links, no devices, bounded size.

A separate program reads the archive, within limits of memory and time, because modules of Python's library
read headers whole, and a header may claim any size.
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import stat
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from husky_grading.isolation.files import walk
from husky_highlevel_controller.datatypes import HuskyError

PROGRAM = "husky_grading.hand_in.archives"

SUFFIXES = (".zip", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz", ".tar")
UNREAD = (".7z", ".rar", ".tar.zst")  # endings of archives that cannot be opened
# limits of a submission: number of its files, and size of all its files together [bytes]
MAX_FILES, MAX_BYTES = 20_000, 500_000_000
MAX_FILE = 100_000_000  # [bytes] largest file that is unpacked; a rosbag may be larger and is left out
MAX_NAMED = 5  # a note on files that are left out has at most this number of names
UTF_8 = 0x800  # bit in the flags of a file in a zip archive: the file's name is UTF-8, not code page 437
CHUNK = 1 << 16  # [bytes] files are copied in pieces of this size
OWNER_EXECUTES = 0o100  # bit in a file's mode: the owner may execute the file
MEMORY = 1_000_000_000  # [bytes] the program that unpacks an archive may use at most this memory
DEADLINE = 120  # [s] this program may use at most this CPU time, and at most this wall time


class _Member(NamedTuple):
    """Entry of an archive."""

    name: str
    is_executable: bool
    is_special: bool  # true for a link, a device or the like, which is left out
    content: Optional[IO[bytes]]  # content of a file; None for a folder, link or device


class ArchiveError(HuskyError):
    """An archive is broken, encrypted or too large, or leads out of its folder."""


@dataclass
class Allowance:
    """Numbers of files and bytes that may still be unpacked; all archives of a submission share them."""

    files: int = MAX_FILES
    size: int = MAX_BYTES  # [bytes]


def suffix_of(name: str) -> str:
    """Return the suffix that makes a file an archive; empty if it is not an archive."""
    for suffix in (*SUFFIXES, *UNREAD):
        if name.lower().endswith(suffix):
            return suffix
    return ""


def large_files_note(names: Sequence[str]) -> List[str]:
    """Return a sentence on files that are left out because of their size, if there are any."""
    if not names:
        return []
    shown = ", ".join(names[:MAX_NAMED])
    if len(names) > MAX_NAMED:
        shown += ", ..."
    size = f"{MAX_FILE / 1e6:g} MB, or {MAX_BYTES / 1e6:g} MB together"
    return [f"files larger than {size} are left out: {shown}"]


def unpack(archive: Path, folder: Path, allowance: Allowance) -> List[str]:
    """Unpack an archive into an existing, empty folder, and return notes on members that were left out.

    A separate program does this, see `main`. The allowance is reduced by the unpacked files.

    Raises:
        ArchiveError: the archive cannot be unpacked; the folder may then hold a part of it.
    """
    if suffix_of(archive.name) in UNREAD:
        raise ArchiveError(f"{archive.name} cannot be opened; hand in one of {', '.join(SUFFIXES)}")
    command = [sys.executable, "-m", PROGRAM, *map(str, (archive, folder, allowance.files, allowance.size))]
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
        links, large, allowance.files, allowance.size, error = json.loads(process.stdout)
    except subprocess.TimeoutExpired:
        error = f"{archive.name} cannot be unpacked within {DEADLINE} s"
    except (ValueError, TypeError):  # the program died without a result, normally by its limit of memory
        error = f"{archive.name} cannot be unpacked within {MEMORY / 1e9:g} GB of memory"
    if error:
        raise ArchiveError(error)
    notes = large_files_note(large)
    if links:  # `links` counts links, and special files such as devices
        notes.insert(0, f"links in {archive.name} are left out")
    return notes


def _unpack(archive: Path, folder: Path, allowance: Allowance) -> Tuple[int, List[str]]:
    """Unpack an archive in this program, and return the number of links and the names of too large files.

    Both are left out. The caller has limited the memory of this program.

    Raises:
        ArchiveError: the archive cannot be unpacked.
    """
    links = 0
    large: List[str] = []
    members = _zip_members if suffix_of(archive.name) == ".zip" else _tar_members
    try:
        for name, is_executable, is_special, content in members(archive):
            links += is_special
            # folders, links and special files have no content; a folder is made together with its first file
            if content is not None:
                with content:
                    target = folder / _safe_path(name, archive)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    # a name may come twice, because `tar -u` and `tar -r` append newer versions of a file;
                    # the last one counts
                    if target.is_file():
                        allowance.size += target.stat().st_size
                        target.unlink()
                    is_copied = _copy(content, target, allowance, archive)
                    if not is_copied:
                        large.append(name)
                    elif is_executable:
                        target.chmod(0o755)
    except (ArchiveError, MemoryError):
        # a MemoryError ends this program, and `unpack`, which waits for this program, then raises an error
        raise
    except (OSError, ValueError, RuntimeError) as error:
        # zipfile raises RuntimeError if the archive needs a password
        raise ArchiveError(f"{archive.name} cannot be unpacked: {error}") from error
    except Exception as error:
        # a broken archive may raise any error of zipfile, tarfile, zlib, lzma, bz2 and struct
        raise ArchiveError(f"{archive.name} is broken: {str(error) or type(error).__name__}") from error
    return links, large


def main(archive: str, folder: str, files: str, size: str) -> None:
    """Unpack an archive within limits of memory and CPU time, and print the outcome for `unpack`.

    `files` and `size` [bytes] are the numbers of files and bytes that may be unpacked. The outcome is a JSON
    list: the number of links, the names of files that are too large, the numbers of files and bytes that may
    still be unpacked, and an error, which is empty after success.
    """
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (DEADLINE, DEADLINE))
    allowance = Allowance(int(files), int(size))
    try:
        links, large = _unpack(Path(archive), Path(folder), allowance)
        problem = ""
    except ArchiveError as error:
        links, large, problem = 0, [], str(error)
    print(json.dumps([links, large, allowance.files, allowance.size, problem]))


def _safe_path(name: str, archive: Path) -> PurePosixPath:
    """Return a member's name as a path that stays below the folder of the archive.

    Raises:
        ArchiveError: the name leads out of the folder.
    """
    path = PurePosixPath(name.replace("\\", "/"))
    is_absolute = path.is_absolute() or (bool(path.parts) and path.parts[0][1:2] == ":")  # C: on Windows
    if is_absolute or ".." in path.parts or "\0" in name or not path.parts:
        raise ArchiveError(f"{archive.name} leads out of its folder: {name[:200]!r}")
    return path


def _copy(content: IO[bytes], target: Path, allowance: Allowance, archive: Path) -> bool:
    """Write a member of an archive to `target`, and return True; return False if it exceeds MAX_FILE.

    The header of an archive may give a wrong size, so the bytes are counted while they are read.

    Raises:
        ArchiveError: the allowance is used up.
    """
    # a file that is left out because of its size counts as a file, but its bytes are not counted
    allowance.files -= 1
    size = 0  # [bytes] size of the part that was read so far
    with target.open("xb") as file:
        for chunk in iter(partial(content.read, CHUNK), b""):  # b"" is the end of the content
            size += len(chunk)
            if size > MAX_FILE:
                target.unlink()
                return False
            if size > allowance.size:
                break  # below, `allowance.size` becomes negative, and the error is raised
            file.write(chunk)
    allowance.size -= size
    if allowance.files < 0 or allowance.size < 0:
        raise ArchiveError(
            f"{archive.name} is too large: unpacked it has more than {MAX_FILES} files or {MAX_BYTES} bytes"
        )
    return True


def _zip_members(archive: Path) -> Iterator[_Member]:
    """Yield the members of a zip archive."""
    with zipfile.ZipFile(archive) as opened:
        for info in opened.infolist():
            mode = info.external_attr >> 16  # mode of the file on Unix; 0 if the archive was made on Windows
            is_special = stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR)
            name = _zip_name(info)
            content = None if is_special or name.endswith("/") else opened.open(info)
            yield _Member(name, bool(mode & OWNER_EXECUTES), is_special, content)


def _zip_name(info: zipfile.ZipInfo) -> str:
    """Return the name of a member, with a slash after each folder.

    Info-ZIP and macOS write UTF-8 without the flag UTF_8, so zipfile decodes these names as code page 437.
    """
    name = info.filename
    if not info.flag_bits & UTF_8:
        with contextlib.suppress(UnicodeError):
            name = name.encode("cp437").decode("utf-8")
    return name.replace("\\", "/")


def _tar_members(archive: Path) -> Iterator[_Member]:
    """Yield the members of a tar archive."""
    with tarfile.open(archive) as opened:
        for info in opened:
            content = opened.extractfile(info) if info.isfile() else None
            is_special = not (info.isfile() or info.isdir())
            yield _Member(info.name, bool(info.mode & OWNER_EXECUTES), is_special, content)


class PackedPath:
    """File or folder of a submission; its content is read only when it is sent to a worker.

    So the submissions of a class need not fit into memory together. Links and large files, which marking
    leaves out, are not sent.
    """

    def __init__(self, path: Path) -> None:
        self.path: Optional[Path] = path  # path on this machine; None after it was sent to another one
        self._content = b""  # tar archive of the files; empty before it is sent

    def __getstate__(self) -> Dict[str, Any]:
        """Return the state to send: a tar archive of the files, with their permissions, instead of the path.

        Pickle calls this function when the object is sent, so the files are read only then.
        """
        if self.path is None:  # the object was sent before, so its files are packed
            return {"path": None, "_content": self._content}
        path, content = self.path, io.BytesIO()
        room = MAX_BYTES  # [bytes] total size of the files that may still be packed
        with tarfile.open(fileobj=content, mode="w:gz", compresslevel=1) as archive:
            # the delivered file, or the delivered folder without its content, which follows
            archive.add(path, path.name, recursive=False)
            for file in walk(path) if path.is_dir() else ():
                size = file.stat().st_size
                if size <= min(MAX_FILE, room):
                    room -= size
                    archive.add(file, Path(path.name, file.relative_to(path)), recursive=False)
        return {"path": None, "_content": content.getvalue()}

    def unpack(self, folder: Path) -> Path:
        """Unpack the files into an empty folder, with the same permissions, and return their path."""
        with tarfile.open(fileobj=io.BytesIO(self._content)) as archive:
            names = archive.getnames()
            # other filters would change permissions; this archive is safe, because `__getstate__` has made it
            keep = {"filter": "fully_trusted"} if hasattr(tarfile, "fully_trusted_filter") else {}
            archive.extractall(folder, **keep)  # type: ignore[arg-type]
        # the first name in the archive is the file or folder itself; the files in the folder follow
        return folder / names[0]


if __name__ == "__main__":
    main(*sys.argv[1:])
