"""Keeps rospy from asking the master before each line of the log.

rospy reads the parameter PARAMETER before each line of the log. If nobody has set the parameter, rospy's
cache forgets the answer, so each line asks the master again (rospy 1.15.15: rosout.py, paramserver.py). Then
a thread that logs waits while the master hangs. Such a wait has stopped the simulation's thread.

test_rosout.py tests the part of rospy that this module uses.
"""

from __future__ import annotations

import rospy
from rospy.impl.paramserver import get_param_server_cache

# if true, the messages on /rosout do not list the topics of the node
PARAMETER = "/rosout_disable_topics_generation"


def remember_parameter() -> None:
    """Ask the master once for PARAMETER, and put the answer, or false, into rospy's cache.

    From then on, rospy looks into its cache before each line of the log, and does not ask the master. The
    master still notifies rospy of a change. Call this after rospy.init_node, and before the first line of the
    log.
    """
    # if nobody has given the parameter a value, rospy itself puts nothing into its cache
    get_param_server_cache().set(PARAMETER, rospy.get_param_cached(PARAMETER, False))
