"""Who drives the robot when several want to."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_highlevel_controller.robot import load_robot
from husky_highlevel_controller.simulator.twist_mux import CommandMux

INPUTS = load_robot().topics.velocity
LAW = settings(derandomize=True, deadline=None, max_examples=100)


def test_the_husky_s_inputs_stand_in_the_husky_s_order():
    assert INPUTS == ("joy_teleop/cmd_vel", "kb_teleop/cmd_vel", "twist_marker_server/cmd_vel", "cmd_vel")


@LAW
@given(st.lists(st.tuples(st.sampled_from(sorted(INPUTS)), st.floats(0.0, 0.4)), max_size=20))
def test_no_command_passes_within_half_a_second_of_a_more_important_one(events):
    mux, now, heard = CommandMux(INPUTS), 0.0, {}
    for topic, pause in events:
        now += pause
        heard[topic] = now
        passed = mux.passes(topic, now)
        overruled = [
            t for t, at in heard.items() if INPUTS.index(t) < INPUTS.index(topic) and now - at <= 0.5
        ]
        assert passed == (not overruled)


@pytest.mark.parametrize("topic", INPUTS)
def test_a_lock_stops_them_all_until_it_is_taken_away(topic):
    mux = CommandMux(INPUTS)
    mux.locked = True
    assert not mux.passes(topic, 0.0)
    mux.forget()
    assert not mux.passes(topic, 1.0), "a reset of the world does not release an emergency stop"
    mux.locked = False
    assert mux.passes(topic, 2.0)
