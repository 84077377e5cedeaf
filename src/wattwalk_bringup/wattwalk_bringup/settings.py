"""Settings of a bring-up: from a YAML file, changed by arguments of a command or launch file."""

import dataclasses
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from wattwalk_core.errors import InputError, quoted
from wattwalk_core.namespace import absolute_namespace
from wattwalk_core.schema import Quantity, read, schema
from wattwalk_core.yaml_file import read_yaml, shipped_file

FOLDER: Final = Path(__file__).parent / 'config'
FORMAT: Final = 'bringup/1'
NodeName = Literal['sim', 'daq', 'supply', 'policy', 'estimator', 'recorder']
NODES: Final = typing.get_args(NodeName)
RANDOM: Final = 'random'
NONE: Final = 'none'
"""Word for a setting that is left empty: an argument of `ros2 launch` cannot be empty."""
Robot = Literal['simulated', 'real']


@dataclass(frozen=True)
class About:
    """Description of a setting; `of`: the robot that has it, where it is not both."""

    text: str
    of: Robot | None = None


@schema
class BringupSettings:
    """Settings of a bring-up: the robot, its nodes and their options; InputError for bad ones.

    parameters and arguments: added to those that follow from the other settings, by node.
    """

    format: Literal['bringup/1']
    robot: Robot
    namespace: Annotated[str, About('namespace of all nodes, as robot_1; none: the root')] = ''
    policy: Annotated[str, About('walking policy: a name or folder; none: no policy runner')] = (
        'trot'
    )
    start: Annotated[bool, About('stand up as soon as the robot is heard')] = False
    restart_after: Annotated[
        float,
        Quantity(0.0, 3600.0, 's'),
        About('s without a fault until it starts again; 0: never'),
    ] = 0.0
    velocity: Annotated[
        str, About('VX,VY,YAW to hold (m/s, m/s, rad/s), or random; none: follow cmd_vel')
    ] = ''
    model: Annotated[str, About('power model, ppn:RUN or model.yaml; none: no estimator')] = ''
    record: Annotated[str, About('new folder of the recording, or none')] = ''
    recorder: Annotated[
        Literal['power_daq', 'rosbag2'],
        About('power_daq (counts lost samples, writes card.yaml) or rosbag2 (ros2 bag record)'),
    ] = 'power_daq'
    card: Annotated[str, About('entries of card.yaml: KEY=VALUE KEY=VALUE …')] = ''
    duration: Annotated[
        float, Quantity(0.0, 1e7, 's'), About('s until the end, of the recording; 0: Ctrl-C')
    ] = 0.0
    interface: Annotated[
        str, About('bus: unixsocket, or a python-can interface such as socketcan, or ethercat')
    ] = 'socketcan'
    channel: Annotated[str, About('name of the bus, such as can0, or path of its socket')] = 'can0'
    dbc: Annotated[str, About('DBC file of the bus; none: the shipped one')] = ''
    mapping: Annotated[str, About('YAML file from signals to drives; none: shipped')] = ''
    bus: Annotated[str, About('ready bus description: odrive or moteus', 'real')] = ''
    drives: Annotated[str, About('node numbers of its drives, as hip=0,knee=1', 'real')] = ''
    calibration: Annotated[str, About('YAML file of gains and offsets, or none')] = ''
    supply: Annotated[str, About('address of a bench supply, or none')] = ''
    plant: Annotated[str, About('plant file, or a shipped plant', 'simulated')] = 'anymal_c'
    terrain: Annotated[Literal['flat', 'rough'], About('flat or rough', 'simulated')] = 'flat'
    parameters: dict[NodeName, dict[str, bool | int | float | str]] = dataclasses.field(
        default_factory=dict
    )
    arguments: dict[NodeName, tuple[str, ...]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in [*vars(self).items()]:
            if value == NONE:
                object.__setattr__(self, name, '')
        if self.namespace:
            object.__setattr__(self, 'namespace', absolute_namespace(self.namespace))
        missing = {*self.parameters, *self.arguments} - {*self.nodes()}
        if missing:
            name = min(missing)
            raise InputError(
                f'parameters or arguments of {quoted(name)}, which is not brought up; '
                f'there is {", ".join(self.nodes())}'
            )

    def nodes(self) -> tuple[str, ...]:
        """Return the names of the nodes that are brought up."""
        wanted = {
            'sim': self.robot == 'simulated',
            'daq': True,
            'supply': bool(self.supply),
            'policy': bool(self.policy),
            'estimator': bool(self.model),
            'recorder': bool(self.record),
        }
        return tuple(name for name in NODES if wanted[name])

    @property
    def record_counts(self) -> bool:
        """True if there is a recorder that ends by itself after the duration."""
        return bool(self.record) and self.recorder == 'power_daq'

    @classmethod
    def load(cls, source: str) -> Self:
        """Read a YAML file, or a shipped one by its name; InputError quotes what is amiss."""
        path = shipped_file(source, FOLDER, 'bring-up')
        return read(cls, path, 'bring-up')

    @classmethod
    def shipped(cls, name: str) -> Self:
        """Return shipped settings unchecked.

        `ros2 launch` runs on the Python of ROS, which need not have pydantic.
        """
        return cls(**read_yaml(FOLDER / f'{name}.yaml', 'bring-up'))

    def changed(self, given: Mapping[str, str]) -> Self:
        """Return the settings with values given as text, by name; InputError for a bad value."""
        hints = typing.get_type_hints(type(self), include_extras=True)
        values: dict[str, Any] = {
            name: _value(name, hints[name], text) for name, text in given.items()
        }
        return dataclasses.replace(self, **values)


@dataclass(frozen=True)
class Argument:
    """A setting that may be given as an argument; `choices`: all that it may be, if few."""

    name: str
    description: str
    is_flag: bool
    choices: tuple[str, ...]


def arguments(robot: Robot | None = None) -> Iterator[Argument]:
    """Yield the settings that may be given as arguments, of both robots or of one."""
    for name, hint in typing.get_type_hints(BringupSettings, include_extras=True).items():
        for note in getattr(hint, '__metadata__', ()):
            if isinstance(note, About) and (robot is None or note.of in (None, robot)):
                yield Argument(name, note.text, hint.__origin__ is bool, _choices(hint))


def _choices(hint: Any) -> tuple[str, ...]:
    kind = hint.__origin__
    return typing.get_args(kind) if typing.get_origin(kind) is Literal else ()


def as_text(value: bool | float | str) -> str:
    """Format a setting as an argument: `true`, `0.5`, or `none` for an empty text."""
    if isinstance(value, bool):
        return str(value).lower()
    return (value or NONE) if isinstance(value, str) else f'{value:g}'


def _value(name: str, hint: Any, text: str) -> bool | float | str:
    """Return the value of a text by the type of its setting."""
    choices = ('true', 'false') if hint.__origin__ is bool else _choices(hint)
    if choices and text not in choices:
        raise InputError(f'{name}: expected {" or ".join(choices)}, there is {quoted(text)}')
    if hint.__origin__ is bool:
        return text == 'true'
    for quantity in (note for note in hint.__metadata__ if isinstance(note, Quantity)):
        try:
            return quantity.check(_number(text))
        except ValueError as error:
            raise InputError(f'{name}: {error}') from None
    return text


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
