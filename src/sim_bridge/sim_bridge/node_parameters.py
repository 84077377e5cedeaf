"""Parameters of the node `sim_bridge`."""

from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from power_daq.cli import InputError
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from sim_bridge.plant import Plant
from sim_bridge.robot import JOINT_NAMES
from sim_bridge.terrain import FLAT, rough
from sim_bridge.world import World, stand_world, walking_world

Floats = NDArray[np.float64]
WORLDS = ('anymal_c', 'bench')
DEFAULT_CHANNEL = '/tmp/wattwalk.sock'
_MOST = 2**31 - 1


@dataclass(frozen=True)
class NodeParameters:
    """Settings that the node reads once; those of pushes are read at each push."""

    plant: Plant
    terrain: str
    world: str
    joint: str
    seed: int
    interface: str
    channel: str
    dbc: Path | None
    mapping: Path | None
    publish_clock: bool
    reset_after_fall: float

    @classmethod
    def declare(cls, node: Node) -> 'NodeParameters':
        """Declare on a node and read; InputError for a value that cannot be used."""

        def fixed(name: str, default: str | bool, text: str) -> str:
            descriptor = ParameterDescriptor(description=text, read_only=True)
            return str(node.declare_parameter(name, default, descriptor).value)

        def whole(name: str, text: str) -> int:
            descriptor = ParameterDescriptor(
                description=text,
                read_only=True,
                integer_range=[IntegerRange(from_value=0, to_value=_MOST, step=0)],
            )
            return int(node.declare_parameter(name, 0, descriptor).value)

        def real(name: str, default: float, low: float, high: float, text: str) -> float:
            descriptor = ParameterDescriptor(
                description=text,
                floating_point_range=[FloatingPointRange(from_value=low, to_value=high)],
            )
            return float(node.declare_parameter(name, default, descriptor).value)

        real('push_velocity', 0.0, 0.0, 2.0, 'm/s that a push gives the robot; 0: random')
        real('push_direction', 0.0, -180.0, 180.0, 'degrees from the front to the left, in world')
        dbc = fixed('dbc', '', 'DBC file of the bus; empty: the shipped one')
        mapping = fixed('mapping', '', 'mapping of signals to drives; empty: the shipped one')
        plant = Plant.load(fixed('plant', 'anymal_c', 'plant file, or name of a shipped plant'))
        settings = cls(
            plant=plant.unit(whole('unit', 'unit of the robot; 0: exactly as in the plant file')),
            terrain=fixed('terrain', 'flat', 'flat or rough'),
            world=fixed('world', 'anymal_c', 'anymal_c (walking) or bench (one drive)'),
            joint=fixed('joint', 'LF_KFE', 'drive on the bench'),
            seed=whole('seed', 'of noise, terrain and random pushes'),
            interface=fixed('interface', 'unixsocket', 'unixsocket, virtual or socketcan'),
            channel=fixed('channel', DEFAULT_CHANNEL, 'socket path, or name of the bus'),
            dbc=Path(dbc) if dbc else None,
            mapping=Path(mapping) if mapping else None,
            publish_clock=fixed('publish_clock', False, 'publish /clock at 200 Hz') == 'True',
            reset_after_fall=real(
                'reset_after_fall', 0.0, 0.0, 3600.0, 's on the ground before a reset; 0: never'
            ),
        )
        settings._check()
        return settings

    def _check(self) -> None:
        for name, value, known in (
            ('terrain', self.terrain, ('flat', 'rough')),
            ('world', self.world, WORLDS),
            ('joint', self.joint, JOINT_NAMES),
        ):
            if value not in known:
                raise InputError(f'{name} is {value!r}; it is one of {", ".join(known)}')

    def make_world(self) -> World:
        """The world that the parameters ask for."""
        if self.world == 'bench':
            return stand_world(self.joint)
        return walking_world(rough(self.seed) if self.terrain == 'rough' else FLAT)

    def push(self, node: Node) -> Floats | None:
        """Velocity of the next push, m/s [3]; None for a random one."""
        speed = float(node.get_parameter('push_velocity').value)
        if speed == 0.0:
            return None
        heading = radians(float(node.get_parameter('push_direction').value))
        return speed * np.array([cos(heading), sin(heading), 0.0])
