"""Services of std_srvs, made on first use."""

from functools import partial

from rosidl_embedded import service_class

__getattr__ = partial(service_class, 'std_srvs')
