"""Exercises of the course, one file each, and what a file of an exercise consists of."""
