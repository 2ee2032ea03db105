"""Topics of a drive that lead nowhere, and topics that are forged."""

from husky_grading.drive import ros_graph


def test_topics_that_lead_nowhere_and_topics_that_are_forged():
    ours = {"/husky_simulator", "/marking_recorder"}
    publishers = {"/front/scan": ["/husky_simulator", "/me"], "/drive": ["/me"], "/cmd_vel": ["/me"]}
    subscribers = {"/scan": ["/me"], "/clock": ["/me"], "/cmd_vel": ["/husky_simulator"]}
    types = {"/drive": "geometry_msgs/Twist", "/cmd_vel": "geometry_msgs/Twist"}
    silent = ros_graph.SilentTopics()
    silent.update(publishers, subscribers, ours)
    assert silent.names == ("/scan",)
    assert ros_graph.unread_topics(publishers, subscribers, types, ours) == ["/drive"]
    assert ros_graph.forged_topics(publishers, ("/clock", "/front/scan"), ours) == [("/front/scan", "/me")]
    assert ros_graph.topics_of_truth(subscribers, ours) == []
    for topic in (
        "/ground_truth/odom",
        "/husky_simulator/world/update_full",
        "/husky_simulator/world/update",
    ):
        assert ros_graph.topics_of_truth({topic: ["/marking_recorder", "/me"]}, ours) == [(topic, "/me")]


def test_a_topic_is_silent_only_if_no_node_has_ever_published_it():
    silent = ros_graph.SilentTopics()
    silent.update(
        {"/front/scan": ["/sim"]}, {"/pillar": ["/me"], "/scan": ["/me"], "/front/scan": ["/me"]}, {"/sim"}
    )
    assert silent.names == ("/pillar", "/scan")
    silent.update({"/pillar": ["/finder"], "/front/scan": ["/sim"]}, {"/scan": ["/me"]}, {"/sim"})
    assert silent.names == ("/scan",), "the finder has started later"
    silent.update({}, {"/front/scan": ["/me"]}, {"/sim"})
    assert silent.names == ("/scan",), "the simulator has ended, and so has the subscriber of /scan"
