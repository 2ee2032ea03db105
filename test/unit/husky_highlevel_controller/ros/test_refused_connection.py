"""rospy's line on a wrong type of messages: the header of the connection is left out."""

import pytest

from husky_highlevel_controller.ros.refused_connection import shorten

BEGIN = "Could not process inbound connection: "  # rospy's words
REASON = "topic types do not match: [geometry_msgs/Twist] vs. [geometry_msgs/TwistStamped]"
HEADER = {
    "callerid": "/husky_simulator",
    "md5sum": "9f195f881246fdfa2798d1d3eebca84a",
    "message_definition": "# It's free\n====\nMSG: geometry_msgs/Vector3\nfloat64 {x}",
    "topic": "/cmd_vel",
}
LINE = f"\x1b[33m[WARN] [1.5, 0.0]: {BEGIN}{REASON}{HEADER}\x1b[0m"


def test_the_line_names_the_other_node_the_topic_and_both_types():
    short = f"\x1b[33m[WARN] [1.5, 0.0]: /husky_simulator cannot connect to /cmd_vel: {REASON}\x1b[0m"
    assert shorten(LINE) == short


@pytest.mark.parametrize(
    "line",
    [
        "",
        f"{BEGIN}{REASON}",
        f"{BEGIN}no topic or service name detected{{'a': open('b')}}",
        f"{BEGIN}{REASON}{{'callerid': '/a'}}",
        LINE.replace("'topic'", "'"),
    ],
)
def test_every_other_line_stays_as_it_is(line):
    assert shorten(line) == line
