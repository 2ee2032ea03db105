"""Who drives, by the commands on the inputs of twist_mux."""

from types import SimpleNamespace

import pytest

from husky_web.drivers import Drivers, short_name


def command(name, sender, speed):
    linear, angular = SimpleNamespace(x=speed), SimpleNamespace(z=0.0)
    return name, SimpleNamespace(linear=linear, angular=angular, _connection_header={"callerid": sender})


def driver(drivers, *moment):
    found = drivers.command(*moment)
    return found and (found.sender, found.is_by_hand)


def test_the_strongest_input_drives_until_it_is_silent_or_sends_zero():
    drivers = Drivers()
    drivers.take([command("cmd_vel", "/drive", 1.0), command("kb_teleop/cmd_vel", "/me", 0.5)], 1.0, 0.0)
    assert driver(drivers, 1.1, 0.1) == ("/me", True)
    drivers.take([command("kb_teleop/cmd_vel", "/me", 0.0)], 1.1, 0.1)
    assert driver(drivers, 1.1, 0.1) == ("/drive", False)
    drivers.take([command("cmd_vel", "/controller", 0.0)], 1.2, 0.2)
    assert driver(drivers, 1.2, 0.2) == ("/drive", False), "another node's zero is not its own"
    assert driver(drivers, 1.6, 9.0) is None


@pytest.mark.parametrize(
    ("time", "now", "counts"),
    [
        (1.4, 3.0, True),  # slow simulated time
        (1.6, 0.3, False),
        (2.0, 0.2, True),  # fast simulated time: the node repeats itself by the wall's clock
        (0.1, 9.0, False),  # simulated time has begun again
        (None, 0.4, True),
        (None, 0.6, False),
    ],
)
def test_a_command_counts_as_long_as_for_the_robot(time, now, counts):
    drivers = Drivers()
    drivers.take([command("cmd_vel", "/drive", 1.0)], None if time is None else 1.0, 0.0)
    assert (driver(drivers, time, now) is not None) == counts


def test_the_name_of_an_anonymous_node_is_short():
    assert [short_name(name) for name in ("/rostopic_4711_1795778555925", "/robot_2/drive")] == [
        "/rostopic", "/robot_2/drive",
    ]  # fmt: skip
