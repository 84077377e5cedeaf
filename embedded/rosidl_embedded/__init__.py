"""ROS 2 Jazzy messages and services as rclpy has them, generated from rosbags' type store."""

from functools import partial

from rosidl_embedded.codec import deserialize, serialize
from rosidl_embedded.message import message_class, service_class

__all__ = ['deserialize', 'message_class', 'serialize', 'service_class']

# The `__getattr__` of a module of messages or services, by its package.
messages_of = partial(partial, message_class)
services_of = partial(partial, service_class)
