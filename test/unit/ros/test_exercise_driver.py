"""What marking asks the ROS master about a submission."""

from xmlrpc.client import Fault

from husky_highlevel_controller.ros.grading import exercise_driver


def test_a_parameter_that_the_master_cannot_send_ends_no_recording(monkeypatch):
    def get_param(name, _):
        raise Fault(1, "int exceeds XML-RPC limits")

    monkeypatch.setattr(exercise_driver.rospy, "get_param_names", lambda: ["/big", "/robot_description"])
    monkeypatch.setattr(exercise_driver.rospy, "get_param", get_param)
    driver = exercise_driver.ExerciseDriver("", "/scan", set())
    assert driver.parameters() == ((), ())
    assert driver.descriptions({"base_link"}) == ()
