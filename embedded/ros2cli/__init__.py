"""The `ros2` command, as far as the embedded rclpy goes."""
