"""Node `sim_bridge`: the simulated robot in real time behind the CAN bus of the hardware."""

import time
from threading import Event, Thread

import numpy as np
from power_daq.bus.description import BusDescription
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from wattwalk_core.nodes.diagnostics import Level, Report, Reporter
from wattwalk_core.nodes.fault_log import FaultLog
from wattwalk_core.nodes.polled_topic import PolledTopic
from wattwalk_core.nodes.services import offer

from sim_bridge.live.frames import FrameEncoder, SimulatedBus
from sim_bridge.live.joint_commands import joint_command
from sim_bridge.live.node_parameters import NodeParameters
from sim_bridge.live.publishing import SamplePublisher
from sim_bridge.live.real_time import LivePlant
from sim_bridge.offline.session import random_push
from sim_bridge.plant.simulation import Simulation
from sim_bridge.sensors.blocks import InstrumentReadings, Instruments


class SimNode(Node):
    """Node with the plant in a thread, which takes the commands; the executor serves services."""

    def __init__(self) -> None:
        super().__init__('sim_bridge')
        settings = NodeParameters.declare(self)
        self._settings = settings
        self._random = np.random.default_rng([settings.seed, 2])
        simulation = Simulation(settings.plant, settings.make_world())
        instruments = Instruments(simulation, settings.seed)
        bus = BusDescription.load(settings.dbc, settings.mapping)
        encoder = FrameEncoder(bus, simulation.joints, instruments.clock)
        self._joints = simulation.joints
        self._absent = frozenset(bus.drives) - set(simulation.joints)
        self._device_clock = instruments.clock
        self._publisher = SamplePublisher(
            self, simulation.world, instruments.clock, settings.publish_clock
        )
        self._reporter = Reporter(self, hardware_id='simulation')
        self._faults = FaultLog(self.get_logger(), 5.0)
        self._bus = SimulatedBus(settings.interface, settings.channel)
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
        self.get_logger().info(
            f'{settings.plant.name}, unit {settings.plant.unit_number}, on '
            f'{settings.interface} {settings.channel}'
        )

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
        velocity = self._settings.push(self)
        if velocity is None:
            velocity = random_push(self._random)
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
        if 0 < self._settings.reset_after_fall <= self._down_seconds:
            self.get_logger().info('resetting after the fall')
            plant.reset()
        late = progress.worst > 0.1
        level, text = Level.OK, 'running'
        if plant.down:
            level, text = Level.ERROR, f'fallen: {plant.down}'
        elif late:
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
