"""An emulated EtherCAT segment in a process of its own, told over a pipe what to do."""

from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from sim_bridge.instruments.ethercat.controller import SlaveController
from sim_bridge.instruments.ethercat.terminals import EK1100, EL3102, EmulatedSegment


class Peer:
    """
    The far end of a cable: a coupler and terminals with inputs in V.

    kinds: 'EK1100', 'EL3102', or a product code to be found instead of EL3102.
    """

    def __init__(self, interface: str, kinds: tuple[str | int, ...]) -> None:
        context = get_context('spawn')
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_run, args=(interface, kinds, far))
        self._process.start()
        self.ask('hello')

    @property
    def pid(self) -> int | None:
        """Process id."""
        return self._process.pid

    def ask(self, what: str, *arguments: Any) -> Any:
        """Do something with the segment, and wait until it is done."""
        self._pipe.send((what, arguments))
        if not self._pipe.poll(120.0):
            raise TimeoutError(f'the emulated segment does not answer {what}')
        return self._pipe.recv()

    def close(self) -> None:
        """End the process."""
        self.ask('close')
        self._process.join(60.0)


class _Segment:
    def __init__(self, interface: str, kinds: tuple[str | int, ...]) -> None:
        self.volts = {place: (0.0, 0.0) for place in range(len(kinds))}
        slaves = [self._slave(place, kind) for place, kind in enumerate(kinds)]
        self.segment = EmulatedSegment(interface, slaves)

    def _slave(self, place: int, kind: str | int) -> SlaveController:
        if kind == 'EK1100':
            return EK1100()
        product = {} if kind == 'EL3102' else {'product': int(kind)}
        return EL3102(lambda: self.volts[place], **product)

    def hello(self) -> None:
        pass

    def set_volts(self, place: int, first: float, second: float) -> None:
        self.volts[place] = first, second

    def set_present(self, place: int, present: bool) -> None:
        """Without power, or with it again: then it has forgotten everything."""
        slave = self.segment.slaves[place]
        if present:
            slave.power_on()
        slave.present = present

    def set_plugged(self, plugged: bool) -> None:
        self.segment.plugged = plugged

    def set_fault(self, place: int, name: str, value: bool) -> None:
        slave = self.segment.slaves[place]
        assert isinstance(slave, EL3102)
        setattr(slave.faults, name, value)

    def states(self) -> list[int]:
        return [slave.state for slave in self.segment.slaves]

    def object(self, place: int, index: int, subindex: int) -> bytes:
        slave = self.segment.slaves[place]
        assert isinstance(slave, EL3102)
        return slave.objects[index, subindex]


def _run(interface: str, kinds: tuple[str | int, ...], pipe: Connection) -> None:
    peer = _Segment(interface, kinds)
    while True:
        what, arguments = pipe.recv()
        if what == 'close':
            peer.segment.close()
            pipe.send(None)
            return
        pipe.send(getattr(peer, what)(*arguments))
