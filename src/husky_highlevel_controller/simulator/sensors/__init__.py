"""Simulated sensors: lidar, IMU, GPS, depth camera."""
