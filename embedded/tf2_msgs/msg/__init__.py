"""Messages of tf2_msgs, made on first use."""

from functools import partial

from rosidl_embedded import message_class

__getattr__ = partial(message_class, 'tf2_msgs')
