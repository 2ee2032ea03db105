"""Simulator and controller in one process, without ROS: rollouts and statistics about them."""
