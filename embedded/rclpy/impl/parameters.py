"""The parameters of a node: declared, described, validated, set."""

import math
import operator
import re
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import (
    ListParametersResult,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)

from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.parameter import Parameter, parameter_value_to_python

OnSet = Callable[[list[Parameter]], Any]
RELATIVE_TOLERANCE = 1e-6


def out_of_range(parameter: Parameter, descriptor: Any) -> str:
    """Return why a parameter's value is outside its descriptor's range; '' if it is inside."""
    ranges = {
        Parameter.Type.INTEGER: descriptor.integer_range,
        Parameter.Type.DOUBLE: descriptor.floating_point_range,
    }.get(parameter.type_)
    if not ranges:
        return ''
    limits, value = ranges[0], parameter.value
    low, high = sorted((limits.from_value, limits.to_value))
    is_float = parameter.type_ is Parameter.Type.DOUBLE
    same = partial(math.isclose, rel_tol=RELATIVE_TOLERANCE) if is_float else operator.eq
    if same(value, low) or same(value, high):
        return ''
    if not low < value < high:
        dot = '' if is_float else '.'
        return (
            f'Parameter {parameter.name} out of range{dot} Min: {low}, Max: {high}, value: {value}'
        )
    if limits.step:
        nearest = low + round((value - low) / limits.step) * limits.step
        if not same(nearest, value):
            how = 'close enough to a valid step' if is_float else 'a valid step'
            return (
                f'The parameter value for {parameter.name} is not {how}. '
                f'Min: {low}, max: {high}, value: {value}, step: {limits.step}'
            )
    return ''


class Parameters:
    """Base class of a node that declares, reads and sets its parameters."""

    def __init__(self, overrides: dict[str, Any]):
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._parameter_overrides = overrides
        self._on_set: list[OnSet] = []

    def declare_parameter(self, name: str, value: Any = None, descriptor: Any = None) -> Parameter:
        """Declare a parameter by its default value or its Parameter.Type, and return it.

        Raises ParameterAlreadyDeclaredException, InvalidParameterTypeException if the override has
        another type, InvalidParameterValueException if a callback or range refuses it.
        """
        given = ParameterDescriptor() if descriptor is None else descriptor
        if value is None and descriptor is None:
            given.dynamic_typing = True
            warnings.warn(
                f"when declaring parameter named '{name}', declaring a parameter only providing "
                'its name is deprecated. Pass a value, a type or a descriptor with '
                '`dynamic_typing=True`',
                stacklevel=2,
            )
        return self.declare_parameters('', [(name, value, given)])[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]]
    ) -> list[Parameter]:
        """Declare parameters given as tuples (name, value or type, descriptor); return them.

        namespace: prefix of the names. TypeError for other tuples, else as `declare_parameter`.
        """
        declared: list[tuple[Parameter, Any]] = []
        for index, entry in enumerate(parameters):
            if not 1 <= len(entry) <= 3:
                raise TypeError(
                    f'Invalid parameter tuple length at index {index} in parameters list: '
                    f'{entry}; expecting length between 1 and 3'
                )
            name = entry[0]
            if not isinstance(name, str):
                raise TypeError(
                    f'First element {name} at index {index} in parameters list is not a str.'
                )
            name = f'{namespace}.{name}' if namespace else name
            if not re.fullmatch(r'[^\s].*', name):
                raise InvalidParameterException(name)
            descriptor = entry[2] if len(entry) > 2 else ParameterDescriptor()
            if not isinstance(descriptor, ParameterDescriptor):
                raise TypeError(
                    f'Third element {descriptor} at index {index} in parameters list '
                    'is not a ParameterDescriptor.'
                )
            value = self._typed(name, entry[1] if len(entry) > 1 else None, descriptor)
            value = self._parameter_overrides.get(name, value)
            declared.append((Parameter(name, value=value), descriptor))
        known = [parameter.name for parameter, _ in declared if parameter.name in self._parameters]
        if known:
            raise ParameterAlreadyDeclaredException(known)
        for parameter, descriptor in declared:
            self._declare(parameter, descriptor)
        return [self._parameters[parameter.name] for parameter, _ in declared]

    @staticmethod
    def _typed(name: str, default: Any, descriptor: Any) -> Any:
        """Note the type in the descriptor and return the default value."""
        if isinstance(default, ParameterValue):
            default = parameter_value_to_python(default)
        if isinstance(default, Parameter.Type):
            if default is Parameter.Type.NOT_SET:
                raise ValueError(
                    f'Cannot declare parameter {{{name}}} as statically typed of type NOT_SET'
                )
            descriptor.type = default.value
            return None
        if not descriptor.dynamic_typing:
            descriptor.type = Parameter.Type.from_parameter_value(default).value
            if descriptor.type == ParameterType.PARAMETER_NOT_SET:
                raise ValueError(
                    'Cannot declare a statically typed parameter with default value '
                    'of type PARAMETER_NOT_SET'
                )
        return default

    def _declare(self, parameter: Parameter, descriptor: Any) -> None:
        result = self._apply([parameter], {parameter.name: descriptor}, declaring=True)
        if not result.successful:
            if result.reason.startswith('Wrong parameter type'):
                expected = Parameter.Type(descriptor.type).name
                raise InvalidParameterTypeException(parameter, expected)
            raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)

    def has_parameter(self, name: str) -> bool:
        """Tell whether a parameter is declared."""
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter; ParameterNotDeclaredException or ParameterUninitializedException."""
        parameter = self._parameters.get(name)
        if parameter is None:
            raise ParameterNotDeclaredException(name)
        unset = parameter.type_ is Parameter.Type.NOT_SET
        if unset and not self._descriptors[name].dynamic_typing:
            raise ParameterUninitializedException(name)
        return parameter

    def describe_parameter(self, name: str) -> Any:
        """Return a parameter's descriptor; ParameterNotDeclaredException if undeclared."""
        if name in self._descriptors:
            return self._descriptors[name]
        raise ParameterNotDeclaredException(name)

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set declared parameters independently; return a SetParametersResult for each."""
        self._check_declared(parameter_list)
        return [self._apply([parameter], self._descriptors) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all parameters or, if one is refused, none; return one SetParametersResult."""
        self._check_declared(parameter_list)
        return self._apply(parameter_list, self._descriptors)

    def _check_declared(self, parameter_list: list[Parameter]) -> None:
        if not all(isinstance(parameter, Parameter) for parameter in parameter_list):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        unknown = [p.name for p in parameter_list if p.name not in self._parameters]
        if unknown:
            raise ParameterNotDeclaredException(unknown)

    def _apply(
        self, parameter_list: list[Parameter], descriptors: dict[str, Any], declaring: bool = False
    ) -> Any:
        for parameter in parameter_list:
            reason = self._refusal(parameter, descriptors[parameter.name], declaring)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        for callback in self._on_set:
            result = callback(parameter_list)
            if not isinstance(result, SetParametersResult):
                raise TypeError(f'Callback returned an invalid type: {type(result)}')
            if not result.successful:
                return result
        for parameter in parameter_list:
            descriptor = descriptors[parameter.name]
            descriptor.name = parameter.name
            if descriptor.dynamic_typing:
                descriptor.type = parameter.type_.value
            self._descriptors[parameter.name] = descriptor
            self._parameters[parameter.name] = parameter
        return SetParametersResult(successful=True)

    @staticmethod
    def _refusal(parameter: Parameter, descriptor: Any, declaring: bool) -> str:
        """Return why the descriptor refuses a value, '' where it does not."""
        if descriptor.read_only and not declaring:
            return f'Trying to set a read-only parameter: {parameter.name}.'
        if not descriptor.dynamic_typing:
            if parameter.type_ is Parameter.Type.NOT_SET:
                return '' if declaring else 'Static parameter cannot be undeclared'
            if parameter.type_.value != descriptor.type:
                expected = Parameter.Type(descriptor.type)
                return f"Wrong parameter type, expected '{expected}' got '{parameter.type_}'"
        return out_of_range(parameter, descriptor)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return a ListParametersResult of names below prefixes, to `depth` levels (0: all)."""
        result = ListParametersResult()
        for name in self._parameters:
            within = [prefix for prefix in prefixes if f'{name}.'.startswith(f'{prefix}.')]
            rests = [name[len(prefix) + 1 :] for prefix in within] if prefixes else [name]
            if not any(depth == 0 or rest.count('.') < depth for rest in rests):
                continue
            result.names.append(name)
            parent = name.rpartition('.')[0]
            if parent and parent not in result.prefixes:
                result.prefixes.append(parent)
        return result

    def add_on_set_parameters_callback(self, callback: OnSet) -> None:
        """Add a callback that may refuse parameters before they are set: SetParametersResult."""
        self._on_set.insert(0, callback)
