"""Shared by the rostest scripts: a node that records messages, and waits with a deadline."""

import time
import unittest
from xmlrpc.client import Error, ServerProxy

import rosgraph
import rosnode
import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

WALL_LIMIT = 60.0  # [s], for a simulation that does not get on
WALL_LEAST = 30.0  # [s] of wall time before simulated time counts


class RosTest(unittest.TestCase):
    """A test case with a node."""

    from_the_start = False  # whether the world is reset before its first test: others ran in the same launch

    @classmethod
    def setUpClass(cls):
        # without a master, rospy would wait forever
        assert rosgraph.is_master_online(), "no ROS master: run the .test file that names this script"
        rospy.init_node("test")
        if cls.from_the_start:
            ask_simulator("reset")

    def remember(self, topic, kind):
        """A list that grows with every message of a topic from now on; every publisher knows of it."""
        keep_registered(rospy.Subscriber, topic, kind)
        messages = []
        subscriber = rospy.Subscriber(topic, kind, messages.append, queue_size=1000, tcp_nodelay=True)
        self.addCleanup(subscriber.unregister)
        self.wait_until(lambda: hears(rospy.get_name(), topic), f"{topic} is published and connected")
        return messages

    def wait_until(self, condition, what, simulated=30.0):
        """Wait for a condition; fail after so many simulated seconds, or when simulated time stands still.

        At ten times real time a process that waits its turn on a busy machine misses many simulated seconds.
        """
        begin, end = time.monotonic(), None
        while not condition():
            now = rospy.get_time()
            if end is None and now > 0.0:
                end = now + simulated
            self.assertFalse(rospy.is_shutdown(), "shut down while waiting until " + what)
            waited = time.monotonic() - begin
            self.assertLess(waited, WALL_LIMIT, f"{WALL_LIMIT} s of wall time passed before {what}")
            late = end is not None and now >= end and waited >= WALL_LEAST
            self.assertFalse(late, f"{simulated} simulated s passed before {what}")
            time.sleep(0.002)

    def wait(self, simulated):
        """Let simulated time pass."""
        self.wait_until(lambda: rospy.get_time() > 0.0, "there is a clock")
        end = rospy.get_time() + simulated
        self.wait_until(lambda: rospy.get_time() >= end, f"{simulated} s passed", simulated + 10.0)

    def resume(self):
        """Start a world launched with paused:=true: nothing happens before all are connected."""
        ask_simulator("resume")

    def pause(self):
        """Stop the world, for what takes wall time and not simulated time: a program that starts, say."""
        ask_simulator("pause")

    def wait_for_node(self, node, *topics):
        """Wait until a node receives these topics, and this node what that one logs."""
        self.wait_until(lambda: all(hears(node, topic) for topic in topics), f"{node} receives {topics}")
        self.wait_until(lambda: hears(rospy.get_name(), "rosout"), "its log is received")

    def publisher(self, topic, kind):
        """A publisher with a subscriber."""
        publisher = keep_registered(rospy.Publisher, topic, kind)
        self.wait_until(publisher.get_num_connections, f"somebody listens to {topic}")
        return publisher

    def assert_topics(self, topics, count):
        """Messages of topics, {topic: (type, frame, rate [Hz])}, each in its frame, none left out."""
        received = {topic: self.remember(topic, kind) for topic, (kind, _, _) in topics.items()}
        self.wait_until(lambda: min(map(len, received.values())) > count, f"there are {count} of each")
        for topic, (_, frame, rate) in topics.items():
            messages = list(received[topic])
            ticks = [round(stamp(msg) * rate, 6) for msg in messages]
            self.assertEqual(ticks, [ticks[0] + i for i in range(len(ticks))], topic)
            self.assertEqual({msg.header.frame_id for msg in messages}, {frame}, topic)
        return received

    def assert_frames(self, parents):
        """TF has these frames with these parents, and no other."""
        moving, fixed = self.remember("tf", TFMessage), self.remember("tf_static", TFMessage)

        def told():
            transforms = [t for msg in (*moving, *fixed) for t in msg.transforms]
            return {t.child_frame_id: t.header.frame_id for t in transforms}

        self.wait_until(lambda: set(parents) <= set(told()), "all frames are there")
        self.assertEqual(told(), parents)


def simulator_service(name, kind):
    """A service of the simulator, which is there."""
    service = rospy.ServiceProxy(f"husky_simulator/{name}", kind)
    service.wait_for_service(WALL_LIMIT)
    return service


def ask_simulator(name):
    """Call a service of the simulator that takes nothing."""
    answer = simulator_service(name, Trigger)()
    assert answer.success, answer.message


_registered = {}


def keep_registered(role, topic, kind):
    """The publisher or subscriber of a topic, registered once for the life of this process.

    rospy loses messages, and sometimes the connection, of a topic that is unregistered and registered again
    (ros_comm #111, #128), so test cases share theirs.
    """
    key = role, rospy.resolve_name(topic)
    if key not in _registered:
        more = {"tcp_nodelay": True} if role is rospy.Subscriber else {}
        _registered[key] = role(topic, kind, queue_size=1000, **more)
    return _registered[key]


def hears(node, topic):
    """Whether a topic has a publisher, and each of its publishers has a connection to a node.

    The subscriber's side of a connection is up before the publisher's: a message sent in between is lost.
    So the publishers are asked.
    """
    topic, node = rospy.resolve_name(topic), rospy.resolve_name(node)
    publishers = dict(rosgraph.Master(rospy.get_name()).getSystemState()[0]).get(topic, ())
    return bool(publishers) and all(_sends(publisher, topic, node) for publisher in publishers)


def _sends(publisher, topic, node):
    """Whether a node has an outgoing connection for a topic to another node; True for one that has died."""
    try:
        with ServerProxy(rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), publisher)) as api:
            connections = api.getBusInfo(rospy.get_name())[2]
    except (OSError, Error, rosnode.ROSNodeException):
        return True
    return any(
        (destination, direction, name) == (node, "o", topic)
        for _, destination, direction, _, name, *_ in connections
    )


def twist(linear=0.0, angular=0.0):
    msg = Twist()
    msg.linear.x, msg.angular.z = linear, angular
    return msg


def stamp(msg):
    return msg.header.stamp.to_sec()
