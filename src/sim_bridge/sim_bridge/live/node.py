"""Node `sim_bridge`: the simulated robot in real time behind the CAN bus of the hardware."""

import time
from collections.abc import Sequence
from math import cos, radians, sin
from threading import Event, Thread

import numpy as np
from power_daq.bus.description import BusDescription
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import FaultLog, Level, Report, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.nodes.services import offer

from sim_bridge.live.publishing import SamplePublisher
from sim_bridge.live.real_time import FrameEncoder, LivePlant, SimulatedBus, joint_command
from sim_bridge.offline.session import random_push
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import Simulation
from sim_bridge.plant.terrain import FLAT, TERRAINS, rough
from sim_bridge.plant.world import Stand, World, stand_world, walking_world
from sim_bridge.sensors.blocks import InstrumentReadings, Instruments

_MOST = 2**31 - 1
_PUSH = (
    ('push_velocity', 2.0, 'm/s that a push gives the robot; 0: random'),
    ('push_direction', 180.0, "degrees from the world's x axis to the left"),
)
"""Parameters that are read at each push; all others are read once."""


def _choice(
    read: DeviceParameters, name: str, default: str, known: Sequence[str], text: str
) -> str:
    value = read.text(name, default, text)
    if value not in known:
        raise InputError(f'{name} is {value!r}; it is one of {", ".join(known)}')
    return value


def _world(read: DeviceParameters, seed: int) -> World:
    terrain = _choice(read, 'terrain', 'flat', TERRAINS, 'flat or rough')
    text = 'anymal_c (walking) or bench (one drive)'
    world = _choice(read, 'world', 'anymal_c', ('anymal_c', 'bench'), text)
    joint = _choice(read, 'joint', 'LF_KFE', JOINT_NAMES, 'drive on the bench')
    stand = Stand(
        read.real('inertia', 0.02, 'kg·m², of the disc on the bench', 0.0, 100.0),
        read.real('mass', 0.0, 'kg, of the pendulum on the bench; 0: none', 0.0, 100.0),
        read.real('length', 0.3, 'm, of the pendulum on the bench', 0.0, 100.0),
    )
    if world == 'bench':
        return stand_world(joint, stand)
    return walking_world(rough(seed) if terrain == 'rough' else FLAT)


class SimNode(Node):
    """Node with the plant in a thread, which takes the commands; the executor serves services."""

    def __init__(self) -> None:
        super().__init__('sim_bridge')
        self._declare_pushes()
        read = DeviceParameters(self)
        plant = Plant.load(read.text('plant', 'anymal_c', 'plant file, or a shipped plant'))
        plant = plant.unit(read.whole('unit', 0, '0: exactly as in the plant file', 0, _MOST))
        seed = read.whole('seed', 0, 'of noise, terrain and random pushes', 0, _MOST)
        interface = read.text('interface', 'unixsocket', 'unixsocket, virtual or socketcan')
        channel = read.text('channel', '/tmp/wattwalk.sock', 'socket path, or name of the bus')
        dbc = read.path('dbc', 'DBC file of the bus; empty: the shipped one')
        bus = BusDescription.load(
            dbc, read.path('mapping', 'signals to drives; empty: the shipped one')
        )
        with_clock = read.flag('publish_clock', False, 'publish /clock at 200 Hz')
        self._reset_after_fall = read.real(
            'reset_after_fall', 0.0, 's on the ground before a reset; 0: never', 0.0, 3600.0
        )
        self._random = np.random.default_rng([seed, 2])
        simulation = Simulation(plant, _world(read, seed))
        instruments = Instruments(simulation, seed)
        encoder = FrameEncoder(bus, simulation.joints, instruments.clock)
        self._joints = simulation.joints
        self._absent = frozenset(bus.drives) - set(simulation.joints)
        self._device_clock = instruments.clock
        self._publisher = SamplePublisher(self, simulation.world, instruments.clock, with_clock)
        self._reporter = Reporter(self, hardware_id='simulation')
        self._faults = FaultLog(self.get_logger(), 5.0)
        self._bus = SimulatedBus(interface, channel)
        self.plant = LivePlant(simulation, instruments, encoder, self._bus.send, self._hand_on)
        self.done: Future = Future()
        self._reported = self._down_seconds = 0
        self._commands = PolledTopic[JointState](
            self, JointState, 'joint_commands', QoSProfile(depth=1)
        )
        offer(self, 'push', self._push)
        offer(self, 'reset', self._reset)
        self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._steady_start = time.monotonic_ns()
        self._stop = Event()
        self._thread = Thread(target=self._run, name='plant', daemon=True)
        self._thread.start()
        self.get_logger().info(f'{plant.name}, unit {plant.unit_number}, on {interface} {channel}')

    def _declare_pushes(self) -> None:
        for name, most, text in _PUSH:
            span = FloatingPointRange(from_value=-most, to_value=most)
            descriptor = ParameterDescriptor(description=text, floating_point_range=[span])
            try:
                self.declare_parameter(name, 0.0, descriptor)
            except ParameterException as error:
                raise InputError(f'parameter {name}: {error}') from error

    def stop(self) -> None:
        """Stop the plant and leave the bus."""
        self._stop.set()
        self._thread.join()
        self._bus.close()

    def _run(self) -> None:
        self._steady_start = time.monotonic_ns()
        self._follow_ros_time()
        try:
            self.plant.run(self._stop)
        except Exception as error:
            if self.context.ok():
                self.done.set_exception(error)  # which `run_node` raises with its traceback

    def _follow_ros_time(self) -> None:
        elapsed = time.monotonic_ns() - self._steady_start
        self._publisher.start_ns = self.get_clock().now().nanoseconds - elapsed

    def _hand_on(self, samples: InstrumentReadings) -> None:
        """Publish a block of samples and take the command that came during it."""
        self._publisher.publish(samples)
        command = self._commands.newest()
        if command is not None:
            self._command(command)

    def _command(self, message: JointState) -> None:
        try:
            self.plant.command(
                joint_command(
                    self._joints,
                    message.name,
                    message.position,
                    message.velocity,
                    message.effort,
                    self._absent,
                )
            )
        except ValueError as error:
            self._faults.warning(f'joint_commands ignored: {error}')

    def _push(self) -> tuple[bool, str]:
        if not self.plant.simulation.world.floating:
            return False, 'a drive on a stand cannot be pushed'
        speed, direction = (float(self.get_parameter(name).value) for name, _, _ in _PUSH)
        heading = radians(direction)
        ahead = np.array([cos(heading), sin(heading), 0.0])
        velocity = speed * ahead if speed != 0.0 else random_push(self._random)
        self.plant.push(velocity)
        message = f'pushed by {velocity[0]:+.2f}, {velocity[1]:+.2f} m/s'
        self.get_logger().info(message)
        return True, message

    def _reset(self) -> tuple[bool, str]:
        self.plant.reset()
        return True, 'back to the start'

    def _report(self) -> None:
        self._follow_ros_time()
        plant, progress = self.plant, self.plant.take_progress()
        if plant.falls > self._reported:
            self._reported = plant.falls
            self.get_logger().error(f'the robot fell: {plant.down or "and is up again"}')
        self._down_seconds = self._down_seconds + 1 if plant.down else 0
        if 0 < self._reset_after_fall <= self._down_seconds:
            self.get_logger().info('resetting after the fall')
            plant.reset()
        level, text = Level.OK, 'running'
        if plant.down:
            level, text = Level.ERROR, f'fallen: {plant.down}'
        elif progress.worst > 0.1:
            level, text = Level.WARN, 'behind real time'
        elif plant.stale:
            level, text = Level.WARN, 'joint_commands are stale: drives damp'
        figures = {
            'real_time_factor': f'{progress.factor:.4f}',
            'worst_lateness_ms': f'{1e3 * progress.worst:.2f}',
            'falls': plant.falls,
            'frames_refused': self._bus.refused,
            'steps': plant.simulation.steps,
            'start_ns': self._publisher.start_ns,
            'device_clock_offset_s': self._device_clock.offset,
            'device_clock_drift_ppm': self._device_clock.drift,
        }
        self._reporter.publish(Report(level, text, figures))
