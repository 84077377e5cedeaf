"""Parameters of the node `sim_bridge`."""

from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.parameters import DeviceParameters

from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.terrain import FLAT, rough
from sim_bridge.plant.world import Stand, World, stand_world, walking_world

WORLDS = ('anymal_c', 'bench')
DEFAULT_CHANNEL = '/tmp/wattwalk.sock'
_MOST = 2**31 - 1
_PUSH = (
    ('push_velocity', 2.0, 'm/s that a push gives the robot; 0: random'),
    ('push_direction', 180.0, "degrees from the world's x axis to the left"),
)


@dataclass(frozen=True)
class NodeParameters:
    """Settings of the node, read once; those of pushes are read at each push."""

    plant: Plant
    terrain: str
    world: str
    joint: str
    stand: Stand
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
        for name, most, text in _PUSH:
            span = FloatingPointRange(from_value=-most, to_value=most)
            descriptor = ParameterDescriptor(description=text, floating_point_range=[span])
            try:
                node.declare_parameter(name, 0.0, descriptor)
            except ParameterException as error:
                raise InputError(f'parameter {name}: {error}') from error
        read = DeviceParameters(node)
        plant = Plant.load(read.text('plant', 'anymal_c', 'plant file, or a shipped plant'))
        settings = cls(
            plant=plant.unit(read.whole('unit', 0, '0: exactly as in the plant file', 0, _MOST)),
            terrain=read.text('terrain', 'flat', 'flat or rough'),
            world=read.text('world', 'anymal_c', 'anymal_c (walking) or bench (one drive)'),
            joint=read.text('joint', 'LF_KFE', 'drive on the bench'),
            stand=Stand(
                read.real('inertia', 0.02, 'kg·m², of the disc on the bench', 0.0, 100.0),
                read.real('mass', 0.0, 'kg, of the pendulum on the bench; 0: none', 0.0, 100.0),
                read.real('length', 0.3, 'm, of the pendulum on the bench', 0.0, 100.0),
            ),
            seed=read.whole('seed', 0, 'of noise, terrain and random pushes', 0, _MOST),
            interface=read.text('interface', 'unixsocket', 'unixsocket, virtual or socketcan'),
            channel=read.text('channel', DEFAULT_CHANNEL, 'socket path, or name of the bus'),
            dbc=read.path('dbc', 'DBC file of the bus; empty: the shipped one'),
            mapping=read.path('mapping', 'signals to drives; empty: the shipped one'),
            publish_clock=read.flag('publish_clock', False, 'publish /clock at 200 Hz'),
            reset_after_fall=read.real(
                'reset_after_fall', 0.0, 's on the ground before a reset; 0: never', 0.0, 3600.0
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
        """Return the world of the parameters."""
        if self.world == 'bench':
            return stand_world(self.joint, self.stand)
        return walking_world(rough(self.seed) if self.terrain == 'rough' else FLAT)

    def push(self, node: Node) -> Floats | None:
        """Return the velocity change of the next push, m/s [3]; None for a random one."""
        speed = float(node.get_parameter('push_velocity').value)
        if speed == 0.0:
            return None
        heading = radians(float(node.get_parameter('push_direction').value))
        return speed * np.array([cos(heading), sin(heading), 0.0])
