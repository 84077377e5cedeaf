"""Implementation behind rclpy's interface."""
