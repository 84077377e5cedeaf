"""The supply node: polls a bench supply for voltage and current and publishes them."""

import argparse
import time
from functools import partial

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from wattwalk_core.nodes.diagnostics import FaultLog, Reporter
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node
from wattwalk_core.nodes.services import offer

from drive_power_msgs.msg import DriveSupply
from power_daq.supply.answers import Reading
from power_daq.supply.battery import BatteryPublisher
from power_daq.supply.energy_counters import EnergyCounter, PowerBalance
from power_daq.supply.instrument import (
    LARGEST_CURRENT,
    LARGEST_VOLTAGE,
    Instrument,
    InstrumentSettings,
    OutputRequest,
)
from power_daq.supply.poller import Poller, SupplyHealth

_PERIOD = 1.0
_QUERIES = 32
_S = 1_000_000_000
_LOSSLESS = QoSProfile(depth=1000)  # reliable


class SupplyNode(Node):
    """Publishes supply and diagnostics; InputError for bad parameters."""

    def __init__(self) -> None:
        super().__init__('supply')
        given = DeviceParameters(self)
        settings = InstrumentSettings(
            given.text('host', '', 'name or IPv4 address of the supply'),
            given.whole('port', 5025, 'TCP port of its SCPI server', 1, 65535),
            given.real('timeout', 0.5, 's until an answer counts as missing', 0.02, 10.0),
            given.flag('separate_queries', False, 'MEAS:VOLT? and MEAS:CURR?, not MEAS:ARR?'),
        )
        rate = given.real('rate', 100.0, 'readings in Hz', 1.0, 200.0)
        frame_id = given.text('frame_id', 'supply', 'frame_id of supply')
        wanted = given.flag('switch_output_on', False, 'switch the output on, once, at the start')
        voltage = given.real('set_voltage', 0.0, 'V of the output', 0.0, LARGEST_VOLTAGE)
        current = given.real('set_current', 0.0, 'A, limit of the output', 0.0, LARGEST_CURRENT)
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time: readings of a supply are in system time')
        self._energy, self._balance = EnergyCounter(1.0 / rate), PowerBalance()
        publisher = self.create_publisher(BatteryState, 'supply', _LOSSLESS)
        self._battery = BatteryPublisher(publisher, frame_id, settings.resource)
        # A switching-on under way is waited for: cut off it would leave the panel locked.
        self._ending = _PERIOD + _QUERIES * settings.timeout
        prepare = partial(self._switch_on, OutputRequest(voltage, current)) if wanted else None
        log = FaultLog(self.get_logger())
        connect = partial(Instrument, settings)
        self._poller = Poller(connect, self._take, rate, log, prepare=prepare)
        self._health = SupplyHealth(self._poller, rate, settings.resource)
        self._reporter = Reporter(self, 'instrument', settings.resource)
        self.create_subscription(DriveSupply, 'drive_supply', self._take_drives, _LOSSLESS)
        offer(self, 'reset_energy', self._reset)
        self.create_timer(_PERIOD, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._poller.start()

    def _switch_on(self, request: OutputRequest, instrument: Instrument) -> None:
        self.get_logger().warning(request.switch_on(instrument))

    def _take(self, reading: Reading) -> None:
        power = reading.voltage * reading.current
        self._energy.add(reading.steady, power)
        self._balance.add_supply(reading.stamp, power)
        identity = self._poller.state.identity
        try:
            self._battery.publish(reading, '' if identity is None else identity.serial)
        except RuntimeError:
            if self.context.ok():
                raise

    def _take_drives(self, message: DriveSupply) -> None:
        drives = len(message.name)
        shape = (-1, drives)
        if not drives or len(message.voltage) % drives:
            return
        good = (np.asarray(message.status, np.uint8).reshape(shape) == 0).all(axis=1)
        ticks = np.asarray(message.device_time, np.int64)
        if not good.any() or len(ticks) != len(good):
            return
        voltage = np.asarray(message.voltage, np.float64).reshape(shape)
        power = voltage * np.asarray(message.current, np.float64).reshape(shape)
        first = message.header.stamp.sec * _S + message.header.stamp.nanosec
        stamps = first + ticks - ticks[0]
        names = tuple(message.name)
        self._balance.add_drives(stamps[good], message.header.frame_id, names, power[good])

    def _reset(self) -> tuple[bool, str]:
        counted = self._energy.reset()
        message = (
            f'{counted.joule:.1f} J ({counted.watt_hours:.4f} Wh) in {counted.seconds:.1f} s '
            'until now; counting from zero'
        )
        self.get_logger().info(message)
        return True, message

    def _diagnose(self) -> None:
        if self._poller.failed:
            self.stop()
            return
        energy, balance = self._energy.total(), self._balance.report()
        self._reporter.say(self._health.report(time.monotonic(), energy, balance))

    def stop(self) -> None:
        """End the thread; raise its error if it failed."""
        self._poller.stop()
        self._poller.join(self._ending)


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a refused output."""
    return run_node(SupplyNode, options.ros_args)
