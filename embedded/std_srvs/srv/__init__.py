"""Services of std_srvs, made on first use."""

from rosidl_embedded import services_of

__getattr__ = services_of('std_srvs')
