"""The ROS shell; the only folder that imports rospy, tf2_ros and messages. Mirrors the other rooms."""
