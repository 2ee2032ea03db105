"""Parameters by name, with their ranges: of a command line, and of YAML files."""

import pytest
import yaml

from husky_evaluation.setup import (
    Setup,
    load_setup,
    parameter_values,
    parse_axis,
    setup_of,
    tuned_to_yaml,
    unit_of,
)
from husky_highlevel_controller.config import ConfigError
from husky_highlevel_controller.controller.control import ControlConfig
from husky_highlevel_controller.paths import share_folder

CONFIG = share_folder() / "config"


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("p_gain_vel=0.1:4:3", (0.1, 2.05, 4.0)),
        ("p_gain_vel=0.1:10:3:log", (0.1, 1.0, 10.0)),
        ("p_gain_vel=4,0.5", (0.5, 4.0)),
        ("p_gain_vel=4:1:4", (1.0, 2.0, 3.0, 4.0)),
        ("min_beams=2:4:5", (2, 3, 4)),
        ("lidar/noise=0,0.01", (0.0, 0.01)),
    ],
)
def test_an_axis_is_read(text, values):
    assert parse_axis(text).values == pytest.approx(values)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p_gain_vel", "p_gain_vel=FIRST:LAST:COUNT; 0..10, default 2: forward speed"),
        ("gain=1:2:3", "gain is not a parameter; there are: arrival_tolerance, "),
        ("p_gain_vel=0:20:3", r"p_gain_vel = 20.0 is out of range 0.0..10.0 \(forward speed"),
        ("p_gain_vel=nan:1:3", "p_gain_vel = 'nan:1:3' is not .*: every value must be a finite number"),
        ("min_beams=inf,3", "min_beams = 'inf,3' is not .*: every value must be a finite number"),
        ("p_gain_vel=0:1:0", "COUNT = 0 is not in 1..1000"),
        ("p_gain_vel=0:1:3:log", "equal ratios need numbers above 0"),
        ("p_gain_vel=a", "p_gain_vel = 'a' is not"),
        ("search=0,1", "search is not a numeric parameter"),
        ("lidar=1", "lidar is not a parameter"),
    ],
)
def test_what_is_no_axis_is_named(text, words):
    with pytest.raises(ConfigError, match=words):
        parse_axis(text)


def test_parameters_of_all_records_are_set_by_name_and_have_their_units():
    setup = setup_of("robot", "soft").with_values({"p_gain_vel": 1, "min_beams": 3, "imu/rate_noise": 0.0})
    assert (setup.control.p_gain_vel, setup.detector.min_beams, setup.simulator.imu.rate_noise) == (
        1.0,
        3,
        0.0,
    )
    assert setup.simulator.real == setup_of("robot", "soft").simulator.real, (
        "values that are not parameters stay"
    )
    assert Setup().with_values(parameter_values(Setup())) == Setup()
    assert (unit_of("p_gain_vel"), unit_of("lidar/noise"), unit_of("min_beams")) == ("[1/s]", "[m]", "")


def test_the_controllers_own_file_is_the_default_setup():
    assert load_setup(CONFIG / "controller.yaml", Setup()) == Setup()
    assert load_setup(CONFIG / "robot.yaml", Setup()).control.max_linear == 0.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p_gain_vel: 11", "p_gain_vel = 11 is out of range"),
        ("gain: 1", "gain is not a parameter"),
        ("[1]", "has no parameters; write lines"),
        ("a: [", "while parsing"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, text, words):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(ConfigError, match=f"a.yaml: .*{words}"):
        load_setup(tmp_path / "a.yaml", Setup())


def test_a_file_that_is_written_is_read_again(tmp_path):
    (tmp_path / "a.yaml").write_text(tuned_to_yaml({"p_gain_vel": 1.25, "max_linear": 0.1}, "found"))
    assert yaml.safe_load((tmp_path / "a.yaml").read_text()) == {"p_gain_vel": 1.25, "max_linear": 0.1}
    control = load_setup(tmp_path / "a.yaml", Setup()).control
    assert control == ControlConfig(p_gain_vel=1.25, max_linear=0.1)


def test_a_parameter_of_the_lidar_that_a_real_husky_does_not_have_is_refused():
    assert setup_of("gazebo").with_values({"lidar/noise": 0.05}).simulator.lidar.noise == 0.05
    with pytest.raises(
        ConfigError, match="lidar/noise has no effect with --profile robot; use --profile gazebo"
    ):
        setup_of("robot").with_values({"lidar/noise": 0.05})
