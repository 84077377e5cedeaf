"""State of the acquisition from a CAN bus for `diagnostics`: a sentence and figures."""

import time
from collections.abc import Mapping

from wattwalk_core.nodes.diagnostics import CountChanges, Level, Report, faults

from power_daq.acquisition.bus_acquisition import Acquisition, BusState, SampleQueue
from power_daq.acquisition.receiver import Interleaver
from power_daq.bus.connection import BusSettings
from power_daq.bus.description import BusDescription

_RATE_SLACK = 0.02
_NAMED = 4
_FAULTS = (
    *(
        ' lost',
        ' missing',
        ' jumps',
        ' duplicates',
        ' dropped unpublished',
        ' not finite',
        ' refused',
    ),
    *(
        'queries unsent',
        'error frames',
        'malformed packets',
        'wrong length',
        'unknown',
        'steps of the system clock',
    ),
)


class BusHealth:
    """Reports on an acquisition, by the changes of its counts since the report before."""

    def __init__(
        self,
        acquisition: Acquisition,
        queue: SampleQueue,
        description: BusDescription,
        settings: BusSettings,
    ) -> None:
        self._acquisition = acquisition
        self._queue = queue
        self._description = description
        self._settings = settings
        self._changes = CountChanges()
        self._interleavers = {
            name: assembler
            for name, assembler in acquisition.receiver.assemblers.items()
            if isinstance(assembler, Interleaver)
        }
        self._on_receipt = bool(self._interleavers)

    def _counts(self) -> dict[str, float]:
        receiver = self._acquisition.receiver
        counts: dict[str, float] = {
            name.replace('_', ' '): value for name, value in vars(receiver.counts).items()
        }
        for name, assembler in receiver.assemblers.items():
            counts[f'{name} samples'] = assembler.received
            counts[f'{name} lost'] = assembler.lost
            counts[f'{name} duplicates'] = assembler.duplicates
            counts[f'{name} counter jumps'] = assembler.counter_jumps
            counts[f'{name} unsettled'] = receiver.unsettled[name]
            counts[f'{name} not finite'] = receiver.not_finite[name]
            counts[f'{name} dropped unpublished'] = self._queue.refused[name]
            counts[f'{name} published'] = self._queue.published[name]
            for slot, missing in enumerate(assembler.missing):
                if missing:
                    frame = self._description.groups[name].frames[slot]
                    counts[f'{frame.name} missing'] = missing
        counts['steps of the system clock'] = receiver.ros_time.steps
        for name, clock in receiver.clocks.items():
            counts[f'clock {name} jumps'] = clock.epoch
        if self._description.polled is not None and self._acquisition.queries is not None:
            counts['queries'] = self._acquisition.queries.sent
            counts['queries unsent'] = self._acquisition.queries.unsent
            for register, count in self._description.polled.refused.items():
                counts[f'{register} refused'] = count
        counts['times opened'] = self._acquisition.opened
        return counts

    def report(self, now: float) -> Report:
        """Return the state since the report before; now in s on a steady clock."""
        counts = self._counts()
        news, span = self._changes.since_last(counts, now)
        rates = {}
        if span > 0:
            groups = self._description.groups
            rates = {name: news[f'{name} samples'] / span for name in groups}
        figures = {'bus': f'{self._settings.interface} {self._settings.channel}'}
        figures['bus state'] = self._acquisition.state.value
        if span > 0:
            load = self._settings.load(news['frames'] / span, news['payload bytes'] / span)
            figures['bus load [%]'] = f'{100 * load:.1f}'
        figures |= {f'{name} rate [Hz]': f'{rate:.1f}' for name, rate in rates.items()}
        figures |= self._clock_figures()
        figures |= {name: f'{value:.0f}' for name, value in counts.items()}
        figures['samples waiting'] = str(len(self._queue))
        receiver = self._acquisition.receiver
        for key, count in receiver.unknown_ids.most_common(_NAMED):
            figures[f'unknown id {key & 0x1FFFFFFF:#x}'] = str(count)
        for what, count in receiver.wrong_lengths.most_common(_NAMED):
            figures[f'wrong length {what}'] = str(count)
        level, sentence = self._judge(news, rates)
        return Report(level, sentence, figures)

    def _clock_figures(self) -> dict[str, str]:
        figures = {}
        for name, clock in self._acquisition.receiver.clocks.items():
            figures[f'clock {name} offset [s]'] = f'{clock.offset:.6f}'
            figures[f'clock {name} drift [ppm]'] = f'{-1e6 * clock.drift:.2f}'
            figures[f'clock {name} mean delay [us]'] = f'{1e-3 * clock.delay_mean:.0f}'
            figures[f'clock {name} worst delay [us]'] = f'{1e-3 * clock.delay_worst:.0f}'
        if self._on_receipt:
            groups = ', '.join(self._interleavers)
            figures['stamps'] = f'{groups}: on receipt, the device sends no time'
        offset = self._acquisition.receiver.ros_time.offset
        figures['ROS minus steady time [s]'] = f'{1e-9 * offset:.6f}'
        return figures

    def _judge(self, news: Mapping[str, float], rates: Mapping[str, float]) -> tuple[Level, str]:
        state = self._acquisition.state
        if state is BusState.ABSENT:
            return Level.ERROR, f'bus absent: {self._acquisition.absence}'
        found = faults(news, lambda name: name.endswith(_FAULTS))
        if state is BusState.SILENT:
            instead = f', but {found}' if found else ''
            sentence = f'bus silent: no frame of the mapping comes{instead}{self._unknown_nodes()}'
            return Level.ERROR, sentence
        if silent := self._silent_frames():
            return Level.WARN, f'no frames of {silent}{self._unknown_nodes()}'
        if found:
            return Level.WARN, f'in the last second: {found}'
        for name, rate in rates.items():
            nominal = self._description.groups[name].rate
            if nominal >= 100 and abs(rate - nominal) > _RATE_SLACK * nominal:
                return Level.WARN, f'{name} at {rate:.0f} Hz, not {nominal:.0f} Hz'
        return Level.OK, 'measuring' + (', stamped on receipt' if self._on_receipt else '')

    def _silent_frames(self) -> str:
        """Frames without device clock that do not come, with the comment that the DBC has."""
        now = time.monotonic_ns()
        found: dict[str, None] = {}
        for name, interleaver in self._interleavers.items():
            frames = self._description.groups[name].frames
            for slot in interleaver.merger.silent(now):
                # A drive without thermistor sends no temperature.
                if name != 'temperature' or interleaver.merger.seen(slot):
                    note = ' '.join((frames[slot].message.comment or '').split())
                    found[frames[slot].name + (f' ({note})' if note else '')] = None
        more = f' and {len(found) - _NAMED} more' if len(found) > _NAMED else ''
        return ', '.join([*found][:_NAMED]) + more

    def _unknown_nodes(self) -> str:
        """Nodes that frames come from and that the mapping does not name."""
        nodes = self._description.nodes
        unknown = self._acquisition.receiver.unknown_ids
        if nodes is None or not unknown:
            return ''
        heard = sorted({(key & 0x1FFFFFFF) >> nodes.shift for key in unknown})
        known = ', '.join(f'{drive}={number}' for drive, number in nodes.drives.items())
        return f'; frames come from node {", ".join(map(str, heard))}, the drives are {known}'
