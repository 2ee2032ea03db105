"""Request to an RViz that runs: load a configuration in place of its own."""

from __future__ import annotations

import sys

import rospy
from std_msgs.msg import Bool, String

START_DEADLINE = 20.0  # [s] of wall time for the service to be there


class SendFilePath:
    """Service type rviz/SendFilePath; Debian has no Python module of it. Its messages have one field."""

    _type, _md5sum = "rviz/SendFilePath", "*"
    _request_class, _response_class = String, Bool


def main() -> None:
    """Load it: `NODE FILE`."""
    node, path = sys.argv[1:]
    service = f"{node}/load_config_discarding_changes"
    try:
        rospy.wait_for_service(service, START_DEADLINE)
        rospy.ServiceProxy(service, SendFilePath)(path)
    except (rospy.ROSException, rospy.ServiceException) as error:
        sys.exit(str(error))
