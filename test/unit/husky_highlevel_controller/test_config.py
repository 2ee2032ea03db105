"""Parameters become records, or an error that names parameter and value; YAML, record and .cfg agree."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass, field, fields, is_dataclass
from math import copysign, inf, nan
from pathlib import Path
from runpy import run_path
from typing import get_type_hints

import dynamic_reconfigure
import pytest
import yaml

from husky_evaluation.setup import ROBOT_DETECTOR, ROBOT_GAINS, setup_of
from husky_grading.exercises.exercise_3 import ITEMS
from husky_grading.settings import load_rules
from husky_highlevel_controller.config import ConfigError, read_config
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.controller.crash_detection import CrashConfig
from husky_highlevel_controller.controller.pillar_detection import PillarConfig
from husky_highlevel_controller.controller.safety import ProximityConfig
from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.robot import RobotTopics, load_robot
from husky_highlevel_controller.simulator.husky_base import HuskyBaseConfig
from husky_highlevel_controller.simulator.power import PowerConfig
from husky_highlevel_controller.simulator.profile import RobotProfile
from husky_highlevel_controller.simulator.sensors.depth_camera import CameraConfig, CameraSetup
from husky_highlevel_controller.simulator.sensors.lidar import LidarConfig
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xxConfig
from husky_highlevel_controller.simulator.simulator_config import simulator_config

CONFIG_FOLDER = Path(__file__).parents[3] / "config"


@dataclass(frozen=True)
class Wheel:
    radius: float = field(default=0.1, metadata={"min": 0.01, "max": 1.0, "help": "of the tyre [m]"})


@dataclass(frozen=True)
class Cart:
    speed: float = field(default=0.5, metadata={"min": -1.0, "max": 1.0, "help": "cruising [m/s]"})
    wheels: int = field(default=4, metadata={"min": 1, "max": 18, "help": "how many"})
    name: str = field(default="cart", metadata={"help": "what it is called"})
    loud: bool = field(default=False, metadata={"help": "with a horn"})
    wheel: Wheel = field(default_factory=Wheel, metadata={"help": "each wheel"})
    load: float = field(default=1.0, metadata={"min": -inf, "max": inf, "help": "[kg]"})
    secret: float = 7.0  # no metadata: not a parameter


@dataclass(frozen=True)
class Driver:
    age: int = field(default=30, metadata={"min": 18, "max": 99, "help": "in years"})


GOOD = {"speed": 0.25, "wheels": 6, "name": "trolley", "loud": True, "wheel": {"radius": 0.3}, "load": 2.0}


def read(**changes):
    return read_config({**GOOD, **changes}, "/cart/", Cart)[0]


def test_good_parameters_become_a_record():
    assert read() == Cart(0.25, 6, "trolley", True, Wheel(0.3), 2.0)
    assert [read(speed=speed).speed for speed in (-1.0, 1.0)] == [-1.0, 1.0], "the limits are allowed"
    assert type(read(speed=1).speed) is float, "a whole number is a fine one"
    assert copysign(1.0, read(speed=-0.0).speed) == 1.0, "NumPy takes no noise of -0.0"
    cart, driver = read_config({**GOOD, "age": 40}, "/cart/", Cart, Driver)
    assert (cart.name, driver.age) == ("trolley", 40)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("sped", 0.5, "sped is not a parameter; there are: load, loud, name, speed, wheel, wheels"),
        ("secret", 8.0, "secret is not a parameter"),  # a field that is not for users
        ("name", "", "name is empty"),
        ("speed", "5e-1", "speed = '5e-1' is not a float.*; YAML reads it as text, write 0.5$"),
        *[("speed", value, "speed = .* is not a float") for value in ("0.5", True, None, [0.5])],
        *[("wheels", value, "wheels = .* is not a int") for value in (4.0, True, "four")],
        *[("loud", value, "loud = .* is not a bool") for value in (1, "true")],
        ("name", 5, "name = 5 is not a str"),
        *[("speed", value, rf"speed = {value} .*-1\.0\.\.1\.0") for value in (1.001, -2, nan, inf, -inf)],
        *[("wheels", value, rf"wheels = {value} .*1\.\.18") for value in (0, 19)],
        *[("load", value, r"load = .* is out of range") for value in (nan, inf, 10**400, -(10**400))],
        ("wheel", {"radius": 2.0}, r"wheel/radius = 2\.0 .*0\.01\.\.1\.0"),
        ("wheel", {}, "wheel/radius is missing"),
        ("wheel", {"radius": 0.3, "width": 0.1}, "wheel/width is not a parameter"),
        *[("wheel", value, f"wheel .*{re.escape(repr(value))}") for value in (0.3, "0.3", None, [0.3])],
    ],
)
def test_what_cannot_be_is_refused_by_name_value_and_what_may_be(name, value, words):
    with pytest.raises(HuskyError, match=f"/cart/{words}") as caught:
        read(**{name: value})
    assert isinstance(caught.value, ConfigError)


def test_a_parameter_known_to_no_record_is_refused_even_when_several_are_read():
    with pytest.raises(ConfigError, match=r"/cart/tea is not a parameter.*age.*speed"):
        read_config({**GOOD, "age": 40, "tea": 1}, "/cart/", Cart, Driver)


@pytest.mark.parametrize("name", sorted(GOOD))
def test_a_missing_parameter_is_named_with_what_it_is(name):
    values = {key: value for key, value in GOOD.items() if key != name}
    with pytest.raises(ConfigError, match=f"^/cart/{name} is missing") as caught:
        read_config(values, "/cart/", Cart)
    (meaning,) = (item.metadata["help"] for item in fields(Cart) if item.name == name)
    assert meaning in str(caught.value)


def test_evaluate_drives_husky_and_smb_with_the_parameters_of_their_launch_files():
    husky, smb = (yaml.safe_load((CONFIG_FOLDER / f"{name}.yaml").read_text()) for name in ("robot", "smb"))
    assert (husky["p_gain_vel"], husky["p_gain_ang"]) == (ROBOT_GAINS.p_gain_vel, ROBOT_GAINS.p_gain_ang)
    assert husky["range_noise"] == ROBOT_DETECTOR.range_noise
    assert setup_of(robot="smb").control.stop_distance == smb["stop_distance"] == 0.6


@pytest.mark.parametrize(("file", "record"), [("simulator", CameraSetup), ("robot_profile", RobotProfile)])
def test_a_file_holds_the_defaults_of_its_record(file, record):
    values = yaml.safe_load((CONFIG_FOLDER / f"{file}.yaml").read_text())
    assert read_config(values, f"{file}.yaml: ", record) == [record()]


@pytest.mark.parametrize(
    "record",
    [
        CameraSetup,
        CameraConfig,
        ControlConfig,
        PillarConfig,
        RobotProfile,
        Lms1xxConfig,
        HuskyBaseConfig,
        PowerConfig,
    ],
)
def test_every_parameter_says_what_it_is_and_its_default_is_allowed(record):
    hints = get_type_hints(record)
    parameters = [item for item in fields(record) if item.metadata]
    assert parameters
    for item in parameters:
        assert item.metadata["help"], item.name
        if hints[item.name] in (int, float):
            assert item.metadata["min"] <= getattr(record(), item.name) <= item.metadata["max"], item.name
        else:
            assert hints[item.name] in (bool, str) or is_dataclass(hints[item.name]), item.name


@pytest.mark.parametrize(
    ("record", "name", "least", "most"),
    [
        (ControlConfig, "p_gain_vel", 0.0, 10.0),
        (ControlConfig, "p_gain_ang", 0.0, 10.0),
        (ControlConfig, "stop_distance", 0.0, 10.0),
        (ControlConfig, "max_linear", 0.0, 1.0),
        (ControlConfig, "max_angular", 0.0, 2.0),
        (ControlConfig, "arrival_tolerance", 0.001, 0.09),
        (ControlConfig, "search_rate", 0.05, 2.0),
        (ControlConfig, "search_radius_step", 0.1, 10.0),
        (PillarConfig, "pillar_radius", 0.02, 2.0),
        (PillarConfig, "radius_tolerance", 0.001, 1.0),
        (PillarConfig, "max_residual", 0.001, 0.5),
        (PillarConfig, "range_noise", 0.0001, 0.2),
        (PillarConfig, "min_beams", 2, 100),
        (ProximityConfig, "margin", 0.0, 1.0),
        (ProximityConfig, "reaction_time", 0.0, 2.0),
        (ProximityConfig, "braking", 0.1, 10.0),
        (CrashConfig, "max_loss", 0.01, 5.0),
        (CrashConfig, "window", 0.02, 0.5),
        (CrashConfig, "max_loss_rough", 0.01, 5.0),
        (CrashConfig, "vibration_factor", 0.0, 20.0),
        (CrashConfig, "odometry_delay", 0.0, 0.5),
    ],
)
def test_what_moves_or_stops_the_robot_is_taken_within_its_range_and_refused_outside(
    record, name, least, most
):
    step = 1 if isinstance(least, int) else 1e-6
    for bound, beyond in ((least, least - step), (most, most + step)):
        assert getattr(read_config({**vars(record()), name: bound}, "~", record)[0], name) == bound
        with pytest.raises(ConfigError, match=f"~{name} = "):
            read_config({**vars(record()), name: beyond}, "~", record)


def test_a_lidar_without_a_valid_range_is_refused_by_both_parameters():
    values = {**vars(simulator_config().lidar), "range_min": 10.0, "range_max": 0.1}
    with pytest.raises(ConfigError, match=r"~lidar/range_min = 10.0 is not below range_max = 0.1"):
        read_config(values, "~lidar/", LidarConfig)


def test_the_rubric_of_2021_weighs_the_items_of_exercise_3():
    rules = load_rules(CONFIG_FOLDER / "rubric_2021.yaml", ITEMS)
    assert dict(rules.weights) == {"marker at the pillar": 15.0, "marker in RViz": 15.0}


def test_a_robot_without_an_input_for_its_guards_is_refused_by_name():
    values = {**vars(load_robot().topics), "velocity": ["cmd_vel"]}
    with pytest.raises(ConfigError, match="robot/topics/velocity has 1 inputs; guard and controller"):
        read_config(values, "robot/topics/", RobotTopics)


def test_every_gain_and_limit_can_be_tuned_within_its_range_and_nothing_else(tmp_path):
    # as catkin does, but where neither this package nor NumPy can be imported
    site = Path(dynamic_reconfigure.__file__).parents[1]
    command = [
        sys.executable,
        "-S",
        CONFIG_FOLDER.parent / "cfg" / "Controller.cfg",
        "/usr/share/dynamic_reconfigure",
        *[tmp_path] * 3,
    ]
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
