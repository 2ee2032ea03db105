"""TF ties every frame of the robot to odom, each by the parent that its URDF says."""

import socket
import subprocess
from contextlib import contextmanager
from math import cos, sin
from xml.etree import ElementTree
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from geometry_msgs.msg import Twist, Vector3
from harness import RosTest, stamp
from rosgraph.network import write_ros_handshake_header
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

WHEEL = "front_left_wheel"
WHEEL_LINKS = [f"{side}_wheel_link" for side in ("front_left", "front_right", "rear_left", "rear_right")]
SUBSCRIBERS = 50  # one after the other


class TfTreeIsComplete(RosTest):
    from_the_start = True

    def test_every_frame_has_the_parent_that_the_urdf_says(self):
        joints = ElementTree.fromstring(rospy.get_param("robot_description")).iter("joint")
        parents = {joint.find("child").get("link"): joint.find("parent").get("link") for joint in joints}
        self.assert_frames({"base_link": "odom", **parents})

    def test_a_wheel_s_frame_turns_with_its_joint(self):
        moving, joints = self.remember("tf", TFMessage), self.remember("joint_states", JointState)
        publisher = self.publisher("cmd_vel", Twist)

        def pairs():
            """The wheel's angle in joint_states and in TF at the same moments."""
            publisher.publish(Twist(linear=Vector3(x=0.5)))
            told = {msg.header.stamp: msg.position[msg.name.index(WHEEL)] for msg in list(joints)}
            frames = [
                t for msg in list(moving) for t in msg.transforms if t.child_frame_id == WHEEL + "_link"
            ]
            turned = {t.header.stamp: t.transform.rotation for t in frames}
            return [(told[at], turned[at]) for at in told if at in turned]

        self.wait_until(lambda: any(angle > 1.0 for angle, _ in pairs()), "the wheel has turned by 1 rad")
        for angle, rotation in pairs():
            self.assertAlmostEqual(rotation.y, sin(angle / 2), places=6)
            self.assertAlmostEqual(rotation.w, cos(angle / 2), places=6)
        transforms = [t for msg in list(moving) for t in msg.transforms if t.child_frame_id == "base_link"]
        ticks = [round(50.0 * stamp(t), 6) for t in transforms]
        self.assertEqual(ticks, [ticks[0] + i for i in range(len(ticks))], "odom to base_link at 50 Hz")

    def test_a_robot_state_publisher_that_somebody_starts_sends_the_wheels_alone(self):
        moving = self.remember("tf", TFMessage)

        def senders():
            """Of the last messages about wheels."""
            wheels = [
                msg for msg in list(moving) if WHEEL + "_link" in {t.child_frame_id for t in msg.transforms}
            ]
            return {msg._connection_header["callerid"] for msg in wheels[-100:]}

        other = subprocess.Popen(["rosrun", "robot_state_publisher", "robot_state_publisher"])
        self.addCleanup(other.kill)
        self.wait_until(lambda: senders() == {"/robot_state_publisher"}, "it alone sends them")
        other.terminate()
        other.wait()
        self.wait_until(lambda: senders() == {"/husky_simulator"}, "the simulator sends them again")

    def test_a_node_that_subscribes_gets_each_transform_once(self):
        self.wait_until(lambda: rospy.get_time() > 0.0, "the simulator runs")
        for number in range(SUBSCRIBERS):
            with connection_to_tf(number) as stream:
                received = [t for _ in range(6) for t in next_message(stream).transforms]
            keys = [(t.child_frame_id, t.header.stamp) for t in received]
            self.assertEqual(len(keys), len(set(keys)), keys)
            self.assertEqual({t.child_frame_id for t in received}, {"base_link", *WHEEL_LINKS})

    def test_a_node_that_subscribes_while_time_stands_still_gets_the_last_transforms(self):
        self.pause()
        self.addCleanup(self.resume)
        with connection_to_tf(SUBSCRIBERS) as stream:
            received = [t.child_frame_id for t in next_message(stream).transforms]
        self.assertEqual(sorted(received), sorted(["base_link", *WHEEL_LINKS]))


@contextmanager
def connection_to_tf(number):
    """Stream of a new connection to the simulator's /tf; rospy's own subscribers share one."""
    master, name = rosgraph.Master(rospy.get_name()), f"/subscriber_{number}"
    with ServerProxy(master.lookupNode("/husky_simulator")) as api:
        _, _, (_, host, port) = api.requestTopic(name, "/tf", [["TCPROS"]])
    header = {"topic": "/tf", "type": TFMessage._type, "md5sum": TFMessage._md5sum, "callerid": name}
    with socket.create_connection((host, port), timeout=30.0) as connection:
        write_ros_handshake_header(connection, header)
        with connection.makefile("rb") as stream:
            read_block(stream)  # the publisher's header
            yield stream


def next_message(stream):
    """The next message of a stream."""
    return TFMessage().deserialize(read_block(stream))


def read_block(stream):
    """Bytes that follow their own number."""
    return stream.read(int.from_bytes(stream.read(4), "little"))
