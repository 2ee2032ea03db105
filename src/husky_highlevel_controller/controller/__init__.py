"""The pillar controller and the stop guards, without ROS and without the simulator."""
