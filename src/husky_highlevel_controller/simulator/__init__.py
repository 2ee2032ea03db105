"""The simulated Husky: world files, physics on PyBullet, sensors. Knows neither ROS nor the controller."""
