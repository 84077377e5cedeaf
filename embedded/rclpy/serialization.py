"""Messages to bytes and back."""

from typing import Any

import rosidl_embedded


def serialize_message(message: Any) -> bytes:
    """Return the CDR bytes of a message."""
    return rosidl_embedded.serialize(message)


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Decode CDR bytes to a message of a class; ValueError for bytes of no such message."""
    return rosidl_embedded.deserialize(bytes(serialized_message), message_type)
