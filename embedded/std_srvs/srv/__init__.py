"""Services of std_srvs, made on first use."""

from typing import Any

from rosidl_embedded import service_class


def __getattr__(name: str) -> Any:
    return service_class('std_srvs', name)
