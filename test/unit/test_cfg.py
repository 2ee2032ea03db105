"""What rqt_reconfigure can tune is what the records say: cfg/Controller.cfg, built as catkin builds it."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from runpy import run_path

import dynamic_reconfigure

from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig

ROOT = Path(__file__).parents[2]
TEMPLATES = "/usr/share/dynamic_reconfigure"


def test_every_gain_and_limit_can_be_tuned_within_its_range_and_nothing_else(tmp_path):
    # as catkin does, but where neither this package nor NumPy can be imported
    site = Path(dynamic_reconfigure.__file__).parents[1]
    command = [sys.executable, "-S", ROOT / "cfg" / "Controller.cfg", TEMPLATES, *[tmp_path] * 3]
    subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(site)}, check=True, capture_output=True)
    built = run_path(str(tmp_path / "cfg" / "ControllerConfig.py"))["config_description"]
    assert built["groups"] == [], "it is flat"
    tuned = {about.pop("name"): about for about in built["parameters"]}
    for record in (ControlConfig, PillarConfig):
        for item in fields(record):
            about, limits = tuned.pop(item.name), {"min": False, "max": True, **item.metadata}
            assert (about["default"], type(about["default"])) == (item.default, type(item.default))
            assert (about["min"], about["max"]) == (limits["min"], limits["max"])
            assert about["description"] == limits["help"]
    assert not tuned
