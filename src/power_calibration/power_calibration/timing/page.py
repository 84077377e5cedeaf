"""Synchronisation as one HTML page that needs no network, and its tables."""

from pathlib import Path

import numpy as np
from power_recordings.alignment.filters import gain, smoothing
from wattwalk_core.pages.embedded_figure import embedded
from wattwalk_core.pages.page import Page, escape

from power_calibration.timing.figure import draw
from power_calibration.timing.summary import FREQUENCIES_SHOWN, GRID, SHIFTS_SHOWN, Summary

DRIVE_COLUMNS = (
    'drive',
    'late [ms]',
    '95 %',
    'R²',
    *(f'±{1e3 * shift:g} ms' for shift in SHIFTS_SHOWN),
)
STREAM_COLUMNS = ('stream', 'samples', 'rate [Hz]', 'jitter [µs]', 'p99 [µs]', 'lost')


def drive_rows(found: Summary) -> list[tuple[str, ...]]:
    """Delay of each drive, and what shifts do to its power."""
    table = []
    for item in found.delays:
        if item.delay is None:
            told = ('–', 'unknown')
        else:
            low, middle, high = (
                f'{1e3 * x:+.2f}' for x in (item.delay.low, item.delay.value, item.delay.high)
            )
            told = (middle, f'{low} to {high}')
        costs = [item.error_at(shift) for shift in SHIFTS_SHOWN]
        cells = (f'{watts:.2f} W, {percent:.1f} %' for watts, percent in costs)
        table.append((item.drive, *told, f'{item.r2:.3f}', *cells))
    return table


def stream_rows(found: Summary) -> list[tuple[str, ...]]:
    """Rate, jitter and losses of each stream."""
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


def write_page(path: Path, found: Summary) -> None:
    """Verdict, picture, tables, how it was found."""
    page = Page(f'Synchronisation of {found.recording}')
    page.add(f'<h1>{escape(page.title)}</h1>')
    page.text(found.verdict)
    page.add(embedded(lambda dark: draw(found, dark=dark), 'delays, costs, stamps, smoothing'))
    page.heading('By drive')
    page.text(
        'How late electrical stamps are against joint stamps, and by how much a shift by so many '
        'ms either way changes power (RMS, and share of its spread).'
    )
    page.table(DRIVE_COLUMNS, drive_rows(found), numbers=range(1, len(DRIVE_COLUMNS)))
    page.heading('By stream')
    page.table(STREAM_COLUMNS, stream_rows(found), numbers=range(1, len(STREAM_COLUMNS)))
    page.heading('What the smoothing of Section II-A leaves')
    taps = smoothing(GRID)
    page.table(
        ('frequency [Hz]', 'left of it'),
        [(f'{f:g}', f'{100 * abs(gain(taps, f, GRID)):.1f} %') for f in FREQUENCIES_SHOWN],
        numbers=(0, 1),
    )
    for problem in found.problems:
        page.text(problem, faint=True)
    page.write(path)


def _micro(seconds: float) -> str:
    return '–' if np.isnan(seconds) else f'{1e6 * seconds:.2f}'
