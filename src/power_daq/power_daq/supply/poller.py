"""The thread that polls a bench supply at a fixed rate and connects again after a loss."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from wattwalk_core.nodes.diagnostics import CountChanges, Level, LogTarget, Report, faults
from wattwalk_core.worker import DeviceWorker

from power_daq.clock.mapping import RosTime, Slots
from power_daq.supply.answers import (
    AnswerError,
    InstrumentIdentity,
    Reading,
    ScpiError,
    SupplyMeasurement,
)
from power_daq.supply.energy_counters import Balance, Energy
from power_daq.supply.instrument import Instrument, LostError

_S = 1_000_000_000
_CHECK = 1.0


@dataclass
class PollCounts:
    """Numbers of events since the start; all but readings and connections are faults."""

    readings: int = 0
    connections: int = 0
    connections_lost: int = 0
    not_an_answer: int = 0
    power_disagrees: int = 0
    instrument_errors: int = 0


@dataclass
class PollState:
    """State of the instrument; absence: the reason why it is not connected, empty if it is."""

    identity: InstrumentIdentity | None = None
    absence: str = 'not connected yet'
    last_errors: Sequence[ScpiError] = ()
    last_garbage: str = ''
    worst_round_trip: float = 0.0
    counts: PollCounts = field(default_factory=PollCounts)


class Poller(DeviceWorker):
    """Polls `rate` times a second and gives each answer to the sink once.

    Readings belong to slots of 1/rate s. A slot without an answer is lost; it is neither repeated
    nor made up for. connect may raise LostError or AnswerError: it is tried again after pauses in
    s, each twice the one before, from the first to the last of `pauses`. prepare is called once,
    with the first connection, and not again if it fails. All exceptions but these two end the
    thread and are raised by `join`, any of prepare included.
    """

    def __init__(
        self,
        connect: Callable[[], Instrument],
        sink: Callable[[Reading], None],
        rate: float,
        log: LogTarget,
        pauses: tuple[float, float] = (0.1, 5.0),
        prepare: Callable[[Instrument], None] | None = None,
    ) -> None:
        self.state = PollState()
        self._connect, self._sink, self._log = connect, sink, log
        self._prepare = prepare
        self._slots = Slots(1.0 / rate)
        self.ros_time = RosTime()
        self._next_check = 0.0
        super().__init__('supply', *pauses)

    @property
    def lost(self) -> int:
        """Slots without a reading since the first reading."""
        return self._slots.lost(self.state.counts.readings)

    @property
    def _given(self) -> int:
        return self.state.counts.connections

    def _serve_once(self) -> None:
        try:
            instrument = self._connect()
        except (LostError, AnswerError) as error:
            if str(error) != self.state.absence:
                self._log.warning(f'supply absent, will try again: {error}')
            self.state.absence = str(error)
            return
        try:
            prepare, self._prepare = self._prepare, None
            if prepare is not None:
                prepare(instrument)
            self._serve(instrument)
        finally:
            instrument.close()

    def _serve(self, instrument: Instrument) -> None:
        """Read until the connection is lost, or the end."""
        state = self.state
        try:
            state.identity, state.absence = instrument.identity, ''
            state.counts.connections += 1
            who = instrument.identity
            self._log.info(f'reading {who.model} of {who.maker}, serial number {who.serial}')
            self._read(instrument)
        except (LostError, AnswerError) as error:
            state.counts.connections_lost += 1
            state.absence = str(error)
            self._log.warning(f'supply lost, will try again: {error}')

    def _read(self, instrument: Instrument) -> None:
        self._next_check = time.monotonic() + _CHECK
        for _ in self._slots.each(self._stop):
            try:
                self._take(instrument)
                self._check(instrument)
            except AnswerError as error:
                self.state.counts.not_an_answer += 1
                self.state.last_garbage = str(error)
                instrument.resynchronise()

    def _take(self, instrument: Instrument) -> None:
        before = time.monotonic_ns()
        found = instrument.measure()
        after = time.monotonic_ns()
        self.ros_time.follow(after)
        middle = (before + after) // 2
        trip = (after - before) / _S
        state = self.state
        state.worst_round_trip = max(state.worst_round_trip, trip)
        state.counts.readings += 1
        state.counts.power_disagrees += _disagrees(found)
        stamp = self.ros_time.of(middle)
        self._sink(Reading(stamp, middle, found.voltage, found.current, found.power, trip))

    def _check(self, instrument: Instrument) -> None:
        """Empty the error queue once a second; this also detects answers out of step."""
        if time.monotonic() < self._next_check:
            return
        self._next_check += _CHECK
        if errors := instrument.errors():
            self.state.counts.instrument_errors += len(errors)
            self.state.last_errors = errors

    def take_worst_round_trip(self) -> float:
        """Return the longest round trip since the last call, s."""
        worst, self.state.worst_round_trip = self.state.worst_round_trip, 0.0
        return worst


def _disagrees(found: SupplyMeasurement) -> bool:
    """Return whether the supply's power is further from V·I than even during a load step."""
    if found.power is None:
        return False
    product = found.voltage * found.current
    return abs(found.power - product) > 5.0 + 0.5 * max(abs(product), abs(found.power))


_RATE_SLACK = 0.02
_MISSING_POWER = 0.02
_LEAST_MISSING = 5.0
_SECONDS_FOR_VERDICT = 10
_LONGEST_NAMES = 4


class SupplyHealth:
    """Reports on a poller, by the changes of its counts since the report before."""

    def __init__(self, poller: Poller, rate: float, resource: str) -> None:
        self._poller, self._rate, self._resource = poller, rate, resource
        self._changes = CountChanges()

    def report(self, now: float, energy: Energy, balance: Balance | None) -> Report:
        """Return the state since the report before; now in s on a steady clock."""
        state = self._poller.state
        counts = {name.replace('_', ' '): n for name, n in vars(state.counts).items()}
        counts['readings lost'] = self._poller.lost
        news, span = self._changes.since_last(counts, now)
        figures = {'instrument': self._resource}
        if state.identity is not None:
            figures['identity'] = ', '.join(state.identity)
        rate = news['readings'] / span if span > 0 else None
        if rate is not None:
            figures['rate [Hz]'] = f'{rate:.1f}'
        worst = 1e3 * self._poller.take_worst_round_trip()
        figures['worst round trip [ms]'] = f'{worst:.2f}'
        figures |= {name: str(count) for name, count in counts.items()}
        if state.last_errors:
            figures['last instrument errors'] = '; '.join(map(str, state.last_errors))
        if state.last_garbage:
            figures['last that was no answer'] = state.last_garbage
        figures |= {
            'energy [J]': f'{energy.joule:.1f}',
            'energy [Wh]': f'{energy.watt_hours:.4f}',
            'energy counted over [s]': f'{energy.seconds:.2f}',
            'energy not counted for [s]': f'{energy.uncounted:.2f}',
            **_balance_figures(balance),
        }
        return Report(*self._judge(news, rate, balance), figures)

    def _judge(
        self, news: Mapping[str, float], rate: float | None, balance: Balance | None
    ) -> tuple[Level, str]:
        state = self._poller.state
        if state.absence:
            return Level.ERROR, f'supply absent: {state.absence}'
        if found := faults(news, lambda name: name not in ('readings', 'connections')):
            sentence = f'in the last second: {found}'
            if news['instrument errors'] and state.last_errors:
                sentence += f' ({state.last_errors[-1]})'
            return Level.WARN, sentence
        if rate is not None and rate < (1 - _RATE_SLACK) * self._rate:
            return Level.WARN, f'supply at {rate:.0f} Hz, not {self._rate:.0f} Hz'
        if balance is not None and balance.seconds >= _SECONDS_FOR_VERDICT:
            least = -max(_LEAST_MISSING, _MISSING_POWER * abs(balance.drives))
            if balance.rest_mean < least:
                return Level.WARN, (
                    f'the drives draw {-balance.rest_mean:.1f} W more than the supply gives: '
                    'check signs, gains and which supply feeds them'
                )
        return Level.OK, 'measuring'


def _balance_figures(balance: Balance | None) -> dict[str, str]:
    if balance is None:
        return {'drives compared': 'none: no drive_supply in the same seconds'}
    names = ', '.join(balance.names[:_LONGEST_NAMES])
    more = len(balance.names) - _LONGEST_NAMES
    return {
        'drives compared': f'{len(balance.names)}: {names}{", …" if more > 0 else ""}',
        'supply, mean of 1 s [W]': f'{balance.supply:.2f}',
        'drives, mean of 1 s [W]': f'{balance.drives:.2f}',
        'supply minus drives (electronics), mean of 1 s [W]': f'{balance.rest:.2f}',
        'supply minus drives (electronics), mean of 30 s [W]': f'{balance.rest_mean:.2f}',
        'seconds in the mean': str(balance.seconds),
    }
