"""The browser page: shows the robot and acts on it through topics and services only."""
