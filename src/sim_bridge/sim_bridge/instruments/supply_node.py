"""Node `supply_instrument`: a simulated bench supply on a TCP socket, as an EA PSB 9000 speaks."""

import argparse
import sys
import time
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import BatteryState
from wattwalk_core.command import command
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node

from sim_bridge.instruments.scpi import (
    RATED_CURRENT,
    RATED_VOLTAGE,
    ScpiInstrument,
    SupplyState,
    Terminals,
)

_STALE = 0.5
_EXAMPLE = """
example, a constant load:
  ros2 run sim_bridge supply_instrument --ros-args -p voltage:=48.0 -p current:=3.0
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
example, what the simulated robot draws (its own supply goes to another topic):
  ros2 run sim_bridge sim --ros-args -r supply:=simulated_supply
  ros2 run sim_bridge supply_instrument
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
"""


class SupplyInstrumentNode(Node):
    """Shows on its socket what the topic simulated_supply says, or constants without it."""

    def __init__(self) -> None:
        super().__init__('supply_instrument')
        given = DeviceParameters(self)
        host = given.text('host', '127.0.0.1', 'address to listen on')
        port = given.whole('port', 5025, 'TCP port to listen on; 0: a free one', 0, 65535)
        self._constant = Terminals(
            given.real('voltage', 48.0, 'V, while no topic is heard', 0.0, RATED_VOLTAGE),
            given.real(
                'current', 0.0, 'A, while no topic is heard', -RATED_CURRENT, RATED_CURRENT
            ),
        )
        self._heard: tuple[float, Terminals] | None = None
        self._instrument = ScpiInstrument(SupplyState(self.terminals), host, port)
        self.create_subscription(
            BatteryState, 'simulated_supply', self._hear, QoSProfile(depth=10)
        )
        self.get_logger().info(f'listening on {self._instrument.host}:{self._instrument.port}')

    def terminals(self) -> Terminals:
        """What flows now: the newest of the topic, constants once it is 0.5 s old."""
        heard = self._heard
        if heard is None or time.monotonic() - heard[0] > _STALE:
            return self._constant
        return heard[1]

    def _hear(self, message: BatteryState) -> None:
        self._heard = time.monotonic(), Terminals(message.voltage, -message.current)

    def stop(self) -> None:
        """Close the socket."""
        self._instrument.close()


@command
def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a port that is taken."""
    parser = argparse.ArgumentParser(
        prog='ros2 run sim_bridge supply_instrument',
        description='A simulated bench supply that speaks SCPI over TCP, to try power_daq supply '
        'without hardware.',
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    arguments = sys.argv[1:] if args is None else list(args)
    parser.parse_args(remove_ros_args(arguments))
    return run_node(SupplyInstrumentNode, arguments)
