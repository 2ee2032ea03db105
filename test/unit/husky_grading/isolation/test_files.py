"""Files of a stranger: none is waited for, none leads elsewhere, and writing is whole."""

import errno
import os
import subprocess

import pytest

from husky_grading.isolation.files import (
    UnreadableFileError,
    read_regular,
    read_yaml,
    remove_tree,
    walk,
    write_whole,
)


def test_a_fifo_or_a_device_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("/etc/passwd")
    for path in ("fifo", "link", "/dev/zero", "", "none", "a\0b"):
        with pytest.raises(UnreadableFileError):
            read_regular(tmp_path / path)
    (tmp_path / "large").write_bytes(bytes(11))
    with pytest.raises(UnreadableFileError, match="larger than 10 bytes"):
        read_regular(tmp_path / "large", 10)
    assert read_regular(tmp_path / "large", 11) == bytes(11)


BOMB = "l0: &l0 [1, 2]\n" + "".join(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 10)}]\n" for n in range(1, 9))


ALIASES = {"bomb": BOMB, "itself": "a: &a [*a]\n", "merged": "a: &a {b: 1}\nc: {<<: *a}\n"}
BROKEN = {
    "deep": "[" * 5000, "long": "- x\n" * 200_000, "name": "a: !!python/name:os.system\n", "open": "a: [1\n",
    "date": "a: 2020-13-13\n", "bool": "a: !!bool x\n", "int": "a: !!int ''\n", "time": "a: !!timestamp x\n",
}  # fmt: skip


@pytest.mark.parametrize("name", [*ALIASES, *BROKEN])
def test_yaml_with_aliases_or_that_is_broken_deep_or_long_is_refused_with_its_name(name, tmp_path):
    (tmp_path / "view.rviz").write_text({**ALIASES, **BROKEN}[name])
    words = "YAML aliases are not allowed.* line" if name in ALIASES else ""
    with pytest.raises(UnreadableFileError, match=f"view.rviz: {words}"):
        read_yaml(tmp_path / "view.rviz")


def test_folders_of_any_depth_are_walked_and_no_link_is_followed(tmp_path):
    folder = tmp_path / "/".join("d" * 1500)
    subprocess.run(["mkdir", "-p", str(folder)], check=True)
    (folder / "file").touch()
    (tmp_path / "d" / "loop").symlink_to(tmp_path)
    os.mkfifo(tmp_path / "fifo")
    try:
        assert list(walk(tmp_path)) == [folder / "file"]
    finally:
        remove_tree(tmp_path / "d")  # pytest cannot


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    write_whole(tmp_path / "result.json", "before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(tmp_path / "result.json", "after")
    assert (tmp_path / "result.json").read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
