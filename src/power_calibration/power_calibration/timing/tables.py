"""Tables of synchronisation: delays by drive, stamps by stream."""

import numpy as np

from power_calibration.timing.summary import SHIFTS_SHOWN, Summary

DRIVE_COLUMNS = (
    'drive',
    'late [ms]',
    '95 %',
    'R²',
    *(f'±{1e3 * shift:g} ms' for shift in SHIFTS_SHOWN),
)
STREAM_COLUMNS = ('stream', 'samples', 'rate [Hz]', 'jitter [µs]', 'p99 [µs]', 'lost')


def drive_rows(found: Summary) -> list[tuple[str, ...]]:
    """Return the delay of each drive, and the change of its power by shifts."""
    table = []
    for item in found.delays:
        if item.delay is None:
            text = ('–', 'unknown')
        else:
            low, middle, high = (
                f'{1e3 * x:+.2f}' for x in (item.delay.low, item.delay.value, item.delay.high)
            )
            text = (middle, f'{low} to {high}')
        costs = [item.error_at(shift) for shift in SHIFTS_SHOWN]
        cells = (f'{watts:.2f} W, {percent:.1f} %' for watts, percent in costs)
        table.append((item.drive, *text, f'{item.r2:.3f}', *cells))
    return table


def stream_rows(found: Summary) -> list[tuple[str, ...]]:
    """Return rate, jitter and losses of each stream."""
    return [
        (
            stream.topic,
            str(stream.count),
            f'{stream.rate:.2f}',
            _micro(stream.spread),
            _micro(stream.worst),
            f'{stream.lost}' + ('' if stream.by_sequence else ' (by gaps)'),
        )
        for stream in found.stamps
    ]


def _micro(seconds: float) -> str:
    return '–' if np.isnan(seconds) else f'{1e6 * seconds:.2f}'
