"""Message classes with the behaviour of those that rosidl generates for Python."""

import os
import re
from array import array
from collections.abc import Callable
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from rosidl_embedded import definitions

INTEGER = re.compile(r'(u?)int(8|16|32|64)')
SEQUENCE = re.compile(r'sequence<(.+?)(?:, (\d+))?>|(.+)\[(\d+)\]')


def _single(name: str, idl: str, value: Any) -> None:
    if match := INTEGER.fullmatch(idl):
        bits = int(match[2])
        low, high = (0, 2**bits) if match[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        assert isinstance(value, int | np.integer), f"The '{name}' field must be of type 'int'"
        assert low <= value < high, f"The '{name}' field must be an integer in [{low}, {high - 1}]"
    elif idl in ('float', 'double'):
        assert isinstance(value, float), f"The '{name}' field must be of type 'float'"
    elif idl == 'boolean':
        assert isinstance(value, bool), f"The '{name}' field must be of type 'bool'"
    elif idl == 'octet':
        assert isinstance(value, bytes), f"The '{name}' field must be of type 'bytes'"
        assert len(value) == 1, f"The '{name}' field must be of length 1"
    elif idl.startswith('string'):
        assert isinstance(value, str), f"The '{name}' field must be of type 'str'"
    elif '/' in idl:
        found = getattr(value, '_type_name', '').replace('/msg/', '/')
        assert found == idl, f"The '{name}' field must be a sub message of type '{idl}'"


def check(name: str, idl: str, value: Any) -> None:
    """Raise AssertionError, in rosidl's words, where a value does not fit a field's IDL type."""
    match = SEQUENCE.fullmatch(idl)
    if match is None:
        _single(name, idl, value)
        return
    inner, limit, count = match[1] or match[3], match[2], match[4]
    assert isinstance(value, list | tuple | set | array | np.ndarray), (
        f"The '{name}' field must be a set or sequence"
    )
    assert limit is None or len(value) <= int(limit), (
        f"The '{name}' field must be a set or sequence with length <= {limit}"
    )
    assert count is None or len(value) == int(count), (
        f"The '{name}' field must be a set or sequence with length {count}"
    )
    for item in value:
        _single(name, inner, item)


TYPECODES = {
    'float32': 'f',
    'float64': 'd',
    'int8': 'b',
    'uint8': 'B',
    'char': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
}
IDL_NAMES = {'float32': 'float', 'float64': 'double', 'bool': 'boolean', 'byte': 'octet'}
SCALAR_DEFAULTS = {'string': "''", 'bool': 'False', 'float32': '0.0', 'float64': '0.0'}


class NumericArray(array):
    """An array.array of numbers that the serialiser can view as bytes."""

    __slots__ = ()

    def view(self, _dtype: object) -> memoryview:
        """Return the bytes of the numbers, without a copy."""
        return memoryview(self).cast('B') if self else memoryview(b'')

    def __repr__(self) -> str:
        return f'array({self.typecode!r}, {self.tolist()})'


def numeric(typecode: str, values: Any) -> NumericArray:
    """Copy numbers from any sequence to an array of a typecode."""
    if isinstance(values, np.ndarray):
        values = values.astype(typecode, copy=False).tobytes()
    elif isinstance(values, array) and values.typecode == typecode:
        values = values.tobytes()
    elif isinstance(values, bytes):
        values = list(values)
    return NumericArray(typecode, values)


class Message:
    """Base of all messages."""

    __slots__ = ()
    _type_name: ClassVar[str]
    _fields_and_field_types: ClassVar[dict[str, str]]
    _from_wire: ClassVar[Callable[..., Any]]

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the IDL type of each field, for example `sequence<double>`."""
        return dict(cls._fields_and_field_types)

    def __eq__(self, other: object) -> bool:
        if other.__class__ is not self.__class__:
            return False
        for name in self._fields_and_field_types:
            mine, its = getattr(self, name), getattr(other, name)
            if isinstance(mine, np.ndarray) or isinstance(its, np.ndarray):
                if not np.array_equal(mine, its):
                    return False
            elif mine != its:
                return False
        return True

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        package, kind, name = self._type_name.split('/')
        parts = []
        for field in self._fields_and_field_types:
            value = getattr(self, field)
            shown = value.tolist() if isinstance(value, NumericArray) else value
            parts.append(f'{field}={shown!r}')
        return f'{package}.{kind}.{name}({", ".join(parts)})'


def _idl(desc: FieldDesc) -> str:
    """Return a field's type as rosidl spells it, for example `float[9]`."""
    if desc[0] == Nodetype.BASE:
        name, limit = desc[1]
        return f'{name}<{limit}>' if limit else IDL_NAMES.get(name, name)
    if desc[0] == Nodetype.NAME:
        return desc[1].replace('/msg/', '/')
    inner, count = desc[1]
    if desc[0] == Nodetype.ARRAY:
        return f'{_idl(inner)}[{count}]'
    return f'sequence<{_idl(inner)}, {count}>' if count else f'sequence<{_idl(inner)}>'


class _Field:
    """Storage, default and CDR form of one field."""

    def __init__(self, type_name: str, name: str, desc: FieldDesc):
        self.name, self.desc, self.idl = name, desc, _idl(desc)
        self.slot = self.wire = name
        self.default = self.assign = self.receive = ''
        self.send: Callable[[Any], Any] | None = None
        self.namespace: dict[str, Any] = {}
        inner = desc[1][0] if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else None
        if inner is None:
            self._single(type_name, desc)
        elif inner[0] == Nodetype.BASE and inner[1][0] in TYPECODES:
            self._numbers(TYPECODES[inner[1][0]], desc)
        else:
            self._list(inner, desc)

    def _single(self, type_name: str, desc: FieldDesc) -> None:
        if desc[0] == Nodetype.NAME:
            cls = class_of(str(desc[1]))
            self.namespace = {f'T_{self.name}': cls}
            self.default = f'T_{self.name}()'
        elif desc[1][0] == 'byte':
            self.default = r"b'\0'"
            self.wire, self.receive = f'_wire_{self.name}', f'bytes(({self.name} & 255,))'
            self.send = partial(int.from_bytes, byteorder='little', signed=True)
        else:
            value = definitions.DEFAULTS.get((type_name, self.name))
            usual = SCALAR_DEFAULTS.get(str(desc[1][0]), '0')
            self.default = usual if value is None else repr(value)

    def _numbers(self, typecode: str, desc: FieldDesc) -> None:
        self.slot = self.wire = f'_{self.name}'
        if desc[0] == Nodetype.SEQUENCE:
            self.default = f"NumericArray('{typecode}')"
            self.assign = f"numeric('{typecode}', value)"
            self.receive = f"NumericArray('{typecode}', {self.name}.tobytes())"
        else:
            self.default = f"zeros({desc[1][1]}, '{typecode}')"
            self.assign = f"ndarray(value, '{typecode}')"
            self.receive = f'{self.name}.copy()'

    def _list(self, inner: Any, desc: FieldDesc) -> None:
        count = desc[1][1] if desc[0] == Nodetype.ARRAY else 0
        self.default = '[]'
        if inner[0] == Nodetype.NAME:
            self.namespace = {f'T_{self.name}': class_of(inner[1])}
            if count:
                self.default = f'[T_{self.name}() for _ in range({count})]'
            return
        kind = inner[1][0]
        if count:
            empty = {'bool': 'False', 'byte': r"b'\0'"}.get(kind, "''")
            self.default = f'[{empty}] * {count}'
        if kind == 'bool':
            self.receive = f'{self.name}.astype(bool).tolist()'
            self.send = partial(np.array, dtype=np.bool_)
        elif kind == 'byte':
            self.receive = f'[bytes((v & 255,)) for v in {self.name}.tolist()]'
            self.send = lambda values: np.frombuffer(b''.join(map(bytes, values)), np.uint8)
        if self.send is not None:
            self.wire = f'_wire_{self.name}'

    def wire_property(self) -> property | None:
        """Return the property that gives the serialiser its form of the field, where needed."""
        name, send = self.name, self.send
        return None if send is None else property(lambda self: send(getattr(self, name)))


def _property(field: _Field, checked: bool) -> property:
    scope: dict[str, Any] = {'numeric': numeric, 'ndarray': np.array, 'check': check}
    value = field.assign or 'value'
    test = f'\n    check({field.name!r}, {field.idl!r}, value)' if checked else ''
    exec(
        f'def get(self):\n    return self.{field.slot}\n'
        f'def put(self, value):{test}\n    self.{field.slot} = {value}\n',
        scope,
    )
    return property(scope['get'], scope['put'], doc=f"Message field '{field.name}'.")


@cache
def class_of(type_name: str) -> type[Message]:
    """Return the class of a message such as `sensor_msgs/msg/JointState`, which must be known."""
    package, kind, name = type_name.split('/')
    fields = [_Field(type_name, *entry) for entry in definitions.fields_of(type_name)]
    members: dict[str, Any] = definitions.constants_of(type_name)
    if fields[0].name == definitions.EMPTY_MEMBER:
        members[definitions.EMPTY_MEMBER] = 0
        shown: list[_Field] = []
    else:
        shown = fields
    checked = os.environ.get('ROS_PYTHON_CHECK_FIELDS') == '1'
    if checked:
        for field in shown:
            field.slot = f'_{field.name}'
            field.wire = field.slot if field.wire == field.name else field.wire
    members |= {
        '__slots__': tuple(field.slot for field in shown),
        '__module__': f'{package}.{kind}',
        '__doc__': f"Message class '{name}'.",
        '_type_name': type_name,
        '_fields_and_field_types': {field.name: field.idl for field in shown},
    }
    scope: dict[str, Any] = {'NumericArray': NumericArray, 'zeros': np.zeros}
    for field in shown:
        scope |= field.namespace
        if field.slot != field.name:
            members[field.name] = _property(field, checked)
        if (wire := field.wire_property()) is not None:
            members[field.wire] = wire
    members['__init__'] = _initialiser(shown, scope)
    cls: type[Message] = type(name, (Message,), members)
    scope |= {'cls': cls, 'new': cls.__new__}
    cls._from_wire = staticmethod(_receiver(fields, shown, scope))
    cls._wire_fields = [(field.wire, field.desc) for field in fields]  # type: ignore[attr-defined]
    return cls


def _initialiser(fields: list[_Field], scope: dict[str, Any]) -> Callable[..., None]:
    names = ''.join(f', {field.name}=None' for field in fields)
    lines = [f'def __init__(self{", *" if fields else ""}{names}):', '    pass']
    for field in fields:
        lines += [
            f'    if {field.name} is None:',
            f'        self.{field.slot} = {field.default}',
            '    else:',
            f'        self.{field.name} = {field.name}',
        ]
    exec('\n'.join(lines), scope)
    return scope['__init__']


def _receiver(
    fields: list[_Field], shown: list[_Field], scope: dict[str, Any]
) -> Callable[..., Message]:
    lines = [f'def receive({", ".join(field.name for field in fields)}):', '    self = new(cls)']
    lines += [f'    self.{field.slot} = {field.receive or field.name}' for field in shown]
    exec('\n'.join([*lines, '    return self']), scope)
    return scope['receive']


def message_class(package: str, name: str, kind: str = 'msg') -> Any:
    """Return a message class by package and name.

    Raises AttributeError where there is no such message, as a module does for a missing name.
    """
    type_name = f'{package}/{kind}/{name}'
    if name.startswith('__') or not definitions.is_known(type_name):
        raise AttributeError(f'module {package}.{kind} has no attribute {name!r}')
    return class_of(type_name)


@cache
def service_class(package: str, name: str) -> Any:
    """Return a service class by package and name.

    Raises AttributeError where there is no such service, as a module does for a missing name.
    """
    if name.startswith('__') or not definitions.is_known(f'{package}/srv/{name}_Request'):
        raise AttributeError(f'module {package}.srv has no attribute {name!r}')
    members = {
        'Request': class_of(f'{package}/srv/{name}_Request'),
        'Response': class_of(f'{package}/srv/{name}_Response'),
        '_type_name': f'{package}/srv/{name}',
        '__module__': f'{package}.srv',
        '__doc__': f"Service class '{name}' with Request and Response.",
    }
    return type(name, (), members)
