"""The exceptions of rclpy, which has them without the suffix Error."""

# ruff: noqa: N818

from typing import TYPE_CHECKING, Any, ClassVar

from rclpy._rclpy_pybind11 import InvalidHandle as InvalidHandle

if TYPE_CHECKING:
    from rclpy.parameter import Parameter


class NotInitializedException(Exception):
    """Raised when something is used before rclpy.init()."""

    def __init__(self, message: str | None = None):
        detail = f' msg:{message}' if message else ''
        super().__init__(f'rclpy.init() has not been called.{detail}')


class NameValidationException(Exception):
    """Raised when a name is invalid; its subclasses say a name of what it is."""

    name_type: ClassVar[str]

    def __init__(self, name: str, error_msg: str, invalid_index: int):
        mark = ' ' * invalid_index
        super().__init__(f"Invalid {self.name_type}: {error_msg}:\n  '{name}'\n   {mark}^")


class InvalidNamespaceException(NameValidationException):
    """Raised when a namespace is invalid."""

    name_type = 'namespace'


class InvalidNodeNameException(NameValidationException):
    """Raised when a node name is invalid."""

    name_type = 'node name'


class InvalidTopicNameException(NameValidationException):
    """Raised when a topic name is invalid."""

    name_type = 'topic name'


class InvalidServiceNameException(NameValidationException):
    """Raised when a service name is invalid."""

    name_type = 'service name'


class ParameterException(Exception):
    """Base class of errors about parameters."""

    def __init__(self, error_msg: str, parameters: str | list[str]):
        super().__init__(f'{error_msg}: {parameters}')


class ParameterNotDeclaredException(ParameterException):
    """Raised when an undeclared parameter is used."""

    def __init__(self, parameters: str | list[str]):
        super().__init__('Invalid access to undeclared parameter(s)', parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """Raised when a parameter is declared twice."""

    def __init__(self, parameters: str | list[str]):
        super().__init__('Parameter(s) already declared', parameters)


class InvalidParameterException(ParameterException):
    """Raised when a parameter to be declared has an invalid name."""

    def __init__(self, parameter_name: str):
        super().__init__('Invalid parameter name', parameter_name)


class InvalidParameterTypeException(ParameterException):
    """Raised when a parameter is rejected for its type."""

    def __init__(self, desired_parameter: 'Parameter', expected_type: str):
        super().__init__(
            f"Trying to set parameter '{desired_parameter.name}' to '{desired_parameter.value}'"
            f" of type '{desired_parameter.type_.name}', expecting type '{expected_type}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    """Raised when a parameter is rejected by a callback or by its descriptor."""

    def __init__(self, parameter: str, value: Any, reason: str):
        super().__init__(
            f'Invalid parameter value ({value}) for parameter. Reason: {reason}', parameter
        )


class ParameterUninitializedException(ParameterException):
    """Raised when a parameter without a value is read."""

    def __init__(self, parameter_name: str):
        super().__init__(f"The parameter '{parameter_name}' is not initialized", parameter_name)
