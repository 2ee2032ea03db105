"""What rqt_reconfigure can tune is what the records say: cfg/Controller.cfg, built as catkin builds it."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from runpy import run_path

import dynamic_reconfigure
import pytest

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig

ROOT = Path(__file__).parents[2]
TEMPLATES = "/usr/share/dynamic_reconfigure"
PARAMETERS = {item.name: item for record in (ControlConfig, PillarConfig) for item in fields(record)}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The module that comes out."""
    folder = tmp_path_factory.mktemp("cfg")
    # as catkin does, but where neither this package nor NumPy can be imported
    site = Path(dynamic_reconfigure.__file__).parents[1]
    command = [sys.executable, "-S", ROOT / "cfg" / "Controller.cfg", TEMPLATES, folder, folder, folder]
    subprocess.run(command, cwd=folder, env={"PYTHONPATH": str(site)}, check=True, capture_output=True)
    return run_path(str(folder / "cfg" / "ControllerConfig.py"))


def test_every_gain_and_limit_can_be_tuned_and_nothing_else(built):
    assert set(built["defaults"]) == set(PARAMETERS)


@pytest.mark.parametrize("name", sorted(PARAMETERS))
def test_default_range_and_help_text_are_the_record_s(name, built):
    item = PARAMETERS[name]
    (about,) = (each for each in built["config_description"]["parameters"] if each["name"] == name)
    assert about["description"] == item.metadata["help"]
    assert (about["default"], type(about["default"])) == (item.default, type(item.default))
    least, most = item.metadata.get("min", False), item.metadata.get("max", True)
    assert (about["min"], about["max"]) == (least, most)


def test_it_is_flat(built):
    assert built["config_description"]["groups"] == []
