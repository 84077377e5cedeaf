"""ROS 2 Jazzy messages and services as rclpy has them, generated from rosbags' type store."""

from rosidl_embedded.codec import deserialize, serialize
from rosidl_embedded.message import message_class, service_class

__all__ = ['deserialize', 'message_class', 'serialize', 'service_class']
