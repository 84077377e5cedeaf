"""Parameters."""

import array
from enum import Enum
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterType, ParameterValue

SEQUENCES = (list, tuple, array.array)
SINGLE = {'BOOL': bool, 'INTEGER': int, 'DOUBLE': float, 'STRING': str}
ELEMENTS = {'BYTE_ARRAY': bytes, **{f'{name}_ARRAY': kind for name, kind in SINGLE.items()}}


class Parameter:
    """A name, a type (that of the value if not given) and a value.

    TypeError for a value without a type, ValueError where both disagree.
    """

    class Type(Enum):
        """Types of parameters."""

        NOT_SET = ParameterType.PARAMETER_NOT_SET
        BOOL = ParameterType.PARAMETER_BOOL
        INTEGER = ParameterType.PARAMETER_INTEGER
        DOUBLE = ParameterType.PARAMETER_DOUBLE
        STRING = ParameterType.PARAMETER_STRING
        BYTE_ARRAY = ParameterType.PARAMETER_BYTE_ARRAY
        BOOL_ARRAY = ParameterType.PARAMETER_BOOL_ARRAY
        INTEGER_ARRAY = ParameterType.PARAMETER_INTEGER_ARRAY
        DOUBLE_ARRAY = ParameterType.PARAMETER_DOUBLE_ARRAY
        STRING_ARRAY = ParameterType.PARAMETER_STRING_ARRAY

        @classmethod
        def from_parameter_value(cls, parameter_value: Any) -> 'Parameter.Type':
            """Return the type of a value; TypeError if a parameter cannot hold it."""
            if parameter_value is None:
                return cls.NOT_SET
            is_list = isinstance(parameter_value, SEQUENCES)
            for name in ELEMENTS if is_list else SINGLE:
                if cls[name].check(parameter_value):
                    return cls[name]
            what = 'a list of one' if is_list else 'one'
            raise TypeError(
                f"The given value is not {what} of the allowed types '{parameter_value}'."
            )

        def check(self, parameter_value: Any) -> bool:
            """Tell whether a value has this type."""
            if self is Parameter.Type.NOT_SET:
                return parameter_value is None
            if self.name in SINGLE:
                return isinstance(parameter_value, SINGLE[self.name])
            return isinstance(parameter_value, SEQUENCES) and all(
                isinstance(item, ELEMENTS[self.name]) for item in parameter_value
            )

    def __init__(self, name: str, type_: 'Parameter.Type | None' = None, value: Any = None):
        kind = Parameter.Type.from_parameter_value(value) if type_ is None else type_
        if not isinstance(kind, Parameter.Type):
            raise TypeError(f"type must be an instance of '{Parameter.Type!r}'")
        if not kind.check(value):
            raise ValueError(f"Type '{kind}' and value '{value}' do not agree")
        self.type_ = kind
        self.name = name
        self.value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> 'Parameter':
        """Make a parameter of rcl_interfaces/Parameter."""
        kind = Parameter.Type(param_msg.value.type)
        field = FIELDS.get(param_msg.value.type)
        return cls(param_msg.name, kind, getattr(param_msg.value, field) if field else None)

    def get_parameter_value(self) -> Any:
        """Return the value as rcl_interfaces/ParameterValue."""
        message = ParameterValue(type=self.type_.value)
        if self.type_ is not Parameter.Type.NOT_SET:
            setattr(message, FIELDS[self.type_.value], self.value)
        return message


FIELDS = {
    kind.value: f'{kind.name.lower()}_value'
    for kind in Parameter.Type
    if kind is not Parameter.Type.NOT_SET
}


def get_parameter_value(string_value: str) -> Any:
    """Parse text as YAML to a rcl_interfaces/ParameterValue; other text becomes a string."""
    try:
        value = yaml.safe_load(string_value)
    except yaml.YAMLError:
        value = string_value
    try:
        return Parameter('', None, string_value if value is None else value).get_parameter_value()
    except TypeError:
        return Parameter('', None, string_value).get_parameter_value()


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the Python value of a rcl_interfaces/ParameterValue; None if not set."""
    if parameter_value.type == ParameterType.PARAMETER_NOT_SET:
        return None
    if parameter_value.type not in FIELDS:
        raise RuntimeError(f'unexpected parameter type {parameter_value.type}')
    value = getattr(parameter_value, FIELDS[parameter_value.type])
    return list(value) if isinstance(value, SEQUENCES) else value
