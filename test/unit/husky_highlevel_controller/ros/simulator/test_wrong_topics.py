"""A topic that is written wrongly is told, with the one that was meant; other robots and tools are none."""

import socket
import threading

import pytest

from husky_highlevel_controller.ros.master_graph import Graph, read_graph
from husky_highlevel_controller.ros.simulator.wrong_topics import (
    AbsentTopic,
    SecondPublisher,
    WrongType,
    absent_topics,
    mistake_sentence,
    second_publishers,
    wrong_topics,
    wrong_types,
)

TWIST, SCAN, ODOMETRY = "geometry_msgs/Twist", "sensor_msgs/LaserScan", "nav_msgs/Odometry"


def graph(*others, namespace=""):
    """The simulator's topics, and those of (node, topic, type, whether it publishes)."""
    publishers, subscribers, types = {}, {}, {}
    simulator = [
        ("/husky_simulator", f"{namespace}/front/scan", SCAN, True),
        ("/husky_simulator", f"{namespace}/husky_velocity_controller/odom", ODOMETRY, True),
        ("/husky_simulator", f"{namespace}/cmd_vel", TWIST, False),
        ("/husky_simulator", f"{namespace}/joy_teleop/cmd_vel", TWIST, False),
    ]
    for node, topic, kind, publishes in [*simulator, *others]:
        (publishers if publishes else subscribers).setdefault(topic, []).append(node)
        types[topic] = kind
    return Graph(publishers, subscribers, types)


@pytest.mark.parametrize(
    ("topic", "kind", "publishes", "meant"),
    [
        ("/cmd_vell", TWIST, True, "/cmd_vel"),
        ("/cmd_val", TWIST, True, "/cmd_vel"),
        ("/cmdvel", TWIST, True, "/cmd_vel"),
        ("/joy_telop/cmd_vel", TWIST, True, "/joy_teleop/cmd_vel"),
        ("/fron/scan", SCAN, False, "/front/scan"),
        ("/scan", SCAN, False, "/front/scan"),
        ("/front_scan", SCAN, False, "/front/scan"),
        ("/odom", ODOMETRY, False, "/husky_velocity_controller/odom"),
    ],
)
def test_a_slip_is_told_with_the_topic_that_was_meant(topic, kind, publishes, meant):
    (finding,) = wrong_topics(graph(("/walker", topic, kind, publishes)))
    assert finding == ("/walker", topic, kind, publishes, meant)
    does = f"publishes {kind} on" if publishes else "subscribes to"
    other = "reads" if publishes else "publishes"
    told = mistake_sentence(finding)
    assert told.startswith(f"/walker {does} {topic}, which no node {other}: did you mean {meant}?")
    assert ("robot:=husky_melodic" in told) == (topic == "/scan"), "that robot's lidar is on it"


@pytest.mark.parametrize(
    ("topic", "publishes", "remedy"),
    [
        ("/gazebo/link_states", False, "use /gazebo/model_states, or TF"),
        ("/gazebo/set_model_state", True, "call the service /gazebo/set_model_state"),
        ("/robot1/gazebo/set_link_state", True, "call the service /robot1/gazebo/set_model_state"),
    ],
)
def test_a_topic_of_gazebo_that_is_not_here_is_told_with_what_to_use(topic, publishes, remedy):
    (finding,) = absent_topics(graph(("/walker", topic, "gazebo_msgs/LinkStates", publishes)))
    assert finding == AbsentTopic("/walker", topic, publishes)
    told = mistake_sentence(finding)
    does = "publishes" if publishes else "subscribes to"
    assert told.startswith(f"/walker {does} {topic}, which this simulator does not have: {remedy}")


def test_topics_of_gazebo_that_are_here_or_another_node_s_are_no_mistakes():
    node, kind = "/walker", "gazebo_msgs/ModelStates"
    for others in (
        [(node, "/gazebo/model_states", kind, False)],
        [(node, "/link_states", kind, False)],
        [(node, "/gazebo/link_states", kind, False), ("/gazebo", "/gazebo/link_states", kind, True)],
        [("/rostopic_1", "/gazebo/link_states", kind, False)],
    ):
        assert not absent_topics(graph(*others))


def test_a_robot_in_a_namespace_is_found_by_who_forgets_it():
    (finding,) = wrong_topics(graph(("/walker", "/cmd_vel", TWIST, True), namespace="/robot1"))
    assert finding.suggestion == "/robot1/cmd_vel"
    assert wrong_topics(graph(("/walker", "/robot2/cmd_vel", TWIST, True), namespace="/robot1")) == []


@pytest.mark.parametrize(
    ("node", "topic", "kind", "publishes"),
    [
        ("/walker", "/cmd_vel", TWIST, True),  # right
        ("/walker", "/cmd_vell", "std_msgs/String", True),  # of another type
        ("/walker", "/cmd_vell", "*", True),
        ("/walker", "/robot2/cmd_vel", TWIST, True),  # of another robot
        ("/walker", "/cmd_vel2", TWIST, True),
        ("/walker", "/robot2/front/scan", SCAN, False),
        ("/walker", "/cmd_vel_raw", TWIST, True),  # for a node that has not come yet
        ("/walker", "/walker/debug", TWIST, True),
        ("/walker", "/laser/scan", SCAN, False),  # remapped
        ("/rqt_gui_py_node_1234", "/cmd_vell", TWIST, True),
        ("/rviz_1234", "/scan", SCAN, False),
        ("/record_1234", "/scan", SCAN, False),
        ("/rostopic_1234_5678", "/cmd_vell", TWIST, True),
    ],
)
def test_what_is_no_slip(node, topic, kind, publishes):
    assert wrong_topics(graph((node, topic, kind, publishes))) == []


def test_a_topic_with_its_other_side_is_none():
    pair = [("/walker", "/cmd_vell", TWIST, True), ("/smoother", "/cmd_vell", TWIST, False)]
    assert wrong_topics(graph(*pair)) == []


@pytest.mark.parametrize(
    "answer", [b"SSH-2.0-OpenSSH\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhello"]
)
def test_a_port_that_is_no_masters_has_no_graph(answer):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        assert read_graph(f"http://127.0.0.1:{server.getsockname()[1]}") is None


def kinds(*topics):
    """Types of topics (node, topic, type, whether it publishes) by node, as the nodes say."""
    simulator = [
        ("/husky_simulator", "/cmd_vel", TWIST, False),
        ("/husky_simulator", "/front/scan", SCAN, True),
    ]
    return lambda node, publishes: {
        t: k for n, t, k, p in (*simulator, *topics) if (n, p) == (node, publishes)
    }


def test_a_command_of_a_wrong_type_is_told_with_both_types_and_nodes():
    wrong, right = (
        ("/walker", "/cmd_vel", "geometry_msgs/TwistStamped", True),
        ("/runner", "/cmd_vel", TWIST, True),
    )
    (finding,) = wrong_types(graph(wrong, right), "/husky_simulator", kinds(wrong, right))
    assert finding == WrongType(*wrong, "/husky_simulator", TWIST)
    told = mistake_sentence(finding)
    assert told.startswith("/walker publishes geometry_msgs/TwistStamped on /cmd_vel, but /husky_simulator")
    assert "reads geometry_msgs/Twist there" in told


def test_a_reader_of_a_wrong_type_is_told_and_one_of_any_type_is_not():
    reader, any_reader = (
        ("/walker", "/front/scan", "sensor_msgs/Image", False),
        ("/tool", "/front/scan", "*", False),
    )
    (finding,) = wrong_types(graph(reader, any_reader), "/husky_simulator", kinds(reader, any_reader))
    assert (finding.node, finding.publishes) == ("/walker", False)


@pytest.mark.parametrize(
    ("node", "topic", "is_told"),
    [("/play_1", "/front/scan", True), ("/walker", "/cmd_vel", False), ("/walker", "/tf", False)],
)
def test_a_second_publisher_of_a_topic_of_the_simulator_is_told(node, topic, is_told):
    joint = graph((node, topic, SCAN, True), ("/husky_simulator", "/tf", "tf2_msgs/TFMessage", True))
    findings = second_publishers(joint, "/husky_simulator")
    assert findings == [SecondPublisher(node, topic, "/husky_simulator")] * is_told
    for finding in findings:
        assert "publishes /front/scan, which /husky_simulator publishes too" in mistake_sentence(finding)
