"""Messages of builtin_interfaces, made on first use."""

from rosidl_embedded import messages_of

__getattr__ = messages_of('builtin_interfaces')
