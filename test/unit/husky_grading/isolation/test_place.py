"""Neutral place of a marking: whatever --out is called, it builds and drives at the same plain path."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from husky_grading.isolation import place, private_network
from husky_highlevel_controller.datatypes import HuskyError

CODE = """
import sys
from pathlib import Path
from husky_grading.isolation import place, private_network
private_network.enter_network()
out = place.show_results_at(Path(sys.argv[1]))
print(out)
(out / "made").touch()
"""
ODD = 'o\'9 "x" $(y);%s\\b:\u00fc\n'


@pytest.mark.skipif(
    private_network.MOUNTS not in private_network._namespace_command(), reason="no mount namespaces here"
)
def test_a_folder_is_seen_at_a_path_without_a_name_of_anybody_and_its_files_lie_in_it(tmp_path):
    seen, script = set(), tmp_path / "script.py"
    script.write_text(CODE)
    for name in (ODD, os.fsdecode(b"M\xfcller"), "plain"):
        command = [sys.executable, str(script), str(tmp_path / name)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seen.add(done.stdout.strip())
        assert (tmp_path / name / "made").is_file()
    assert seen == {f"/var/tmp/marking_{os.getuid()}/hand_in"}
    assert not list(Path(*seen).iterdir()), "nobody else sees it there"


def test_without_mounts_of_its_own_an_odd_path_is_refused_and_a_plain_one_taken(tmp_path, monkeypatch):
    monkeypatch.delenv(place.VARIABLE, raising=False)
    assert place.show_results_at(tmp_path / "out-1.b_c") == tmp_path / "out-1.b_c"
    for name in (ODD, "a b", "a:b", "a'b"):
        with pytest.raises(HuskyError, match="characters that CMake and roslaunch do not accept"):
            place.show_results_at(tmp_path / name)


def test_the_place_is_a_folder_of_this_user_s_and_no_link(tmp_path, monkeypatch):
    monkeypatch.setattr(place, "FOLDER", str(tmp_path))
    made = place.make()
    assert made == place.make() == f"{tmp_path}/marking_{os.getuid()}/hand_in"
    Path(made).rmdir()
    Path(made).symlink_to(tmp_path)
    assert place.make() == ""
    Path(made).unlink()
    Path(made).parent.rename(tmp_path / "marking_4711")
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    assert place.make() == "", "it is another user's"
