"""Log of rospy without questions to the master.

rospy reads the parameter PARAMETER before each line of the log. If nobody has set it, rospy's cache forgets
the answer, so each line asks the master again (rospy 1.15.15: rosout.py, paramserver.py). A thread that logs
then waits for a master that hangs. This held the simulation's thread, and the world with it.

test_rosout.py pins what is used of rospy.
"""

from __future__ import annotations

import rospy
from rospy.impl.paramserver import get_param_server_cache

PARAMETER = "/rosout_disable_topics_generation"


def remember_parameter() -> None:
    """Ask the master once, and let rospy's cache answer from then on; rospy still follows a change.

    Call it after rospy.init_node, and before the first line of the log.
    """
    get_param_server_cache().set(PARAMETER, rospy.get_param_cached(PARAMETER, False))
