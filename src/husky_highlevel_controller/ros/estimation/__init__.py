"""ROS shell of estimation."""
