"""What a running measurement shows while it runs, without ROS."""
