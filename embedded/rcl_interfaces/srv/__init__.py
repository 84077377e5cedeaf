"""Services of rcl_interfaces, made on first use."""

from rosidl_embedded import services_of

__getattr__ = services_of('rcl_interfaces')
