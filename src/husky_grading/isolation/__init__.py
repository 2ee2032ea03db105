"""Execution of untrusted programs: sandbox, limits, private ROS network, and their end."""
