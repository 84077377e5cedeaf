"""Readings of a supply as sensor_msgs/BatteryState, with negative current while it supplies."""

from math import nan

from rclpy.publisher import Publisher
from sensor_msgs.msg import BatteryState

from power_daq.supply.answers import Reading

_S = 1_000_000_000


def empty_battery() -> BatteryState:
    """Return a message of which only voltage and current are to be set."""
    message = BatteryState()
    for name in ('temperature', 'charge', 'capacity', 'design_capacity', 'percentage'):
        setattr(message, name, nan)
    message.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    message.present = True
    return message


class BatteryPublisher:
    """Publishes readings; the message object is reused, since publishing serialises it."""

    def __init__(self, publisher: Publisher, frame_id: str, location: str) -> None:
        self._publisher = publisher
        self._message = empty_battery()
        self._message.header.frame_id = frame_id
        self._message.location = location

    def publish(self, reading: Reading, serial_number: str) -> None:
        """Publish a reading with a battery's sign of current."""
        message = self._message
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(reading.stamp, _S)
        message.voltage, message.current = reading.voltage, -reading.current
        message.serial_number = serial_number
        message.power_supply_status = (
            BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
            if reading.current >= 0
            else BatteryState.POWER_SUPPLY_STATUS_CHARGING
        )
        self._publisher.publish(message)
