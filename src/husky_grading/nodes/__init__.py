"""ROS programs of grading: the recorder and its parts, a master, and the starter of submissions."""
