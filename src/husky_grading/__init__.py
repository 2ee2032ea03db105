"""Grades submissions by driving them. Starts simulator and submission as programs, imports neither."""
