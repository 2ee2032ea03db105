"""Hand-ins for the tests of marking."""

import pytest
from hand_ins import package
from packages import put

from husky_grading.batch import Batch
from husky_grading.records import Job, MarkingConfig


@pytest.fixture
def ann(tmp_path):
    """The hand-in of the only student of a class."""
    folder = tmp_path / "class" / "ann"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def husky(ann):
    """Her package, which is all that she hands in."""
    return package(ann / "husky", "husky")


@pytest.fixture
def batch(ann, tmp_path):
    """The class of a student who hands in no package."""
    put(ann / "readme.txt", "no package")
    return Batch(ann.parent, tmp_path / "out")


@pytest.fixture
def job(ann, batch):
    """The job of a hand-in that holds no package."""
    return Job("ann", str(batch.out), MarkingConfig(), hand_in=str(ann))
