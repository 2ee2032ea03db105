"""The simulated Husky: world files, physics on PyBullet, sensors; without ROS and without the controller."""
