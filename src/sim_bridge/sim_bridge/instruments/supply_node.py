"""Node `supply_instrument`: an emulated EA PSB 9000 on a TCP socket."""

import argparse
import time

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.nodes.running import run_node

from sim_bridge.instruments import scpi

_STALE = 0.5


class SupplyInstrumentNode(Node):
    """Node that serves the values of the topic simulated_supply, or constants without it."""

    def __init__(self) -> None:
        super().__init__('supply_instrument')
        given = DeviceParameters(self)
        host = given.text('host', '127.0.0.1', 'address to listen on')
        port = given.whole('port', 5025, 'TCP port to listen on; 0: a free one', 0, 65535)
        most = scpi.RATED_CURRENT
        self._constant = scpi.Terminals(
            given.real('voltage', 48.0, 'V, while no topic is heard', 0.0, scpi.RATED_VOLTAGE),
            given.real('current', 0.0, 'A, while no topic is heard', -most, most),
        )
        self._heard: tuple[float, scpi.Terminals] | None = None
        state = scpi.SupplyState(self.terminals)
        self._instrument = scpi.ScpiInstrument(state, host, port)
        qos = QoSProfile(depth=10)
        self.create_subscription(BatteryState, 'simulated_supply', self._hear, qos)
        self.get_logger().info(f'listening on {self._instrument.host}:{self._instrument.port}')

    def terminals(self) -> scpi.Terminals:
        """Return the newest values of the topic; constants once they are 0.5 s old."""
        heard = self._heard
        if heard is None or time.monotonic() - heard[0] > _STALE:
            return self._constant
        return heard[1]

    def _hear(self, message: BatteryState) -> None:
        self._heard = time.monotonic(), scpi.Terminals(message.voltage, -message.current)

    def stop(self) -> None:
        """Close the socket."""
        self._instrument.close()


def run(options: argparse.Namespace) -> int:
    """Run the node until Ctrl-C; 2 for bad parameters or a port that is taken."""
    return run_node(SupplyInstrumentNode, options.ros_args)
