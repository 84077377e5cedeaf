"""Devices under measurement in a soak: drives and a bench supply that number all they send."""

import re
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import can
import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from power_daq.bus.unix_socket import UnixSocketBus
from power_recordings.messages.batch import Topic
from power_recordings.messages.samples import DriveSamples, JointSamples, Samples, SupplySamples
from power_recordings.messages.topic_columns import Columns
from power_recordings.messages.topics import KINDS
from power_recordings.reading import bag_folder
from power_recordings.reading.reader import Recording
from sim_bridge.instruments.scpi import ScpiInstrument, SupplyState, Terminals
from soak_account import BagRows
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError

_MS = 1_000_000
_DIGITS = 4  # base 100, each in the value of one drive
_POSITION, _CURRENT = 0.01, 0.1  # rad and A of one count
_VOLTS, _AMPERES = 2000, 10_000  # counts of 10 mV from 40 V, and of 10 mA
_CHUNK = 0.05  # s between looks at whether to stop


def numbered(number: int, count: int, unit: float) -> Floats:
    """Encode a number in values [count] of drives, as base-100 digits · unit in the first four."""
    values = np.zeros(count)
    values[:_DIGITS] = [number // 100**k % 100 for k in range(_DIGITS)]
    return unit * values


def numbers(values: Singles, unit: float) -> NDArray[np.int64]:
    """Decode the numbers [N] that `numbered` put into values [N, D]; −1 where there is none."""
    counts = np.rint(np.asarray(values[:, :_DIGITS], np.float64) / unit).astype(np.int64)
    whole = (counts >= 0).all(axis=1) & (counts < 100).all(axis=1)
    return np.where(whole, counts @ (100 ** np.arange(_DIGITS)), -1)


@dataclass
class Kept:
    """Samples measured in a stream: their times, and numbers of those not sent, by reason."""

    times: list[float] = field(default_factory=list)  # s, steady
    withheld: dict[str, list[int]] = field(default_factory=dict)


class SoakDrives:
    """Twelve drives at 1 kHz and 400 Hz on a Unix-socket bus that can be switched off.

    They measure on while the bus is off. Each sample carries its number: as digits in currents or
    positions, and in the frames' counters.
    """

    def __init__(self, channel: Path) -> None:
        self._description = BusDescription.load()
        self._channel = channel
        self._bus: UnixSocketBus | None = UnixSocketBus(str(channel), host=True)
        self._wanted = True
        self._dropped = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='drives', daemon=True)
        self.kept = {'electrical': Kept(), 'joints': Kept()}
        self.latest = 0.0  # s behind real time at worst
        self._count = 0

    def start(self) -> None:
        """Begin to measure and send."""
        self._begin = time.monotonic_ns()
        self._thread.start()

    def switch(self, on: bool) -> None:
        """Switch the bus on or off, from the next millisecond on."""
        self._wanted = on

    def wait_for_listener(self, seconds: float) -> bool:
        """Wait up to `seconds`, before `start`, for a client; return whether one came."""
        end = time.monotonic() + seconds
        while self._bus is not None and time.monotonic() < end:
            with suppress(can.CanError):
                self._bus.recv(0.05)
            if self._bus.statistics.connected:
                return True
        return False

    def stop(self) -> None:
        """Stop measuring; the bus stays up, so that nothing sent is lost."""
        self._stop.set()
        self._thread.join()

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()

    def marks(self) -> dict[str, int]:
        """Return the number of samples measured so far, by stream (electrical, joints)."""
        return {name: len(kept.times) for name, kept in self.kept.items()}

    def _run(self) -> None:
        while not self._stop.is_set():
            due = self._begin + self._count * _MS
            wait = due - time.monotonic_ns()
            if wait > 0:
                time.sleep(min(wait * 1e-9, _CHUNK))
                continue
            self.latest = max(self.latest, -wait * 1e-9)
            self._switch_bus()
            self._send()
            self._count += 1

    def _switch_bus(self) -> None:
        if self._wanted and self._bus is None:
            self._bus = UnixSocketBus(str(self._channel), host=True)
            self._dropped = 0
        elif not self._wanted and self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _send(self) -> None:
        bus, number = self._description, self._count
        drives = len(bus.drives)
        messages = bus.encode_sync(number, 1000 * number)
        current = numbered(number, drives, _CURRENT)
        messages += bus.encode('electrical', number, 1000 * number, np.full(drives, 48.0), current)
        if number % 100 == 0:
            messages += bus.encode(
                'temperature', number // 100, 1000 * number, np.full(drives, 40.0)
            )
        joint = 2 * number // 5 if number % 5 in (0, 3) else None
        if joint is not None:
            position = numbered(joint, drives, _POSITION)
            still = np.zeros(drives)
            messages += bus.encode('joints', joint, 2500 * joint, position, still, still)
        now = time.monotonic()
        why = self._put(messages)
        for name, index in (('electrical', number), ('joints', joint)):
            if index is not None:
                self.kept[name].times.append(now)
                if why:
                    self.kept[name].withheld.setdefault(why, []).append(index)

    def _put(self, messages: list[can.Message]) -> str:
        """Send; why nobody got it, or ''."""
        if self._bus is None:
            return 'bus off'
        self._bus.send_all(messages)
        statistics = self._bus.statistics
        if not statistics.connected:
            self._dropped = 0
            return 'nobody on the bus'
        dropped, self._dropped = self._dropped, sum(statistics.dropped)
        return 'no room in the listener' if self._dropped > dropped else ''


class SoakSupply:
    """A simulated bench supply that numbers its measurements, and can be unplugged."""

    def __init__(self) -> None:
        self.times: list[float] = []  # s, steady
        self._instrument: ScpiInstrument | None = None
        self.port = 0
        self.plug()

    @property
    def measured(self) -> int:
        """Number of answered queries for a measurement."""
        return len(self.times)

    def plug(self) -> None:
        """Power the supply on."""
        state = SupplyState(lambda: Terminals(48.0, 1.0))
        self._instrument = ScpiInstrument(state, port=self.port, send=self._answer)
        self.port = self._instrument.port

    def unplug(self) -> None:
        """Power the supply off."""
        if self._instrument is not None:
            self._instrument.close()
            self._instrument = None

    def _answer(self, question: str, answer: str) -> list[tuple[float, bytes]]:
        if question.upper().startswith('MEAS:ARR'):
            volts, amperes = divmod(self.measured, _AMPERES)
            voltage, current = 40.0 + 0.01 * (volts % _VOLTS), 0.01 * amperes
            answer = f'{voltage:.2f} V, {current:.2f} A, {voltage * current:.1f} W'
            self.times.append(time.monotonic())
        return [(0.0, answer.encode('ascii') + b'\n')]


def supply_numbers(voltage: Singles, current: Singles) -> NDArray[np.int64]:
    """Return the numbers [N] of supply samples from V [N] and A [N] (negative if drawn)."""
    volts = np.rint((np.asarray(voltage, np.float64) - 40.0) / 0.01).astype(np.int64)
    amperes = np.rint(-np.asarray(current, np.float64) / 0.01).astype(np.int64)
    return volts * _AMPERES + amperes


STREAMS = {'electrical': 'drive_supply', 'joints': 'joint_states', 'supply': 'supply'}
_CAME = r'(?:all |places \()(\d+) (?:samples of drive_supply )?came'
_LOST = r'drive_supply lost (\d+) samples'


def rows(
    path: Path, begun: dict[str, int], ended: dict[str, int], how: str, said: str
) -> dict[str, BagRows]:
    """Return the rows of a bag by stream; those of an absent stream are empty.

    begun, ended: counts of the devices by stream; how: as of `BagRows`; said: the recorder's
    output.
    """
    raw, kept, lost = _raw(path), _kept(path), told_lost(said)
    found = {}
    for stream, topic in STREAMS.items():
        samples = raw.get(topic)
        electrical = samples if isinstance(samples, DriveSamples) else None
        found[stream] = BagRows(
            path.name,
            _numbers(samples),
            begun[stream],
            ended[stream],
            how,
            kept.get(topic, 0),
            None if electrical is None else electrical.sequence.astype(np.int64),
            None if electrical is None else electrical.device_time.astype(np.int64),
            told_came(said, topic),
            lost if stream == 'electrical' else None,
        )
    return found


def messages(path: Path) -> int:
    """Return the number of messages in a bag."""
    return sum(len(batch.offsets) for batch in bag_folder.find(path).batches([], {}))


def _numbers(samples: Samples | None) -> NDArray[np.int64]:
    if isinstance(samples, DriveSamples):
        return numbers(samples.current, _CURRENT)
    if isinstance(samples, JointSamples):
        return numbers(samples.position, _POSITION)
    if isinstance(samples, SupplySamples):
        return supply_numbers(samples.voltage, samples.current)
    return np.zeros(0, np.int64)


def _raw(path: Path) -> dict[str, Samples]:
    """Streams of a bag before anything is cut out of them."""
    columns: dict[str, Columns] = {}
    topics: dict[str, Topic] = {}
    for batch in bag_folder.find(path).batches([], topics):
        name = batch.topic.name.rsplit('/', 1)[-1]
        if name in STREAMS.values():
            kind = KINDS[name]
            if name not in columns:
                columns[name] = Columns(name, kind.type_name, kind.paths)
            columns[name].add(batch)
    return {name: KINDS[name].build(found) for name, found in columns.items() if found.blocks}


def _kept(path: Path) -> dict[str, int]:
    """Samples by topic that a reader gives out."""
    try:
        recording = Recording.open(path)
    except InputError:
        return {}
    return {
        topic: len(getattr(recording, topic)())
        for topic in STREAMS.values()
        if recording.has(topic)
    }


def told_came(said: str, topic: str) -> int | None:
    """Return how many samples of a topic came by the recorder's output; None if not stated."""
    words = _CAME if topic == 'drive_supply' else rf'^/?{topic} +(\d+) messages'
    found = re.search(words, said, re.MULTILINE)
    return int(found[1]) if found else None


def told_lost(said: str) -> int | None:
    """Return lost samples of drive_supply by the recorder's output; None if not stated."""
    if re.search(_CAME, said) is None:
        return None
    found = re.search(_LOST, said)
    return int(found[1]) if found else 0
