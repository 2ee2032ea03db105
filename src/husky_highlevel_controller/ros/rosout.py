"""Log of rospy without questions to the master.

rospy reads the parameter PARAMETER before each line of the log. If nobody has set it, rospy's cache forgets
the answer, so each line asks the master again (rospy 1.15.15: rosout.py, paramserver.py). A thread that logs
then waits for a master that hangs. Such a wait has stopped the simulation's thread, and so the world.

test_rosout.py tests the part of rospy that this module uses.
"""

from __future__ import annotations

import rospy
from rospy.impl.paramserver import get_param_server_cache

PARAMETER = "/rosout_disable_topics_generation"


def remember_parameter() -> None:
    """Ask the master once for PARAMETER, and put the answer, or false, into rospy's cache.

    From then on the cache answers before each line of the log; rospy still follows a change of the parameter.
    Call it after rospy.init_node, and before the first line of the log.
    """
    get_param_server_cache().set(PARAMETER, rospy.get_param_cached(PARAMETER, False))
