"""Mapping of device clocks to ROS time."""
