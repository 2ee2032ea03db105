"""Preparation of submissions: archives, packages, choice of the launch file, build."""
