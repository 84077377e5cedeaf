"""Terminal view of a running measurement, without ROS."""
