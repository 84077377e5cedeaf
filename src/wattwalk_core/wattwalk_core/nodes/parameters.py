"""Parameters of a device: declared with unit and range, read once, read-only afterwards."""

from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from wattwalk_core.errors import InputError


class DeviceParameters:
    """Declares read-only parameters of a node and returns them; InputError for bad values."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def text(self, name: str, default: str, description: str) -> str:
        """Return the value of a string parameter."""
        return self._declare(name, default, ParameterDescriptor(description=description))

    def path(self, name: str, description: str) -> Path | None:
        """Return the value of a file parameter, with `~` expanded; None where it is empty."""
        value = self.text(name, '', description)
        return Path(value).expanduser() if value else None

    def flag(self, name: str, default: bool, description: str) -> bool:
        """Return the value of a boolean parameter."""
        return self._declare(name, default, ParameterDescriptor(description=description))

    def whole(self, name: str, default: int, description: str, low: int, high: int) -> int:
        """Return the value of an integer parameter within [low, high]."""
        limits = [IntegerRange(from_value=low, to_value=high, step=0)]
        descriptor = ParameterDescriptor(description=description, integer_range=limits)
        return self._declare(name, default, descriptor, f'from {low} to {high}')

    def real(self, name: str, default: float, description: str, low: float, high: float) -> float:
        """Return the value of a floating-point parameter within [low, high]."""
        limits = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
        descriptor = ParameterDescriptor(description=description, floating_point_range=limits)
        return self._declare(name, default, descriptor, f'from {low:g} to {high:g}')

    def _declare(
        self, name: str, default: Any, descriptor: ParameterDescriptor, limits: str = ''
    ) -> Any:
        descriptor.read_only = True
        try:
            return self._node.declare_parameter(name, default, descriptor).value
        except ParameterException as error:
            kind = {
                str: 'a string',
                bool: 'true or false',
                int: 'an integer',
                float: 'a number with a decimal point',
            }
            expected = f'{kind[type(default)]} {limits}'.rstrip()
            raise InputError(f'parameter {name}: {error}; expected {expected}') from error
