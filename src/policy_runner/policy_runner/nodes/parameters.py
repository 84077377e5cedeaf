"""Parameters of the nodes of this package."""

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from wattwalk_core.errors import InputError


def real_parameter(
    node: Node, name: str, default: float, low: float, high: float, description: str
) -> float:
    """Declare a number of a node and read it once; InputError for one out of low..high."""
    descriptor = ParameterDescriptor(
        description=description,
        read_only=True,
        floating_point_range=[FloatingPointRange(from_value=low, to_value=high, step=0.0)],
    )
    try:
        return float(node.declare_parameter(name, default, descriptor).value)
    except ParameterException as error:
        raise InputError(
            f'parameter {name}: {error}; expected a number with a decimal point '
            f'from {low:g} to {high:g}'
        ) from error
