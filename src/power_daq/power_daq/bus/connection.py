"""Opening a CAN bus of any python-can interface."""

from dataclasses import dataclass
from typing import Any

import can
from wattwalk_core.errors import InputError

_KERNEL_CONFIGURED = ('socketcan', 'virtual', 'unixsocket')
_OVERHEAD_ARBITRATION_BITS = 29
_OVERHEAD_DATA_BITS = 34
_CLASSICAL_OVERHEAD_BITS = 47
_STUFFING = 1.1


@dataclass(frozen=True)
class BusSettings:
    """Interface, channel and bit rates (bit/s) of a bus.

    socketcan has its bit rates from the network interface (`ip link set … dbitrate …`); there
    they only serve to compute the bus load. fd: whether frames are CAN FD ones.
    """

    interface: str = 'socketcan'
    channel: str = 'can0'
    bitrate: int = 1_000_000
    data_bitrate: int = 5_000_000
    fd: bool = True

    def __post_init__(self) -> None:
        if self.interface not in can.VALID_INTERFACES:
            known = ', '.join(sorted(can.VALID_INTERFACES))
            raise InputError(f'unknown CAN interface {self.interface!r}; there are {known}')
        if not self.channel:
            raise InputError("channel is empty; give the name of the bus, such as 'can0'")

    def open(self) -> can.BusABC:
        """Open the bus for receiving.

        Raises can.CanError or OSError if it is not there (yet), InputError for wrong settings.
        """
        rates: dict[str, Any] = {}
        channel: str | int = self.channel
        is_configured = self.interface in _KERNEL_CONFIGURED
        if not is_configured:
            rates = {'bitrate': self.bitrate}
            if self.fd:
                rates['data_bitrate'] = self.data_bitrate
            channel = int(channel) if self.channel.isdecimal() else channel
        try:
            return can.Bus(
                interface=self.interface,
                channel=channel,
                ignore_config=True,
                fd=self.fd or is_configured,
                **rates,
            )
        except can.CanInterfaceNotImplementedError as error:
            raise InputError(
                f'CAN interface {self.interface!r} cannot be used: {error}'
            ) from error
        except (ValueError, TypeError) as error:
            raise InputError(
                f'CAN interface {self.interface!r} does not accept channel '
                f'{self.channel!r}: {error}'
            ) from error

    def load(self, frames: float, payload_bytes: float) -> float:
        """Return the approximate bus load, 0 … 1, of frames and payload bytes per second."""
        if not self.fd:
            bits = frames * _CLASSICAL_OVERHEAD_BITS + 8 * payload_bytes
            return _STUFFING * bits / self.bitrate
        arbitration = frames * _OVERHEAD_ARBITRATION_BITS / self.bitrate
        data = (frames * _OVERHEAD_DATA_BITS + 8 * payload_bytes) / self.data_bitrate
        return _STUFFING * (arbitration + data)
