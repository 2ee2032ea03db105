"""Estimation of the robot's pose from wheel odometry and IMU: the planar filter of exercise 4."""
