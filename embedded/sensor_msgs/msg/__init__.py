"""Messages of sensor_msgs, made on first use."""

from rosidl_embedded import messages_of

__getattr__ = messages_of('sensor_msgs')
