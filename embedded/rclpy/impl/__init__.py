"""What rclpy keeps behind its interface."""
