"""Gazebo's services for models: scripts that move, read, add and delete models run unchanged."""

from functools import partial
from math import pi

import pytest
import rospy
from gazebo_msgs.msg import ModelState, ModelStates
from gazebo_msgs.srv import DeleteModel, GetModelState, GetWorldProperties, SetModelState, SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from harness import RosTest, twist
from nav_msgs.msg import Odometry
from std_srvs.srv import Empty

BASE_HEIGHT = 0.13  # [m] height of base_link on the floor
CRATE = """<sdf version="1.6"><model name="any"><link name="l"><pose>0 0 0.2 0 0 0</pose>
<collision name="c"><geometry><box><size>0.4 0.4 0.4</size></box></geometry></collision>
</link></model></sdf>"""
POST = """<robot name="any"><link name="post"><inertial><mass value="2"/></inertial>
<collision><geometry><box size="0.3 0.3 1.2"/></geometry></collision></link></robot>"""
FACING_Y = Quaternion(0.0, 0.0, 2**-0.5, 2**-0.5)


def state(model, x=0.0, y=0.0, z=0.0, **more):
    """A state as scripts fill it; an orientation that is left out is of zeros."""
    return ModelState(model_name=model, pose=Pose(position=Point(x, y, z), **more.pop("pose", {})), **more)


def motion(velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)):
    return Twist(Vector3(*velocity), Vector3(*spin))


class GazeboServicesAnswer(RosTest):
    from_the_start = True

    def setUp(self):
        self.set, self.get, self.properties, self.spawn_sdf, self.spawn_urdf, self.delete = (
            self.service(name, kind)
            for name, kind in (
                ("set_model_state", SetModelState),
                ("get_model_state", GetModelState),
                ("get_world_properties", GetWorldProperties),
                ("spawn_sdf_model", SpawnModel),
                ("spawn_urdf_model", SpawnModel),
                ("delete_model", DeleteModel),
            )
        )
        self.addCleanup(self.delete, "crate")
        self.addCleanup(self.delete, "post")

    def service(self, name, kind):
        rospy.wait_for_service(f"/gazebo/{name}", 60.0)
        return rospy.ServiceProxy(f"/gazebo/{name}", kind)

    def agrees(self, answer):
        self.assertTrue(answer.success, answer.status_message)
        return answer

    def refuses(self, answer, *words):
        self.assertFalse(answer.success, answer.status_message)
        for word in words:
            self.assertIn(word, answer.status_message)

    def at(self, pose, x, y, z=None, delta=0.02):
        self.assertAlmostEqual(pose.position.x, x, delta=delta)
        self.assertAlmostEqual(pose.position.y, y, delta=delta)
        if z is not None:
            self.assertAlmostEqual(pose.position.z, z, delta=delta)

    def test_five_episodes_begin_where_the_script_puts_the_robot_and_drive_as_commanded(self):
        states = self.remember("/gazebo/model_states", ModelStates)
        velocity = self.publisher("/cmd_vel", Twist)

        def robot(attribute, msg=None):
            """Pose or twist of the robot in a message; without one, in the newest."""
            msg = msg or states[-1]
            return getattr(msg, attribute)[msg.name.index("husky")]

        def holds_under(speed, condition):
            """Command a speed again, so that it does not end on a busy machine; tell whether it holds."""
            velocity.publish(twist(speed))
            return condition()

        def drive_from(x, y):
            self.agrees(self.set(state("husky", x, y)))
            # messages from before may still be under way
            self.wait_until(lambda: states and abs(robot("pose").position.y - y) < 0.1, "it is there")
            self.at(robot("pose"), x, y, BASE_HEIGHT)
            begin = len(states)
            is_far = partial(holds_under, 0.5, lambda: robot("pose").position.x > x + 1.0)
            self.wait_until(is_far, "it has gone 1 m")
            fastest = max(robot("twist", msg).linear.x for msg in states[begin:])
            self.assertAlmostEqual(fastest, 0.5, delta=0.05)
            self.assertAlmostEqual(robot("pose").position.y, y, delta=0.05)
            stands = partial(holds_under, 0.0, lambda: abs(robot("twist").linear.x) < 0.01)
            self.wait_until(stands, "it stands")

        for episode in range(5):
            drive_from(float(episode), -2.0 - episode)

    def test_models_have_the_names_and_poses_of_the_world_file(self):
        names = ["ground_plane", "unit_cylinder", "husky"]
        self.assertEqual(self.agrees(self.properties()).model_names, names)
        (states, *_) = [self.remember("/gazebo/model_states", ModelStates)]
        self.wait_until(lambda: states, "the states are published")
        self.assertEqual(states[-1].name, names)
        self.at(states[-1].pose[1], 20.0, 5.0)
        self.assertEqual(list(map(len, (states[-1].pose, states[-1].twist))), [3, 3])

    def test_a_state_in_the_frame_of_a_model_is_turned_with_its_velocity(self):
        self.pause()
        self.addCleanup(self.resume)
        self.agrees(self.set(state("husky", 1.0, 1.0, pose={"orientation": FACING_Y})))
        self.agrees(self.spawn_sdf("crate", CRATE, "", Pose(position=Point(3.0, 0.0, 1.0)), "husky"))
        self.at(self.agrees(self.get("crate", "world")).pose, 1.0, 4.0)
        there = state("crate", 4.0, 0.0, 50.0, twist=motion((2.0, 0.0, 0.0)), reference_frame="husky")
        self.agrees(self.set(there))
        seen = self.agrees(self.get("crate", "world"))
        self.assertAlmostEqual(seen.twist.linear.y, 2.0, delta=0.01)
        self.at(seen.pose, 1.0, 5.0, 50.1, delta=0.15)
        from_robot = self.agrees(self.get("crate", "husky"))
        self.assertEqual(from_robot.header.frame_id, "husky")
        self.assertAlmostEqual(from_robot.twist.linear.x, 2.0, delta=0.01)
        self.assertAlmostEqual(from_robot.pose.position.y, 0.0, delta=0.02)

    def test_a_model_comes_as_sdf_or_urdf_and_goes(self):
        self.agrees(self.spawn_sdf("crate", CRATE, "", Pose(position=Point(3.0, 0.0, 0.0)), ""))
        self.agrees(self.spawn_urdf("post", POST, "", Pose(position=Point(3.0, 2.0, 0.6)), "world"))
        self.at(self.agrees(self.get("crate", "")).pose, 3.0, 0.0, 0.0)
        self.at(self.agrees(self.get("post", "")).pose, 3.0, 2.0, 0.6)
        self.refuses(
            self.spawn_sdf("crate", CRATE, "", Pose(position=Point(9.0, 9.0, 0.0)), ""), "'crate'", "already"
        )
        self.agrees(self.delete("crate"))
        self.assertNotIn("crate", self.properties().model_names)
        self.refuses(self.get("crate", ""), "'crate'")

    def test_what_cannot_be_is_refused_with_the_name_of_the_model(self):
        nan = float("nan")
        for answer, *words in (
            (self.set(state("ghost", 1.0)), "model_name 'ghost'", "unit_cylinder", "husky"),
            (self.set(state("husky", nan)), "'husky'", "position nan"),
            (self.set(state("husky", 20.0, 5.0)), "'husky'", "would stand inside 'unit_cylinder'"),
            (self.set(state("husky", 1.0, reference_frame="ghost")), "reference_frame 'ghost'"),
            (self.set(state("husky", 1.0, twist=motion((nan, 0.0, 0.0)))), "'husky'", "twist nan"),
            (self.set(state("ground_plane", 1.0)), "'ground_plane'"),
            (self.get("ghost", ""), "model_name 'ghost'"),
            (self.get("husky", "ghost"), "relative_entity_name 'ghost'"),
            (self.delete("ghost"), "model_name 'ghost'"),
            (self.delete("husky"), "'husky'"),
            (self.spawn_sdf("crate", "<sdf", "", Pose(), ""), "'crate'"),
        ):
            self.refuses(answer, *words)

    def test_a_refused_reset_is_an_error_for_the_caller_though_its_response_has_no_fields(self):
        reset = self.service("reset_world", Empty)
        self.agrees(self.set(state("husky", 5.0, 5.0)))
        self.agrees(self.spawn_sdf("crate", CRATE, "", Pose(), "world"))
        with pytest.raises(rospy.ServiceException, match="'husky' would stand inside 'crate'"):
            reset()
        self.agrees(self.delete("crate"))
        reset()
        self.at(self.agrees(self.get("husky", "world")).pose, 0.0, 0.0, BASE_HEIGHT)

    def test_the_answer_agrees_with_the_true_odometry(self):
        truth = self.remember("/ground_truth/odom", Odometry)
        self.agrees(self.set(state("husky", -3.0, 1.0, pose={"orientation": FACING_Y})))
        before = len(truth) + 1
        self.wait_until(lambda: len(truth) > before, "there is a new pose")
        self.at(truth[-1].pose.pose, -3.0, 1.0, BASE_HEIGHT)
        seen = self.agrees(self.get("mobile_base", "world"))
        self.at(seen.pose, -3.0, 1.0, BASE_HEIGHT)
        self.assertAlmostEqual(2.0 * seen.pose.orientation.z * seen.pose.orientation.w, 1.0, delta=pi / 100.0)
