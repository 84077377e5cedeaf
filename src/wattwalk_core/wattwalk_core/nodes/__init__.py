"""Start, stop, parameters and diagnostics of ROS nodes."""
