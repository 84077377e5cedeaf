"""Figure of power by meter and analyser (after the paper's Figure 2), and of the bandwidth."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from wattwalk_core.figures import OTHERS, style

from power_calibration.analyser.comparison import AnalyserComparison

Floats = NDArray[np.float64]
_SHOWN = 0.5  # s
_BLUE = {False: '#0072B2', True: '#56B4E9'}
_ORANGE = OTHERS[0]


def draw_calibration(found: AnalyserComparison, *, dark: bool = False) -> Figure:
    """Draw power of both with the residual, the transfer function, and the spectrum."""
    with style(dark) as ink:
        figure = Figure(figsize=(9, 8.2), layout='constrained')
        grid = figure.add_gridspec(3, 2, height_ratios=[1.5, 0.9, 1.2])
        top = figure.add_subplot(grid[0, :])
        below = figure.add_subplot(grid[1, :], sharex=top)
        _traces(found, top, below, ink, _BLUE[dark])
        _response(found, figure.add_subplot(grid[2, 0]), ink, _BLUE[dark])
        _spectrum(found, figure.add_subplot(grid[2, 1]), ink)
    return figure


def _traces(found: AnalyserComparison, top: Axes, below: Axes, ink: str, blue: str) -> None:
    log, rate = found.log, found.error_rate
    times, ours, true = found.powers()
    start = _busiest(times, true, rate)
    shown = (times >= start) & (times <= start + _SHOWN)
    at = times[shown] - start
    if log.watts is not None:
        fast_time = found.fit.clock.ours(log.time)
        rows = np.flatnonzero((fast_time >= start) & (fast_time <= start + _SHOWN))
        rows = rows[:: max(1, len(rows) // 6000)]
        top.plot(
            fast_time[rows] - start,
            log.watts[rows],
            color=_ORANGE,
            lw=0.7,
            label=f'analyser, {log.rate / 1000:g} kHz',
        )
    top.plot(at, true[shown], color=ink, lw=1.8, label=f'analyser at {rate:.0f} Hz')
    top.plot(at, ours[shown, 1], color=blue, lw=1.5, ls=(0, (4, 1.5)), label='ours, calibrated')
    top.set_ylabel('power [W]')
    title = f'{found.measured.drive}: our measurement and the analyser, {found.overlap:.0f} s'
    top.set_title(title, loc='left', fontsize=11)
    low, high = top.get_ylim()
    top.set_ylim(low, high + 0.16 * (high - low))
    top.legend(loc='upper right', ncols=3, frameon=False, fontsize=8)
    top.tick_params(labelbottom=False)
    below.plot(at, ours[shown, 0] - true[shown], color=OTHERS[3], lw=1.0, label='as recorded')
    below.plot(at, ours[shown, 1] - true[shown], color=blue, lw=1.2, label='calibrated')
    below.axhline(0, color=ink, lw=0.8)
    below.set_ylabel('residual [W]')
    below.set_xlabel('time [s]')
    below.set_xlim(0, _SHOWN)
    label = (
        f'residual at {rate:.0f} Hz over all: {found.before:.2f} W before, '
        f'{found.after:.2f} W after (RMS)'
    )
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
    axis.set_xlabel('frequency [Hz]')
    axis.set_ylabel('magnitude')
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
    cutoff = answer.cutoff
    if cutoff is not None:
        axis.axvspan(cutoff.low, cutoff.high, color=_ORANGE, alpha=0.35, lw=0)
        label = f'−3 dB at {cutoff.value:.0f} Hz ({cutoff.low:.0f}–{cutoff.high:.0f})'
    else:
        label = f'no −3 dB point up to {answer.reach:.0f} Hz'
    axis.text(0.03, 0.06, label, transform=axis.transAxes, fontsize=8)
    axis.set_ylim(0, 1.7)
    axis.set_xlim(0, float(answer.frequency[-1]) + 5)
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
