"""An EtherCAT segment on a network interface, driven by pysoem (SOEM)."""

import importlib
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from wattwalk_core.errors import InputError

from power_daq.ethercat.terminals import SegmentError, SlaveIdentity

_US = 1_000_000
_STATE_TIMEOUT = 2.0
_MAILBOX_TIMEOUT = 0.7
_OPERATE_FRAMES = 200


def longest_call(slaves: int, timeout: float) -> float:
    """Return the longest time in s of a call of SoemSegment; timeout: s until a frame is lost.

    Sum of SOEM's limits: state and mailbox (both directions) of each slave, two states of the
    whole segment, and the frames in between.
    """
    state = max(_STATE_TIMEOUT, 20 * timeout)
    mailbox = max(_MAILBOX_TIMEOUT, 20 * timeout)
    return slaves * (state + 2 * mailbox) + 2 * state + 2 * (_OPERATE_FRAMES + 1) * timeout


class SoemSegment:
    """The slaves behind one network interface; needs the right to raw sockets.

    Slaves are counted from 0, which is next to the master.
    timeout: s until a frame counts as lost; it also sets SOEM's limits, which are global to the
    process. Every call releases the GIL while it waits.
    """

    def __init__(self, interface: str, timeout: float) -> None:
        self._interface, self._timeout = interface, round(_US * timeout)
        try:
            self._soem: Any = importlib.import_module('pysoem')
        except ImportError as error:
            raise InputError(
                f'EtherCAT needs pysoem, which is not installed ({error}): '
                'pip install pysoem==1.1.13'
            ) from error
        limits = self._soem.settings.timeouts
        limits.ret = self._timeout
        for name in ('safe', 'eeprom', 'tx_mailbox', 'rx_mailbox', 'state'):
            setattr(limits, name, max(getattr(limits, name), 20 * self._timeout))
        self._mailbox_timeout = max(round(_US * _MAILBOX_TIMEOUT), 20 * self._timeout)
        self._master: Any = None

    def find(self) -> Sequence[SlaveIdentity]:
        """Open the interface and return the slaves' identities; SegmentError if none answers."""
        master = self._soem.Master()
        master.sdo_read_timeout = master.sdo_write_timeout = self._mailbox_timeout
        try:
            master.open(self._interface)
        except ConnectionError as error:
            raise SegmentError(self._reason()) from error
        self._master = master
        if master.config_init(release_gil=True) <= 0:
            raise SegmentError(
                f'no slave answers on {self._interface}: check cable and power of the coupler'
            )
        return [SlaveIdentity(s.man, s.id, s.rev, s.name) for s in master.slaves]

    def _reason(self) -> str:
        names = [name for _, name in socket.if_nameindex()]
        if self._interface not in names:
            return (
                f'there is no network interface {self._interface!r}; there are {", ".join(names)}'
            )
        return (
            f'{self._interface} cannot be opened: raw sockets need root, or CAP_NET_RAW and '
            'CAP_NET_ADMIN'
        )

    def read(self, slave: int, index: int, subindex: int) -> bytes:
        """Return the bytes of an object (SDO upload); SegmentError if the slave refuses."""
        with self._mailbox('read', slave, index, subindex):
            return bytes(self._master.slaves[slave].sdo_read(index, subindex, release_gil=True))

    def write(self, slave: int, index: int, subindex: int, value: bytes) -> None:
        """Write an object of a slave (SDO download) and wait for its answer.

        slave: position on the segment, from 0. value: the object's bytes, little-endian.
        SegmentError if the slave refuses or does not answer.
        """
        with self._mailbox('written', slave, index, subindex):
            self._master.slaves[slave].sdo_write(index, subindex, value, release_gil=True)

    @contextmanager
    def _mailbox(self, what: str, slave: int, index: int, subindex: int) -> Iterator[None]:
        soem = self._soem
        try:
            yield
        except (soem.SdoError, soem.MailboxError, soem.PacketError, soem.WkcError) as error:
            reason = getattr(error, 'desc', None) or 'no answer from its mailbox'
            place = f'{index:#06x}:{subindex:02x} of the slave at position {slave}'
            raise SegmentError(f'{place} cannot be {what}: {reason}') from error

    def operate(self) -> int:
        """Bring all slaves to OP; return the working counter of a complete exchange.

        Process data are mapped first. SegmentError for a slave that does not reach its state.
        """
        soem, master = self._soem, self._master
        try:
            master.config_map()
        except soem.ConfigMapError as error:
            raise SegmentError(
                f'process data cannot be mapped: {error.error_list[0]!r}'
            ) from error
        self._reach(soem.SAFEOP_STATE, 'SAFE-OP')
        master.state = soem.OP_STATE
        master.write_state()
        for _ in range(_OPERATE_FRAMES):
            self.exchange()
            if master.state_check(soem.OP_STATE, self._timeout) == soem.OP_STATE:
                return int(master.expected_wkc)
        self._reach(soem.OP_STATE, 'OP')
        return int(master.expected_wkc)

    def _reach(self, state: int, name: str) -> None:
        limit = max(round(_US * _STATE_TIMEOUT), 20 * self._timeout)
        if self._master.state_check(state, limit) == state:
            return
        self._master.read_state()
        for place, slave in enumerate(self._master.slaves):
            if slave.state != state:
                reason = self._soem.al_status_code_to_string(slave.al_status)
                raise SegmentError(
                    f'{slave.name} at position {place} does not reach {name}: state '
                    f'{slave.state:#04x}, AL status {slave.al_status:#06x} ({reason})'
                )
        raise SegmentError(f'the segment does not reach {name}')

    def exchange(self) -> int:
        """Exchange a frame of process data (LRW); return its working counter, below 0 if lost."""
        self._master.send_processdata(release_gil=True)
        return int(self._master.receive_processdata(self._timeout, release_gil=True))

    def inputs(self, slave: int) -> bytes:
        """Return a slave's inputs in the image of the last frame."""
        return bytes(self._master.slaves[slave].input)

    def close(self) -> None:
        """Bring the slaves back to INIT if they can be reached, and close the interface."""
        master, self._master = self._master, None
        if master is None:
            return
        with suppress(Exception):  # pysoem raises several kinds for slaves that are gone
            master.state = self._soem.INIT_STATE
            master.write_state()
        master.close()
