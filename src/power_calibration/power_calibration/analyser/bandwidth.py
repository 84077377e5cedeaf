"""Bandwidth of the meter against a reference, and the power above it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from power_recordings.alignment.filters import low_pass
from scipy.signal import csd, welch
from wattwalk_core.arrays import Floats

from power_calibration.analyser.curve import Curve
from power_calibration.analyser.log import Log
from power_calibration.analyser.reference_fit import Clock, IntervalEstimate

_SEGMENT = 1024  # samples of ours
_BINS = 8  # joined to one point
_COHERENT = 0.5
_ORDER = 3
_DRAWS = 300
_HALF = np.sqrt(0.5)


@dataclass(frozen=True)
class Response:
    """Transfer function from the reference to our meter in F bands, 1 for slow signals."""

    frequency: Floats  # Hz [F]
    magnitude: Floats  # [F]
    error: Floats  # standard deviation of the magnitude [F]
    coherence: Floats  # [F]
    cutoff: IntervalEstimate | None  # Hz, −3 dB; None if there is none up to `reach`
    reach: float  # Hz, highest frequency at which the two are coherent


@dataclass(frozen=True)
class Loss:
    """Power of the reference above a frequency.

    above: Hz; rms: W, of power above it; total: W, RMS of all alternating power; mean: W, of the
    product of fast voltage and fast current, None where the log has not both.
    """

    above: float
    rms: float
    total: float
    mean: float | None
    frequency: Floats  # Hz [F], of the spectrum
    spectrum: Floats  # W²/Hz [F], of the reference's power


def response_of_drive(ours: Curve, reference: Curve, clock: Clock) -> Response | None:
    """Estimate the transfer function from a reference's signal to ours; None if too short.

    Both curves hold one signal, unfiltered.
    A reference of at least 2.5 times our rate is used up to 0.45 of our rate, a slower one up to a
    tenth of its own. Rows of the analyser may be samples or means over their period: the −3 dB
    point is midway between both hypotheses, and its interval covers both. At 336 Hz they differ
    by 0.05 % of magnitude for a log of 20 kHz, 0.7 % at 5 kHz and 3 % at 2.5 kHz. The averaging by
    `Curve.of` is known and removed.

    Spectra by Welch over whole stretches, in bands of 8 bins where the coherence is above 0.5; the
    magnitude's error is √((1 − γ²)/(2 n γ²)) (Bendat and Piersol, Random Data). A cubic in f²
    through log magnitude, weighted by the errors, gives the −3 dB point. Its interval is that of
    300 redraws within the errors, which are widened to the scatter about the cubic (periodic
    motion has lines that alias onto each other).
    """
    rate = 1.0 / ours.period
    fast = reference.period < 0.4 / rate
    limit = 0.45 * rate if fast else 0.1 * min(rate, 1.0 / reference.period)
    smooth = reference
    if fast:  # flat to 0.9 of half our rate, nothing from 1.1 of it
        smooth = reference.filtered(low_pass(1.0 / reference.period, 0.45 * rate, 0.55 * rate))
    sums: list[Floats] = []
    count = 0.0
    for time, values in ours.runs:
        shown = smooth.at(clock.reference(time))[:, 0]
        good = np.flatnonzero(np.isfinite(shown))
        if len(good) < 2 * _SEGMENT:
            continue
        rows = slice(int(good[0]), int(good[-1]) + 1)
        x, y = shown[rows], values[rows, 0]
        if not np.isfinite(x).all():
            continue
        frequency, cross = csd(x, y, rate, nperseg=_SEGMENT)
        weight = len(x) / _SEGMENT
        spectra = (welch(signal, rate, nperseg=_SEGMENT)[1] for signal in (x, y))
        sums.append(weight * np.array([cross, *spectra]))
        count += 1.5 * weight
    if not sums:
        return None
    cross, first, second = np.sum(sums, axis=0) / count
    usable = (frequency > 1.0) & (frequency < limit)
    bands = np.array_split(np.flatnonzero(usable), max(1, int(usable.sum()) // _BINS))
    points = []
    for band in bands:
        phase = np.exp(1j * np.angle(cross[band]))
        sxy = np.abs((cross[band] / phase).sum())
        sxx, syy = float(first[band].real.sum()), float(second[band].real.sum())
        middle = float((frequency[band] * first[band].real).sum() / sxx)
        points.append((middle, sxy / sxx, min(sxy**2 / (sxx * syy), 1.0 - 1e-9)))
    f, magnitude, coherence = np.array(points).T
    error = magnitude * np.sqrt((1.0 - coherence) / (2.0 * count * coherence))
    error = np.hypot(error, magnitude * _aliased(reference, f, rate)) if fast else error
    if_means = np.sinc(f * reference.period)  # the reference's gain, and if its rows are samples
    if_samples = if_means / np.sinc(f * reference.period / reference.rows)
    slow = f <= max(40.0, float(f[0]))
    weights = 1.0 / np.maximum(error[slow], 1e-4) ** 2
    slow_gain = float((magnitude[slow] * weights).sum() / weights.sum())
    gains = np.array([if_samples, if_means]) / slow_gain
    samples, means = gains * magnitude
    (first_cut, reach), (second_cut, further) = (
        _cutoff(f, gain * magnitude, gain * error, coherence) for gain in gains
    )
    return Response(
        frequency=f,
        magnitude=0.5 * (samples + means),
        error=np.hypot(gains[0] * error, 0.5 * (samples - means)),
        coherence=coherence,
        cutoff=_both([first_cut, second_cut], max(reach, further)),
        reach=reach,
    )


def _both(cutoffs: Sequence[IntervalEstimate | None], reach: float) -> IntervalEstimate | None:
    """Return an estimate whose interval covers all that are known; reach: where others lie, Hz."""
    known = [one for one in cutoffs if one is not None]
    if not known:
        return None
    ends = [reach if one is None else one.high for one in cutoffs]
    middle = sum(one.value for one in known) / len(known)
    return IntervalEstimate(middle, min(one.low for one in known), max(ends))


def _aliased(reference: Curve, frequency: Floats, rate: float) -> Floats:
    """Return the amplitude that our sampling aliases onto each frequency, relative to its own."""
    longest = max(reference.runs, key=lambda run: len(run[0]))[1][:, 0]
    size = min(len(longest), round(_SEGMENT / (rate * reference.period)))
    at, power = welch(longest, 1.0 / reference.period, nperseg=size)
    smooth = np.convolve(power, np.ones(_BINS) / _BINS, 'same')
    there, above = np.interp(frequency, at, smooth), np.interp(rate - frequency, at, smooth)
    return np.sqrt(above / there) * frequency / (rate - frequency)


def _cutoff(
    frequency: Floats, magnitude: Floats, error: Floats, coherence: Floats
) -> tuple[IntervalEstimate | None, float]:
    """Return the −3 dB point, from bands that are coherent, and their highest frequency, Hz."""
    good = (coherence > _COHERENT) & (magnitude > 0.05)
    reach = float(frequency[good].max(initial=0.0))
    if good.sum() < _ORDER + 2:
        return None, reach
    f, m = frequency[good], magnitude[good]
    relative = np.maximum(error[good] / m, 0.003)
    unit = (f / reach) ** 2
    powers = np.stack([unit**n for n in range(1, _ORDER + 1)], axis=1) / relative[:, None]
    dense = np.linspace(0.0, 1.0, 1001)
    shape = np.stack([dense ** (2 * n) for n in range(1, _ORDER + 1)], axis=1)

    def crossing(logs: Floats) -> float:
        answer = np.exp(shape @ np.linalg.lstsq(powers, logs / relative, rcond=None)[0])
        below = np.flatnonzero(answer < _HALF)
        return float(dense[below[0]] * reach) if len(below) else np.nan

    smooth = powers @ np.linalg.lstsq(powers, np.log(m) / relative, rcond=None)[0]
    rest = np.log(m) / relative - smooth
    spread = max(1.0, float(np.sqrt(np.sum(rest**2) / (len(m) - _ORDER))))
    relative, powers = relative * spread, powers / spread
    middle = crossing(np.log(m))
    if np.isnan(middle):
        return None, reach
    random = np.random.default_rng(0)
    drawn = [
        crossing(np.log(m) + relative * random.standard_normal(len(m))) for _ in range(_DRAWS)
    ]
    low, high = np.quantile(np.where(np.isnan(drawn), reach, drawn), (0.025, 0.975)).tolist()
    return IntervalEstimate(middle, low, high), reach


def loss(log: Log, above: float) -> Loss | None:
    """Return the log's power above a frequency in Hz; None if its rate is too low for that."""
    watts = log.watts
    if watts is None or 0.5 * log.rate <= above:
        return None
    longest = int(np.argmax(log.stops - log.starts))
    run = slice(int(log.starts[longest]), int(log.stops[longest]))
    size = int(min(run.stop - run.start, max(256, log.rate)))
    frequency, spectrum = welch(watts[run], log.rate, nperseg=size)
    width = float(frequency[1] - frequency[0])
    mean = None
    if log.voltage is not None and log.current is not None:
        block = max(1, round(0.5 * log.rate / above))
        rows = (run.stop - run.start) // block * block
        volts, amps = (
            values[run][:rows].reshape(-1, block) for values in (log.voltage, log.current)
        )
        mean = float((volts * amps).mean() - (volts.mean(axis=1) * amps.mean(axis=1)).mean())
    high = frequency > above
    return Loss(
        above=above,
        rms=float(np.sqrt(spectrum[high].sum() * width)),
        total=float(np.sqrt(spectrum[1:].sum() * width)),
        mean=mean,
        frequency=frequency,
        spectrum=spectrum,
    )
