"""State of an EtherCAT segment for `diagnostics`: a sentence and figures."""

from collections.abc import Mapping

from wattwalk_core.nodes.diagnostics import Level, Report

from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.acquisition.count_changes import CountChanges
from power_daq.ethercat.acquisition import SegmentAcquisition

_RATE_SLACK = 0.02
_NO_FAULT = ('cycles', 'times operating')


class SegmentHealth:
    """Reports on an acquisition, by the changes of its counts since the report before."""

    def __init__(
        self, acquisition: SegmentAcquisition, queue: SampleQueue, interface: str
    ) -> None:
        self._acquisition, self._queue, self._interface = acquisition, queue, interface
        self._changes = CountChanges()

    def report(self, now: float) -> Report:
        """Return the state since the report before; now in s on a steady clock."""
        acquisition = self._acquisition
        counts = {name.replace('_', ' '): n for name, n in vars(acquisition.counts).items()}
        counts['cycles lost'] = acquisition.lost
        counts['samples dropped unpublished'] = self._queue.dropped
        counts['steps of the system clock'] = acquisition.ros_time.steps
        news, span = self._changes.since_last(counts, now)
        mapping = acquisition.mapping
        figures = {
            'interface': self._interface,
            'segment': ', '.join(kind.name for kind in mapping.segment),
            'segment state': acquisition.absence or 'operating',
        }
        rate = news['cycles'] / span if span > 0 else None
        if rate is not None:
            figures['electrical rate [Hz]'] = f'{rate:.1f}'
        figures |= {name: str(count) for name, count in counts.items()}
        figures['samples waiting'] = str(len(self._queue))
        return Report(*self._judge(news, rate), figures)

    def _judge(self, news: Mapping[str, float], rate: float | None) -> tuple[Level, str]:
        acquisition = self._acquisition
        if acquisition.absence:
            return Level.ERROR, f'segment absent: {acquisition.absence}'
        faults = [
            f'{count:.0f} {name}'
            for name, count in news.items()
            if count > 0 and name not in _NO_FAULT
        ]
        if faults:
            return Level.WARN, 'in the last second: ' + ', '.join(faults)
        nominal = 1.0 / acquisition.mapping.cycle
        if rate is not None and rate < (1 - _RATE_SLACK) * nominal:
            return Level.WARN, f'electrical at {rate:.0f} Hz, not {nominal:.0f} Hz'
        return Level.OK, 'measuring'
