"""Messages of std_msgs, made on first use."""

from typing import Any

from rosidl_embedded import message_class


def __getattr__(name: str) -> Any:
    return message_class('std_msgs', name)
