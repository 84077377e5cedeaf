"""Figure of synchronisation: errors by shift, delays, stamps, and the smoothing."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from power_recordings.alignment.filters import SMOOTHING, gain, smoothing
from wattwalk_core.arrays import Floats
from wattwalk_core.figures import BLUE, OTHERS, embedded, save_figure, style
from wattwalk_core.pages.page import Page, escape

from power_calibration.timing.delay import SHIFTS
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
    """Return the cells of DRIVE_COLUMNS for each drive."""
    table = []
    for item in found.delays:
        if item.delay is None:
            text = ('–', 'unknown')
        else:
            low, high = (f'{1e3 * limit:+.2f}' for limit in item.delay.interval)
            text = (f'{1e3 * item.delay.value:+.2f}', f'{low} to {high}')
        costs = [item.error_at(shift) for shift in SHIFTS_SHOWN]
        cells = (f'{watts:.2f} W, {percent:.1f} %' for watts, percent in costs)
        table.append((item.drive, *text, f'{item.r2:.3f}', *cells))
    return table


def stream_rows(found: Summary) -> list[tuple[str, ...]]:
    """Return the cells of STREAM_COLUMNS for each stream."""
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


_MOST_LINES = 12


def draw_timing(found: Summary, *, dark: bool = False) -> Figure:
    """Draw errors, delays, step responses (else fits), jitter, clock and smoothing."""
    with style(dark) as ink:
        figure = Figure(figsize=(9.6, 9.2), layout='constrained')
        third = _step_response if found.responses else _fits
        parts = (_cost, _delays, third, _jitter, _clock, _smoothing)
        for axis, draw in zip(figure.subplots(3, 2).flat, parts, strict=True):
            draw(found, axis, ink, BLUE[dark])
    return figure


def _name(axis: Axes, title: str, **labels: str) -> None:
    axis.set_title(title, loc='left', fontsize=10)
    axis.set(**labels)


def _by_shift(axis: Axes, shares: Sequence[Floats], what: str, ink: str, blue: str) -> None:
    """Draw shares of the deviation of power, of each drive by SHIFTS, and their median."""
    for share in shares[:_MOST_LINES]:
        axis.plot(1e3 * SHIFTS, 100 * share, color=blue, lw=0.8, alpha=0.6)
    middle = np.median(shares, axis=0)
    axis.plot(1e3 * SHIFTS, 100 * middle, color=ink, lw=1.8, label='median of the drives')
    axis.set(ylabel=f'RMS {what} [% of deviation]', ylim=(0, None))


def _cost(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    _name(axis, 'change of power by a shift', xlabel='shift of the electrical samples [ms]')
    _by_shift(axis, [d.moved / d.power for d in found.delays], 'change', ink, blue)
    axis.plot([], [], color=blue, lw=0.8, label='each drive')
    watts = float(np.median([d.power for d in found.delays]))
    scales = (lambda share: share * (watts / 100), lambda power: power * (100 / watts))
    other = axis.secondary_yaxis('right', functions=scales)
    other.set_ylabel('[W], median drive')
    axis.legend(loc='upper center', frameon=False, fontsize=8)


def _delays(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    label = 'delay [ms], interval of 95 %'
    _name(axis, 'delay of electrical stamps against joints', xlabel=label)
    known = {item.drive: item.delay for item in found.delays if item.delay is not None}
    for row, d in enumerate(known.values()):
        axis.plot([1e3 * d.low, 1e3 * d.high], [row, row], color=blue, lw=1.5)
        axis.plot(1e3 * d.value, row, 'o', color=blue, ms=5)
    common = found.common
    if common is not None:
        axis.axvspan(1e3 * common.low, 1e3 * common.high, color=OTHERS[0], alpha=0.35, lw=0)
        axis.axvline(1e3 * common.value, color=OTHERS[0], lw=1.2, label='all drives')
        axis.legend(loc='best', frameon=False, fontsize=8)
    axis.axvline(0, color=ink, lw=0.8)
    axis.set_yticks(range(len(known)), [*known], fontsize=8)
    axis.set_ylim(len(known) - 0.4, -0.6)


def _fits(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    label = 'shift from the best delay [ms]'
    _name(axis, 'error of the proxy, fitted at each shift', xlabel=label)
    _by_shift(axis, [d.refitted / d.power for d in found.delays], 'error', ink, blue)
    axis.axvline(0, color=ink, lw=0.8, ls=':')


def _step_response(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    answer = max(found.responses, key=lambda a: a.events)
    title = f'{answer.drive}: {answer.events} steps of the command, stacked'
    label = 'time after the stamp of the command [ms]'
    _name(axis, title, xlabel=label, ylabel='mean change [share of final]')
    time = 1e3 * answer.time
    axis.plot(time, answer.current, color=blue, lw=1.6, label='current, 1 kHz')
    axis.plot(time, answer.torque, color=OTHERS[3], lw=1.6, ls='--', label='torque, 400 Hz')
    axis.axvline(0, color=ink, lw=0.8)
    half = answer.current_half
    label = f'half at {1e3 * half.value:.2f} ms\n({1e3 * half.low:.2f} to {1e3 * half.high:.2f})'
    axis.text(0.03, 0.95, label, transform=axis.transAxes, va='top', fontsize=8)
    axis.legend(loc='lower right', frameon=False, fontsize=8)


def _jitter(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    label = 'standard deviation, and (pale) 99th percentile [µs]'
    _name(axis, 'jitter of the stamps, and losses', xlabel=label)
    rows = found.stamps
    for row, stream in enumerate(rows):
        width = [stream.spread, stream.worst - stream.spread]
        width = [1e6 * max(0.0, w) if np.isfinite(w) else 0.0 for w in width]
        axis.barh(row, width[0], color=blue, height=0.6)
        axis.barh(row, width[1], left=width[0], color=blue, alpha=0.35, height=0.6)
        lost = 'none lost' if not stream.lost else f'{stream.lost} lost'
        axis.text(sum(width), row, f'  {lost}', va='center', fontsize=8, color=ink)
    axis.set_yticks(range(len(rows)), [f'{s.topic}\n{s.rate:.0f} Hz' for s in rows], fontsize=8)
    axis.set_ylim(len(rows) - 0.4, -0.6)
    axis.set_xlim(0, 1.35 * max(axis.get_xlim()[1], 1.0))


def _clock(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    clock, title = found.clock, 'no device clock in the recording'
    if clock is not None:
        title = f'device clock to stamps: {clock.drift:+.1f} ppm, ±{1e6 * clock.spread:.2f} µs'
    _name(axis, title, xlabel='time [s]', ylabel='stamp − line [µs]')
    if clock is None:
        return
    every = slice(None, None, max(1, len(clock.time) // 4000))
    axis.plot(clock.time[every], 1e6 * clock.jitter[every], color=blue, lw=0.7)
    most = max(1.0, 1.1e6 * float(np.abs(clock.jitter).max()))
    axis.set_ylim(-most, most)


def _smoothing(found: Summary, axis: Axes, ink: str, blue: str) -> None:
    taps = smoothing(GRID)
    frequency = np.linspace(0.0, 120.0, 601)
    answer = np.abs([gain(taps, f, GRID) for f in frequency])
    title = f'Savitzky-Golay, {len(taps)} samples at 400 Hz'
    _name(axis, title, xlabel='frequency [Hz]', ylabel='gain [dB]')
    axis.plot(frequency, 20 * np.log10(np.maximum(answer, 1e-4)), color=blue, lw=1.4)
    ripple = abs(gain(taps, 50.0, GRID))
    level = 20 * np.log10(max(ripple, 1e-4))
    axis.plot(50.0, level, 'o', color=OTHERS[3], ms=6)
    label = f'gain at 50 Hz: {100 * ripple:.1f} %'
    axis.annotate(label, (50.0, level), (56.0, level + 8), fontsize=8, color=ink)
    axis.axhline(-3, color=ink, lw=0.8, ls=':')
    axis.axvline(SMOOTHING, color=OTHERS[0], lw=1.2, label='12.5 Hz')
    axis.set(ylim=(-60, 5), xlim=(0, 120))
    axis.legend(loc='upper right', frameon=False, fontsize=8)


def write_timing(path: Path, found: Summary) -> None:
    """Write the figure or, for .html, a page with verdict, figure and tables."""
    if path.suffix != '.html':
        save_figure(draw_timing(found), path)
        return
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
