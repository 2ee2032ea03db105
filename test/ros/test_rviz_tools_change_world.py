"""RViz's tools change the world and RViz shows it: boxes dropped, dragged, deleted, the robot moved."""

from math import nan

from geometry_msgs.msg import Point, PointStamped, Pose, PoseWithCovarianceStamped, Quaternion, Vector3
from harness import RosTest, ask_simulator, simulator_service
from husky_highlevel_controller.srv import ListObjects, MoveObject, SpawnObject, SpawnObjectRequest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from visualization_msgs.msg import (
    InteractiveMarkerFeedback,
    InteractiveMarkerInit,
    InteractiveMarkerUpdate,
)

from husky_highlevel_controller.datatypes import Pose2D
from husky_highlevel_controller.geometry import compose, pose_from_2d, pose_to_2d, transform_point
from husky_highlevel_controller.ros import conversions

NODE = "/husky_simulator/"
GROUND = -0.13  # [m], in odom, which is as high as base_link
LASER_X = 0.337  # [m], of the lidar in base_link
ODOM_IN_WORLD = pose_from_2d(Pose2D(1.0, -2.0, 0.5))  # as in the launch file
FEEDBACK = InteractiveMarkerFeedback
PULL = (FEEDBACK.MOUSE_DOWN, FEEDBACK.POSE_UPDATE, FEEDBACK.MOUSE_UP)


def at(position):
    return (position.x, position.y, position.z)


class RvizToolsChangeWorld(RosTest):
    def setUp(self):
        self.full = self.remember(NODE + "world/update_full", InteractiveMarkerInit)
        self.updates = self.remember(NODE + "world/update", InteractiveMarkerUpdate)
        self.log = self.remember("/rosout", Log)
        self.points = self.publisher("clicked_point", PointStamped)
        self.poses = self.publisher("initialpose", PoseWithCovarianceStamped)
        self.feedback = self.publisher(NODE + "world/feedback", FEEDBACK)
        ask_simulator("reset")
        self.wait_until(lambda: set(self.drawn()) == set(self.listed()), "RViz knows the world")

    # ------------------------------------------------------------------ what is there, what is shown

    def listed(self, frame="odom"):
        answer = simulator_service("list", ListObjects)(frame)
        return {name: at(pose.position) for name, pose in zip(answer.model_names, answer.poses)}

    def drawn(self):
        """Where RViz draws what: all that it was told, in the order of the sequence numbers."""
        markers, start = {}, -1
        if self.full:
            start = self.full[-1].seq_num
            markers = {marker.name: at(marker.pose.position) for marker in self.full[-1].markers}
        for update in [update for update in self.updates if update.seq_num > start]:
            markers.update({marker.name: at(marker.pose.position) for marker in update.markers})
            markers.update({pose.name: at(pose.pose.position) for pose in update.poses})
            for name in update.erases:
                markers.pop(name, None)
        return markers

    def assert_near(self, found, expected, delta=0.01):
        for a, b in zip(found, expected):
            self.assertAlmostEqual(a, b, delta=delta, msg=f"{found} is not {expected}")

    def wait_until_drawn(self, name, position):
        def there():
            found = self.drawn().get(name)
            return found and max(abs(a - b) for a, b in zip(found, position)) < 0.01

        self.wait_until(there, f"RViz draws {name} at {position}")

    def wait_until_refused(self, words):
        said = f"refused: {words}"
        self.wait_until(
            lambda: any(said in log.msg and log.level == Log.WARN for log in list(self.log)),
            f"it says '{said}'",
        )

    # ------------------------------------------------------------------ what a person does in RViz

    def click(self, x, y, z=GROUND, frame="odom"):
        self.points.publish(PointStamped(Header(frame_id=frame), Point(x, y, z)))

    def drop(self, name, x, y):
        self.click(x, y)
        self.wait_until(lambda: name in self.listed(), f"{name} is there")

    def estimate(self, x, y, yaw):
        msg = PoseWithCovarianceStamped(header=Header(frame_id="odom"))
        msg.pose.pose = conversions.pose_to_msg(pose_from_2d(Pose2D(x, y, yaw)))
        self.poses.publish(msg)

    def pull(self, name, x, y, frame="odom", events=PULL):
        pose = Pose(Point(x, y, self.listed()[name][2]), Quaternion(w=1.0))
        for event in events:
            header = Header(frame_id=frame)
            self.feedback.publish(FEEDBACK(header=header, marker_name=name, event_type=event, pose=pose))

    # ------------------------------------------------------------------ Publish Point

    def test_a_click_drops_a_box_that_the_lidar_sees(self):
        scans = self.remember("front/scan", LaserScan)
        self.drop("box_1", 3.0, 0.0)
        self.assert_near(self.listed()["box_1"], (3.0, 0.0, 0.4 - 0.132))
        distance = 3.0 - 0.2 - LASER_X
        middle = lambda: scans[-1].ranges[len(scans[-1].ranges) // 2]  # noqa: E731
        self.wait_until(
            lambda: scans and abs(middle() - distance) < 0.06, f"the lidar sees it {distance} m ahead"
        )
        self.wait_until_drawn("box_1", (3.0, 0.0, 0.4 - 0.132))
        self.click(3.0, 0.0, 0.8 - 0.132)
        self.wait_until_drawn("box_2", (3.0, 0.0, 1.2 - 0.132))  # on top of the first

    def test_a_click_in_another_frame_is_placed_by_tf(self):
        self.estimate(1.0, 1.0, 1.0)
        base_in_odom = pose_from_2d(Pose2D(1.0, 1.0, 1.0))
        expected = transform_point(base_in_odom, (2.0, 1.0, 0.0))

        def there():
            boxes = [at for name, at in self.listed().items() if name.startswith("box_")]
            if any(abs(x - expected[0]) + abs(y - expected[1]) < 0.02 for x, y, _ in boxes):
                return True
            self.click(2.0, 1.0, frame="base_link")  # the simulator may not have heard of TF yet
            return False

        self.wait_until(there, f"a box is at {expected} in odom")
        self.click(-3.0, 2.0, frame="world")  # of Gazebo's window

        def is_in_world():
            return any(abs(x + 3.0) + abs(y - 2.0) < 0.02 for x, y, _ in self.listed("world").values())

        self.wait_until(is_in_world, "a box is at the click in the world")
        self.click(2.0, 1.0, frame="nowhere")
        self.wait_until_refused("no transform from 'nowhere' to 'odom'")
        self.click(4.0, 1.0, frame="")
        self.wait_until_refused("no transform from '' to 'odom'")
        self.click(nan, 0.0)
        self.wait_until_refused("position nan is not within")

    # ------------------------------------------------------------------ 2D Pose Estimate

    def test_a_pose_moves_the_robot_and_odom_stays(self):
        truths = self.remember("ground_truth/odom", Odometry)
        odometries = self.remember("odometry/filtered", Odometry)

        def is_at(odometry, pose):
            found = pose_to_2d(conversions.pose_from_msg(odometry.pose.pose))
            return max(abs(found.x - pose.x), abs(found.y - pose.y), abs(found.yaw - pose.yaw)) < 0.02

        self.estimate(3.0, 1.0, 1.0)
        in_odom = Pose2D(3.0, 1.0, 1.0)
        in_world = pose_to_2d(compose(ODOM_IN_WORLD, pose_from_2d(in_odom)))
        self.wait_until(lambda: truths and is_at(truths[-1], in_world), f"the robot is at {in_world}")
        self.wait_until(lambda: odometries and is_at(odometries[-1], in_odom), "odometry says so")

        self.drop("box_1", 6.0, 0.0)
        self.estimate(6.0, 0.3, 0.0)
        self.wait_until_refused("'husky' would stand inside 'box_1'")
        self.assertTrue(is_at(truths[-1], in_world), "it is where it was")

    def test_a_robot_on_a_deck_is_moved_on_the_deck(self):
        truths = self.remember("ground_truth/odom", Odometry)
        deck_in_odom = Pose(Point(30.0, 0.0, GROUND + 0.5), Quaternion(w=1.0))
        spawn, move = simulator_service("spawn", SpawnObject), simulator_service("move", MoveObject)
        deck = SpawnObjectRequest(
            model_name="deck", shape="box", size=Vector3(8.0, 8.0, 1.0), initial_pose=deck_in_odom
        )
        deck.reference_frame = "odom"
        self.assertTrue(spawn(deck).success)
        on_deck = Pose(Point(30.0, 0.0, GROUND + 1.0), Quaternion(w=1.0))
        self.assertTrue(move("husky", on_deck, "odom").success)
        self.estimate(31.0, 1.0, 0.0)
        x, y, _ = transform_point(ODOM_IN_WORLD, (31.0, 1.0, 0.0))

        def is_on_deck():
            found = at(truths[-1].pose.pose.position) if truths else (0.0, 0.0, 0.0)
            return max(abs(a - b) for a, b in zip(found, (x, y, 1.13))) < 0.02

        self.wait_until(is_on_deck, "the robot is on the deck, at the pose")

    # ------------------------------------------------------------------ interactive markers

    def test_a_box_is_dragged_and_one_that_finds_no_room_goes_back(self):
        self.drop("box_1", 3.0, 0.0)
        self.drop("box_2", 3.0, 2.0)
        self.pull("box_1", 4.0, -1.0)
        self.wait_until_drawn("box_1", (4.0, -1.0, 0.268))
        self.assert_near(self.listed()["box_1"], (4.0, -1.0, 0.268))
        self.pull("box_1", 5.0, -1.0, events=[FEEDBACK.MOUSE_UP])  # a mere click, which moves nothing

        self.pause()  # now odom does not drift, and nothing is told by chance
        self.addCleanup(self.resume)
        self.drop("box_3", 5.0, 2.0)
        self.wait_until_drawn("box_3", (5.0, 2.0, 0.268))
        count = len(self.updates)
        self.pull("box_1", 3.1, 2.1)
        self.wait_until_refused("'box_1' would stand inside 'box_2'")
        self.wait_until(
            lambda: any(pose.name == "box_1" for update in self.updates[count:] for pose in update.poses),
            "RViz is told to put the marker back",
        )
        self.wait_until_drawn("box_1", (4.0, -1.0, 0.268))
        self.assert_near(self.listed()["box_1"], (4.0, -1.0, 0.268))
        self.pull("unit_cylinder", 3.0, 0.0, frame="nowhere")
        self.wait_until_refused("no transform from 'nowhere' to 'odom'")

    def test_a_box_is_deleted_by_its_menu_and_its_name_is_free_again(self):
        self.drop("box_1", 3.0, 0.0)
        self.wait_until_drawn("box_1", self.listed()["box_1"])
        choice = FEEDBACK(marker_name="box_1", event_type=FEEDBACK.MENU_SELECT, menu_entry_id=1)
        self.feedback.publish(choice)
        self.wait_until(lambda: "box_1" not in self.listed(), "it is gone")
        self.wait_until(lambda: "box_1" not in self.drawn(), "RViz takes it away")
        self.feedback.publish(choice)
        self.wait_until_refused("no body named 'box_1'")
        self.drop("box_1", 5.0, 1.0)
        self.wait_until_drawn("box_1", (5.0, 1.0, 0.268))

    def test_a_marker_follows_what_moves_and_rests_with_it(self):
        pose = Pose(Point(3.0, 0.0, 3.0), Quaternion(w=1.0))
        ball = {"model_name": "ball", "shape": "sphere", "mass": 1.0, "initial_pose": pose}
        size = Point(0.2, 0.2, 0.2)
        simulator_service("spawn", SpawnObject)(**ball, size=size, reference_frame="odom")
        self.wait_until_drawn("ball", (3.0, 0.0, GROUND + 0.1))
        count = len(self.updates)
        self.wait_until(lambda: len(self.updates) > count + 15, "there are signs of life")
        later = list(self.updates)[count:]
        told = [update for update in later if update.poses]  # odom drifts a little
        self.assertLess(len(told), len(later) / 2, "what rests is not told again and again")
