"""Messages of tf2_msgs, made on first use."""

from typing import Any

from rosidl_embedded import message_class


def __getattr__(name: str) -> Any:
    return message_class('tf2_msgs', name)
