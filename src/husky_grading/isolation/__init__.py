"""Runs untrusted programs on a private ROS network and ends them."""
