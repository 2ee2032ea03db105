"""Runs of a submission, each in a ROS network with a simulator and a recorder of its own."""
