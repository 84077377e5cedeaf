"""Follows /clock where `use_sim_time` says so."""

from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rosgraph_msgs.msg import Clock as ClockMsg

from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

CLOCK_TOPIC = '/clock'
USE_SIM_TIME_NAME = 'use_sim_time'


class TimeSource:
    """Sets a node's ROS clock from /clock while its parameter use_sim_time is true."""

    def __init__(self, node: Any, clock: ROSClock):
        self._node = node
        self._clock = clock
        self._subscription: Any = None
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        self._activate(node.get_parameter(USE_SIM_TIME_NAME).value)
        node.add_on_set_parameters_callback(self._on_set)

    def _activate(self, enabled: bool) -> None:
        if enabled == self._clock.ros_time_is_active:
            return
        self._clock._set_ros_time_is_active(enabled)
        if enabled:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._subscription = self._node.create_subscription(
                ClockMsg, CLOCK_TOPIC, self._on_clock, qos
            )
        elif self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        for timer in self._node.timers:
            if timer.clock is self._clock:
                timer._jumped()

    def _on_clock(self, message: Any) -> None:
        self._clock.set_ros_time_override(Time.from_msg(message.clock, ClockType.ROS_TIME))

    def _on_set(self, parameters: list[Parameter]) -> Any:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME_NAME:
                if parameter.type_ is not Parameter.Type.BOOL:
                    reason = f'{USE_SIM_TIME_NAME} parameter set to something besides a bool'
                    return SetParametersResult(successful=False, reason=reason)
                self._activate(parameter.value)
        return SetParametersResult(successful=True)
