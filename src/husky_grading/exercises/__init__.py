"""Exercises of the course, one file each, and the records that such a file consists of."""
