"""Figure of power by meter and analyser (after the paper's Figure 2), and of the bandwidth."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from wattwalk_core.arrays import Floats
from wattwalk_core.figures import BLUE, OTHERS, embedded, save_figure, style
from wattwalk_core.pages.page import Page, escape

from power_calibration.analyser.comparison import AnalyserComparison
from power_calibration.analyser.reference_fit import IntervalEstimate

COLUMNS = ('', 'value', '95 % from', 'to')
_UNITS = {'voltage': 'V', 'current': 'A'}


def rows(found: AnalyserComparison) -> list[tuple[str, str, str, str]]:
    """Return quantity, value and limits of the 95 % interval for all that was fitted."""
    table = []
    for name, channel in found.channels.items():
        table.append((f'{name} gain', *_texts(channel.gain, 5)))
        cells = ('0 (held)', '', '') if channel.fixed else _texts(channel.offset, 5)
        table.append((f'{name} offset [{_UNITS[name]}]', *cells))
    offset = found.time_offset
    half = 0.5e6 * (offset.high - offset.low)
    table.append(('time offset [s]', f'{offset.value:.6f}', f'±{half:.1f} µs', ''))
    table.append(('drift of its clock [ppm]', *_texts(found.drift_ppm, 2)))
    if (answer := found.response) is not None:
        none = (f'none up to {answer.reach:.0f}', '', '')
        cells = none if answer.cutoff is None else _texts(answer.cutoff, 0)
        table.append(('our bandwidth, −3 dB [Hz]', *cells))
    return table


def calibration_sentences(found: AnalyserComparison) -> list[str]:
    """Return sentences on the errors of power before and after, and power above our bandwidth."""
    (before, after), (mean_before, mean_after) = found.errors
    text = [
        f'Error of power at {found.error_rate:.0f} Hz: {before:.3f} W RMS as recorded '
        f'(mean {mean_before:+.3f} W), {after:.3f} W calibrated '
        f'(mean {mean_after:+.3f} W), over {found.fit.seconds:.1f} s; '
        f'correlation {min(found.fit.correlation):.5f}.'
    ]
    if found.loss is not None:
        lost = found.loss
        share = 100.0 * (lost.rms / lost.total) ** 2
        above = (
            f'Above {lost.above:.0f} Hz the analyser measures {lost.rms:.2f} W RMS that we miss, '
            f'{share:.2g} % of the variance'
        )
        if lost.mean is not None:
            above += f'; it carries {1000.0 * lost.mean:+.1f} mW on average'
        text.append(above + '.')
    return text


def _texts(value: IntervalEstimate, digits: int) -> tuple[str, str, str]:
    low, middle, high = (f'{x:.{digits}f}' for x in (value.low, value.value, value.high))
    return middle, low, high


_SHOWN = 0.5  # s
_ORANGE = OTHERS[0]


def draw_calibration(found: AnalyserComparison, *, dark: bool = False) -> Figure:
    """Draw power by meter and analyser, the residual, the transfer function, and the spectrum."""
    with style(dark) as ink:
        figure = Figure(figsize=(9, 8.2), layout='constrained')
        grid = figure.add_gridspec(3, 2, height_ratios=[1.5, 0.9, 1.2])
        top = figure.add_subplot(grid[0, :])
        below = figure.add_subplot(grid[1, :], sharex=top)
        _traces(found, top, below, ink, BLUE[dark])
        _response(found, figure.add_subplot(grid[2, 0]), ink, BLUE[dark])
        _spectrum(found, figure.add_subplot(grid[2, 1]), ink)
    return figure


def _traces(found: AnalyserComparison, top: Axes, below: Axes, ink: str, blue: str) -> None:
    log, rate = found.log, found.error_rate
    times, ours, true = found.powers
    start = _busiest(times, true, rate)
    shown = (times >= start) & (times <= start + _SHOWN)
    at = times[shown] - start
    if log.watts is not None:
        fast_time = found.fit.clock.ours(log.time)
        rows = np.flatnonzero((fast_time >= start) & (fast_time <= start + _SHOWN))
        rows = rows[:: max(1, len(rows) // 6000)]
        label = f'analyser, {log.rate / 1000:g} kHz'
        top.plot(fast_time[rows] - start, log.watts[rows], color=_ORANGE, lw=0.7, label=label)
    top.plot(at, true[shown], color=ink, lw=1.8, label=f'analyser at {rate:.0f} Hz')
    top.plot(at, ours[shown, 1], color=blue, lw=1.5, ls=(0, (4, 1.5)), label='ours, calibrated')
    top.set_ylabel('power [W]')
    title = f'{found.measured.drive}: our measurement and the analyser, {found.fit.seconds:.0f} s'
    top.set_title(title, loc='left', fontsize=11)
    low, high = top.get_ylim()
    top.set_ylim(low, high + 0.16 * (high - low))
    top.legend(loc='upper right', ncols=3, frameon=False, fontsize=8)
    top.tick_params(labelbottom=False)
    below.plot(at, ours[shown, 0] - true[shown], color=OTHERS[3], lw=1.0, label='as recorded')
    below.plot(at, ours[shown, 1] - true[shown], color=blue, lw=1.2, label='calibrated')
    below.axhline(0, color=ink, lw=0.8)
    below.set(ylabel='residual [W]', xlabel='time [s]', xlim=(0, _SHOWN))
    before, after = found.errors[0]
    label = f'residual at {rate:.0f} Hz over all: {before:.2f} W before, {after:.2f} W after (RMS)'
    below.set_title(label, loc='left', fontsize=9)
    low, high = below.get_ylim()
    below.set_ylim(low, high + 0.3 * (high - low))
    below.legend(loc='upper right', ncols=2, frameon=False, fontsize=8)


def _busiest(times: Floats, true: Floats, rate: float) -> float:
    """Return the start of the interval in which power varies most; of those alike, the middle."""
    width = max(2, round(_SHOWN * rate))
    count = len(true) // width
    if count < 2:
        return float(times[0])
    spread = true[: count * width].reshape(count, width).std(axis=1)
    spread = np.where(np.isfinite(spread), spread, -1.0)
    good = np.flatnonzero(spread >= 0.9 * spread.max())
    return float(times[int(good[len(good) // 2]) * width])


def _response(found: AnalyserComparison, axis: Axes, ink: str, blue: str) -> None:
    answer = found.response
    axis.set_title('our current relative to the analyser’s', loc='left', fontsize=10)
    axis.set(xlabel='frequency [Hz]', ylabel='magnitude')
    if answer is None:
        axis.text(0.5, 0.5, 'recording too short', transform=axis.transAxes, ha='center')
        return
    good = answer.coherence > 0.5
    axis.errorbar(
        answer.frequency[good],
        answer.magnitude[good],
        2.0 * answer.error[good],
        fmt='o',
        ms=3,
        color=blue,
        elinewidth=0.8,
        label='magnitude, coherence over 0.5',
    )
    axis.plot(answer.frequency, answer.coherence, color=OTHERS[1], lw=1.0, label='coherence')
    axis.axhline(np.sqrt(0.5), color=ink, lw=0.8, ls=':')
    label = f'no −3 dB point up to {answer.reach:.0f} Hz'
    if (cutoff := answer.cutoff) is not None:
        axis.axvspan(cutoff.low, cutoff.high, color=_ORANGE, alpha=0.35, lw=0)
        label = f'−3 dB at {cutoff.value:.0f} Hz ({cutoff.low:.0f}–{cutoff.high:.0f})'
    axis.text(0.03, 0.06, label, transform=axis.transAxes, fontsize=8)
    axis.set(ylim=(0, 1.7), xlim=(0, float(answer.frequency[-1]) + 5))
    axis.legend(loc='upper right', frameon=False, fontsize=8)


def _spectrum(found: AnalyserComparison, axis: Axes, ink: str) -> None:
    axis.set_title('power above our bandwidth', loc='left', fontsize=10)
    axis.set_xlabel('frequency [Hz]')
    lost = found.loss
    if lost is None:
        axis.text(0.5, 0.5, 'log too slow', transform=axis.transAxes, ha='center')
        return
    some = slice(1, None, max(1, len(lost.frequency) // 4000))
    frequency, density = lost.frequency[some], np.sqrt(lost.spectrum[some])
    axis.loglog(frequency, density, color=ink, lw=0.8)
    above = frequency > lost.above
    axis.fill_between(
        frequency[above], density[above], density.min(), color=_ORANGE, alpha=0.6, lw=0
    )
    axis.axvline(lost.above, color=_ORANGE, lw=1.5)
    axis.set_ylabel('analyser [W/√Hz]')
    label = f'{lost.rms:.2f} of {lost.total:.1f} W RMS\nabove {lost.above:.0f} Hz'
    if lost.mean is not None:
        label += f';\n{1000 * lost.mean:+.1f} mW of the mean'
    axis.text(0.97, 0.95, label, transform=axis.transAxes, fontsize=8, ha='right', va='top')


def write_calibration(path: Path, found: AnalyserComparison) -> None:
    """Write the figure or, for .html, a page with errors, figure, corrections, and method."""
    if path.suffix != '.html':
        save_figure(draw_calibration(found), path)
        return
    page = Page(f'Calibration of {found.measured.drive}')
    page.add(f'<h1>{escape(page.title)}</h1>')
    for sentence in calibration_sentences(found):
        page.text(sentence)
    page.add(
        embedded(lambda dark: draw_calibration(found, dark=dark), 'our power over the analyser’s')
    )
    page.heading('Corrections')
    page.table(COLUMNS, rows(found), numbers=(1, 2, 3))
    page.text(
        'True value = gain · measured + offset. The time offset, added to the analyser’s time in '
        'the middle of the overlap, gives the time of the recording. Drift is positive if the '
        'analyser’s clock runs too fast.'
    )
    page.heading('Method')
    page.text(
        f'{found.measured.path} and {found.log.path} ({len(found.log.time)} rows at '
        f'{found.log.rate:g} Hz) were aligned by correlation; then time offset, drift, gains and '
        'offsets were fitted together. Intervals (95 %) are those of a jackknife that leaves out '
        f'one of {found.fit.blocks} consecutive blocks at a time, so that errors within a block '
        'may be correlated.'
    )
    for note in found.notes:
        page.text(note, faint=True)
    page.text(
        'The DAQ node applies the calibration file given as -p calibration:=FILE.', faint=True
    )
    page.write(path)
