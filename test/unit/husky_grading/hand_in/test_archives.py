"""Archives of hand-ins: what is unpacked, and where to."""

import gzip
import io
import os
import pickle
import re
import shutil
import stat
import tarfile
import zipfile
from pathlib import Path

import pytest
from hand_ins import LARGE, archive, unpacked
from packages import put

from husky_grading.hand_in import archives
from husky_grading.hand_in.archives import MAX_BYTES, Allowance, ArchiveError, PackedPath


def test_names_in_a_zip_are_those_that_its_program_meant(tmp_path):
    """Of a folder with a colon; by backslashes, of folders too; in UTF-8 without the flag that says so."""
    made = archive(tmp_path / "a.zip", {"Lab: 3/a": "", "b\\": "", "b\\c": "", "\u00dcbung/d": ""})
    made.write_bytes(made.read_bytes().replace(b"\x14\0\0\x08", b"\x14\0\0\0"))
    assert unpacked(made) == ([], {"Lab: 3/a", "b/c", "\u00dcbung/d"})


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x", "..\\x", "C:/x"])
def test_no_member_of_an_archive_leaves_its_folder(name, tmp_path):
    with pytest.raises(ArchiveError, match="leads out of its folder"):
        unpacked(archive(tmp_path / "a" / "a.zip", {name: "x"}))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "a.zip", "a.zip_unpacked"]


def test_links_and_devices_in_archives_are_left_out(tmp_path):
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as made:
        for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE):
            member = tarfile.TarInfo(f"special_{kind.decode()}")
            member.type, member.linkname = kind, "/etc/passwd"
            made.addfile(member)
        member = tarfile.TarInfo("run")
        member.size, member.mode = 1, 0o755
        made.addfile(member, io.BytesIO(b"x"))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as made:
        link = zipfile.ZipInfo("link")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        made.writestr(link, "/etc/passwd")
    for name, files in (("a.tar.gz", {"run"}), ("a.zip", set())):
        assert unpacked(tmp_path / name) == ([f"links in {name} are left out"], files)
    assert os.access(tmp_path / "a.tar.gz_unpacked" / "run", os.X_OK)


def test_the_last_file_of_a_name_counts_as_in_an_updated_tar(tmp_path):
    with tarfile.open(tmp_path / "a.tar", "w") as made:
        for name, content in (("p/node", b"old, and long"), ("p/other", b"x"), ("./p/node", b"new")):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            made.addfile(member, io.BytesIO(content))
    folder, allowance = tmp_path / "out", Allowance()
    folder.mkdir()
    assert archives.unpack(tmp_path / "a.tar", folder, allowance) == []
    assert (folder / "p" / "node").read_text() == "new"
    assert allowance.size == MAX_BYTES - len("new") - len("x")


def test_an_archive_that_grows_too_large_is_refused(tmp_path):
    bomb = tmp_path / "a.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("zeros", bytes(10_000_000))
    many = archive(tmp_path / "many.zip", {str(n): "" for n in range(30)})
    for path, allowance in ((bomb, {"size": 1_000_000}), (many, {"files": 20})):
        with pytest.raises(ArchiveError, match="too large"):
            unpacked(path, **allowance)
    assert (tmp_path / "a.zip_unpacked" / "zeros").stat().st_size <= 1_000_000


def test_a_large_file_in_an_archive_costs_a_note(tmp_path):
    made = archive(tmp_path / "a.zip", {"a.bag": bytes(100_000_001), "readme.txt": "x"})
    assert unpacked(made) == ([f"{LARGE}a.bag"], {"readme.txt"})


@pytest.mark.parametrize("kind", ["zip", "xztar", "bztar", "gztar"])
def test_a_damaged_archive_costs_itself_only(kind, tmp_path):
    """Each module of Python's library has errors of its own, such as LZMAError and struct.error."""
    made = Path(shutil.make_archive(str(tmp_path / "a"), kind, Path(__file__).parent))
    whole, refused = made.read_bytes(), []
    for position in range(0, len(whole), max(len(whole) // 6, 1)):
        made.write_bytes(whole[:position] + bytes(64) + whole[position + 64 :])
        try:
            unpacked(made)
        except ArchiveError as error:
            refused.append(str(error))
        shutil.rmtree(made.with_name(f"{made.name}_unpacked"))
    assert refused
    assert all(re.match(rf"{made.name} (is broken|cannot be unpacked): ", words) for words in refused)


def test_a_header_of_gigabytes_is_not_read_into_memory(tmp_path):
    bomb = tmp_path / "a.tar.gz"
    header = tarfile.TarInfo("x")
    header.type, header.size = tarfile.GNUTYPE_LONGNAME, 1_200_000_000
    with gzip.open(bomb, "wb", compresslevel=1) as file:
        file.write(header.tobuf(tarfile.GNU_FORMAT))
        for _ in range(120):
            file.write(bytes(10_000_000))
    with pytest.raises(ArchiveError, match=r"a\.tar\.gz cannot be unpacked within 1 GB of memory"):
        unpacked(bomb)


def test_a_hand_in_travels_with_its_permissions_without_links_and_large_files(ann, tmp_path, monkeypatch):
    put(ann / "src" / "node", "#!/usr/bin/env python3").chmod(0o755)
    (ann / "link").symlink_to("/etc/passwd")
    put(ann / "a.bag", "b" * 2000)
    monkeypatch.setattr(archives, "MAX_FILE", 1000)
    sent = pickle.loads(pickle.dumps(PackedPath(ann)))
    shutil.rmtree(ann)
    (tmp_path / "there").mkdir()
    path = sent.unpack(tmp_path / "there")
    assert path == tmp_path / "there" / "ann"
    assert (path / "src" / "node").stat().st_mode & 0o777 == 0o755
    assert [each.name for each in path.iterdir()] == ["src"]
