"""Build of a hand-in: what it prints costs a bounded number of files."""

import pytest

from husky_grading.hand_in import build as build_module
from husky_grading.hand_in.build import MAX_STAND_INS, Folders, build
from husky_grading.isolation.sandbox import Workspace

MISSES = 'Could not find a package configuration file provided by "{}" with\n'


@pytest.fixture
def missed(tmp_path, monkeypatch):
    """A function that builds, each attempt printing other names; the stand-ins that were made, and notes."""
    for name in ("import_early", "_check_builds"):
        monkeypatch.setattr(build_module, name, lambda *_: None)
    (tmp_path / "ws" / "src").mkdir(parents=True)

    def run(names_of):
        attempts = []

        def catkin_make(*_):
            attempts.append(1)
            return "".join(map(MISSES.format, names_of(len(attempts)))), 1

        monkeypatch.setattr(build_module, "_catkin_make", catkin_make)
        folders = Folders(tmp_path / "ws")
        notes = " ".join(note.text for note in build(folders, frozenset(), Workspace()).notes)
        return sorted(path.name for path in folders.stand_ins.glob("share/*")), notes

    return run


def test_a_build_that_prints_any_number_of_missing_packages_gets_50_stand_ins(missed):
    made, notes = missed(lambda attempt: [f"p{attempt}_{number}" for number in range(300)])
    assert len(made) == MAX_STAND_INS
    assert "50 packages or more are missing" in notes


def test_names_that_no_package_has_get_no_stand_in(missed):
    made, notes = missed(lambda attempt: ["x" * 101, "husky_msgs", "a" * 100])
    assert made == ["a" * 100, "husky_msgs"]
    assert "or more are missing" not in notes
