"""The ROS shell: the only place that imports rospy."""
