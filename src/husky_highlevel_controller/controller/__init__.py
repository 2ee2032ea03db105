"""The pillar controller and the stop guards. Knows neither ROS nor the simulator."""
