"""The world's services: each answers success and a sentence, and a refusal says why and changes nothing."""

from pathlib import Path

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from harness import RosTest, simulator_service, stamp, twist
from husky_highlevel_controller.msg import Bumps
from husky_highlevel_controller.srv import (
    DeleteObject,
    ListObjects,
    LoadWorld,
    MoveObject,
    SpawnObject,
    StepWorld,
)
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock, Log
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty, Trigger

DATA = Path(__file__).resolve().parents[1] / "data"
INF = float("inf")
GATE = """<sdf version="1.6"><model name="any"><static>true</static>{}</model></sdf>""".format(
    "".join(
        f"""<link name="{side}"><pose>0 {y} 0.5 0 0 0</pose><collision name="c"><geometry>
        <box><size>0.2 0.2 1.0</size></box></geometry></collision></link>"""
        for side, y in (("left", 0.8), ("right", -0.8))
    )
)


def pose(x=0.0, y=0.0, z=0.0):
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, 0.0, 1.0))


class WorldServicesAnswer(RosTest):
    def setUp(self):
        self.pause, self.resume, self.reset, self.reset_world = (
            simulator_service(name, Trigger) for name in ("pause", "resume", "reset", "reset_world")
        )
        self.spawn = simulator_service("spawn", SpawnObject)
        self.delete = simulator_service("delete", DeleteObject)
        self.move, self.list = simulator_service("move", MoveObject), simulator_service("list", ListObjects)
        self.step = simulator_service("step", StepWorld)
        self.load_world = simulator_service("load_world", LoadWorld)
        self.scans = self.remember("front/scan", LaserScan)
        self.truth = self.remember("ground_truth/odom", Odometry)
        self.says(self.reset(), "the world is as at the start; time continues from ")

    def says(self, response, words, success=True):
        sentence = getattr(response, "message", None) or response.status_message
        self.assertEqual((response.success, sentence[: len(words)]), (success, words))

    def refuses(self, response, words):
        sentence = getattr(response, "message", None) or response.status_message
        self.assertFalse(response.success, sentence)
        self.assertIn(words, sentence)

    def box(self, name, x, y=0.0, size=0.8, mass=5.0, **more):
        extents = Vector3(size, size, size)
        return self.spawn(model_name=name, shape="box", size=extents, mass=mass,
                          initial_pose=pose(x, y, size / 2.0), **more)  # fmt: skip

    def ahead(self):
        """What a new scan reads straight ahead [m]."""
        count = len(self.scans)
        self.wait_until(lambda: len(self.scans) > count + 1, "there is a new scan")
        ranges = self.scans[-1].ranges
        return ranges[len(ranges) // 2]

    def names(self):
        return set(self.list().model_names)

    def test_an_object_comes_moves_and_goes(self):
        self.says(self.box("crate", 3.0), "'crate' was added")
        self.assertAlmostEqual(self.ahead(), 3.0 - 0.4 - 0.337, delta=0.02)
        self.says(self.move("crate", pose(5.0, 0.0, 0.4), ""), "'crate' was moved")
        self.assertAlmostEqual(self.ahead(), 5.0 - 0.4 - 0.337, delta=0.02)
        listed = self.list()
        self.assertEqual(set(listed.model_names), {"ground_plane", "unit_cylinder", "crate"})
        self.assertAlmostEqual(listed.poses[listed.model_names.index("crate")].position.x, 5.0, delta=0.01)
        self.says(self.delete("crate"), "'crate' was deleted")
        self.assertEqual(self.ahead(), INF)

    def test_a_model_in_sdf_comes_under_the_name_asked_for_and_goes_with_all_its_parts(self):
        self.says(self.spawn(model_name="gate", model_xml=GATE, initial_pose=pose(4.0)), "'gate' was added")
        self.assertEqual(self.names() - {"ground_plane", "unit_cylinder"}, {"gate::left", "gate::right"})
        self.says(self.delete("gate"), "'gate' was deleted")
        self.refuses(
            self.spawn(model_name="gate", model_xml="<sdf", initial_pose=pose()), "model_xml of 'gate'"
        )
        self.assertEqual(self.names(), {"ground_plane", "unit_cylinder"})

    def test_what_cannot_be_is_refused_with_the_reason_and_the_world_goes_on(self):
        self.box("crate", 3.0)
        before = self.names()
        for response, words in (
            (self.box("crate", 6.0), "a body named 'crate' exists already; choose another name"),
            (self.box("new", INF), "position inf is not within"),
            (self.box("new", 6.0, size=1e3 + 1), "size 1001.0 is not within"),
            (self.box("new", 6.0, reference_frame="map"), "reference_frame 'map' is not one of world, odom"),
            (self.delete("ghost"), "no body named 'ghost'"),
            (self.move("husky", pose(-1e308), ""), "position -1e+308 is not within"),
            (self.list("map"), "reference_frame 'map' is not one of"),
            (self.step(1), "the world is running; pause it"),
        ):
            self.refuses(response, words)
        self.assertEqual(self.names(), before)
        self.assertAlmostEqual(self.ahead(), 3.0 - 0.4 - 0.337, delta=0.02)

    def test_a_paused_world_goes_on_by_as_many_steps_as_asked_for(self):
        clock = self.remember("clock", Clock)
        self.says(self.pause(), "paused at ")
        self.refuses(self.step(0), "steps = 0 is not within 1..")
        self.refuses(self.step(4_000_000_000), "steps = 4000000000 is not within 1..")
        self.wait_until(lambda: len(clock) > 5 and clock[-1] == clock[-3], "the clock is held")
        held = clock[-1].clock.to_sec()
        self.says(self.step(100), "100 steps; it is now ")
        self.wait_until(
            lambda: abs(clock[-1].clock.to_sec() - held - 0.5) < 1e-9, "it is half a second later"
        )
        self.says(self.resume(), "running from ")
        self.wait_until(lambda: clock[-1].clock.to_sec() > held + 1.0, "time goes on")

    def test_resets_put_robot_and_objects_back_and_time_runs_on(self):
        clock = self.remember("clock", Clock)
        filtered = self.remember("odometry/filtered", Odometry)
        for reset, survives in ((self.reset, False), (self.reset_world, True)):
            self.box("crate", 3.0)
            self.says(self.move("husky", pose(-2.0, 1.0), ""), "'husky' was moved")
            self.move("crate", pose(8.0, 0.0, 0.4), "")
            self.wait_until(lambda: self.truth[-1].pose.pose.position.x < -1.9, "it is there")
            self.says(reset(), "the ")
            count = len(self.truth)
            self.wait_until(lambda count=count: len(self.truth) > count + 2, "there is a new pose")
            at = self.truth[-1].pose.pose.position
            self.assertAlmostEqual(at.x, 0.0, delta=0.01)
            self.assertAlmostEqual(at.y, 0.0, delta=0.01)
            self.assertEqual("crate" in self.names(), survives)
        self.assertAlmostEqual(self.ahead(), 3.0 - 0.4 - 0.337, delta=0.02)
        self.assertAlmostEqual(filtered[-1].pose.pose.position.x, 0.0, delta=0.01)
        times = [msg.clock.to_sec() for msg in list(clock)]
        self.assertEqual(times, sorted(times), "the clock never runs backwards")
        stamps = [stamp(msg) for msg in list(self.scans)]
        self.assertEqual(stamps, sorted(stamps))

    def test_another_world_is_loaded_whole_or_not_at_all(self):
        self.box("crate", 3.0)
        for name, words in (
            ("none.world", "none.world"),
            ("../package.xml", "package.xml"),
            ("x" * 10_000, "no world"),
        ):
            self.refuses(self.load_world(name), words)
        self.assertIn("crate", self.names())
        self.says(self.load_world("empty.world"), "'")
        self.assertEqual(self.names(), {"ground_plane"})
        self.says(self.load_world("singlePillar.world"), "'")
        self.assertIn("unit_cylinder", self.names())

    def test_a_world_without_ground_gets_one_and_a_fall_is_said_once(self):
        logged = self.remember("/rosout", Log)
        self.addCleanup(self.load_world, "singlePillar.world")
        self.says(self.load_world(str(DATA / "groundless.world")), "'")
        self.assertEqual(self.names(), {"ground_plane"})
        self.wait_until(lambda: any("no ground at (0, 0)" in line.msg for line in logged), "it is said")
        self.assertTrue(self.delete("ground_plane").success)

        def falls():
            return [line for line in logged if "has fallen off the world" in line.msg]

        self.wait_until(falls, "the fall is said")
        height = self.truth[-1].pose.pose.position.z
        self.wait_until(lambda: self.truth[-1].pose.pose.position.z < height - 15.0, "it falls on")
        self.assertEqual(len(falls()), 1)

    def test_gazebo_s_own_names_work_in_scripts(self):
        self.move("husky", pose(-2.0, 1.0), "")
        for name in ("pause_physics", "unpause_physics", "reset_world", "reset_simulation"):
            rospy.ServiceProxy(f"/gazebo/{name}", Empty)()
        self.wait_until(lambda: abs(self.truth[-1].pose.pose.position.x) < 0.01, "it is back")

    def test_odom_is_a_frame_too_and_stays_when_the_robot_is_put_elsewhere(self):
        self.says(self.move("husky", pose(1.0, 2.0), ""), "'husky' was moved")
        listed = self.list("odom")
        pillar = listed.poses[listed.model_names.index("unit_cylinder")].position
        self.assertAlmostEqual(pillar.x, 20.0, delta=0.05)
        self.assertAlmostEqual(pillar.y, 5.0, delta=0.05)
        self.assertAlmostEqual(pillar.z, 1.0 - 0.132, delta=0.01)

    def test_a_bump_names_what_was_hit(self):
        bumps = self.remember("bumps", Bumps)
        self.box("crate", 1.5, mass=0.0)
        velocity = self.publisher("cmd_vel", Twist)

        def bumped():
            velocity.publish(twist(0.5))
            return any(msg.names for msg in list(bumps))

        self.wait_until(bumped, "it bumps", 60.0)
        hit = next(msg for msg in bumps if msg.names)
        self.assertEqual((hit.names, hit.header.frame_id), (["crate"], "base_link"))
        self.assertEqual(bumps[0].names, [], "standing on the ground is not a bump")
