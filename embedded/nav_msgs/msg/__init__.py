"""Messages of nav_msgs, made on first use."""

from functools import partial

from rosidl_embedded import message_class

__getattr__ = partial(message_class, 'nav_msgs')
