"""ROS nodes and what they share; the only folder of this package that imports rospy, tf2_ros and messages."""
