"""Synchronisation as one HTML page that needs no network."""

from pathlib import Path

from power_recordings.alignment.filters import gain, smoothing
from wattwalk_core.pages.embedded_figure import embedded
from wattwalk_core.pages.page import Page, escape

from power_calibration.timing.figure import draw_timing
from power_calibration.timing.summary import FREQUENCIES_SHOWN, GRID, Summary
from power_calibration.timing.tables import (
    DRIVE_COLUMNS,
    STREAM_COLUMNS,
    drive_rows,
    stream_rows,
)


def write_timing_page(path: Path, found: Summary) -> None:
    """Write verdict, figure and tables."""
    page = Page(f'Synchronisation of {found.recording}')
    page.add(f'<h1>{escape(page.title)}</h1>')
    page.text(found.verdict)
    page.add(
        embedded(
            lambda dark: draw_timing(found, dark=dark),
            'delays, errors by shift, stamps, smoothing',
        )
    )
    page.heading('By drive')
    page.text(
        'Delay of electrical stamps against joint stamps, and the change of power by shifts in '
        'both directions (RMS, and share of the standard deviation of power).'
    )
    page.table(DRIVE_COLUMNS, drive_rows(found), numbers=range(1, len(DRIVE_COLUMNS)))
    page.heading('By stream')
    page.table(STREAM_COLUMNS, stream_rows(found), numbers=range(1, len(STREAM_COLUMNS)))
    page.heading('Gain of the smoothing of Section II-A')
    taps = smoothing(GRID)
    page.table(
        ('frequency [Hz]', 'gain'),
        [(f'{f:g}', f'{100 * abs(gain(taps, f, GRID)):.1f} %') for f in FREQUENCIES_SHOWN],
        numbers=(0, 1),
    )
    for problem in found.problems:
        page.text(problem, faint=True)
    page.write(path)
