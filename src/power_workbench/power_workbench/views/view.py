"""One model on the recordings, as arrays for a page."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.recordings import LeftOut, Loaded
from power_lab.compare.comparison import Comparison, describe_state
from power_lab.compare.regimes import standstill, worst_stretch
from wattwalk_core.arrays import Floats, Singles

from power_workbench.views.pyramid import Pyramid

_SHORTEST = 0.16  # s of a period
_LONGEST = 4.0
_ALIKE = 0.5  # least correlation of the positions with those of a period before
_AS_GOOD = 0.92  # share of the best correlation, at which a shorter period is taken
_BAND = 0.3  # of the stride's frequency, standard deviation of the filter
_STILL = 0.25  # share of the usual amplitude, below which there is no stride
_FEWEST = 5  # periods


@dataclass(frozen=True)
class StridePhase:
    """Phase of each row in the stride, 0 to 1, NaN where nothing strides; or why there is none."""

    phase: Singles | None = None
    period: float = 0.0  # s
    drive: int = 0  # whose position is largest at phase 0
    reason: str = ''


def stride_phase(position: Singles, slots: NDArray[np.int64]) -> StridePhase:
    """Find the period at which positions rad [N, D] on slots of 20 ms repeat, and the phase in it.

    The period is the shortest whose correlation is about the best; the phase is that of the
    drive that repeats with the largest amplitude, in a band about the frequency, so that it
    follows a cadence that changes.
    """
    if not len(slots):
        return StridePhase(reason='there is no position')
    spread = _on_slots(position, slots)
    longest = min(round(_LONGEST * REDUCED_RATE), len(spread) // _FEWEST)
    shortest = round(_SHORTEST * REDUCED_RATE)
    if longest <= shortest + 2 or not spread.any():
        return StridePhase(reason='the recording is too short, or nothing moves in it')
    each = _correlations(spread, longest + 1)
    total = each.sum(axis=1) / max(float(each[0].sum()), 1e-12)
    inner = total[shortest : longest + 1]
    peaks = shortest + 1 + np.flatnonzero((inner[1:-1] >= inner[:-2]) & (inner[1:-1] > inner[2:]))
    best = float(total[peaks].max()) if len(peaks) else 0.0
    if best < _ALIKE:
        return StridePhase(reason='the motion does not repeat itself, so that there is no stride')
    lag = int(peaks[total[peaks] >= _AS_GOOD * best][0])
    drive = int(np.argmax(each[lag]))
    wave = _band(spread[:, drive], 1.0 / lag)[slots]
    phase = (np.angle(wave) / (2 * np.pi)) % 1.0
    size = np.abs(wave)
    phase[size < _STILL * np.median(size)] = np.nan
    return StridePhase(phase.astype(np.float32), lag / REDUCED_RATE, drive)


def _on_slots(position: Singles, slots: NDArray[np.int64]) -> Floats:
    """Positions without their means [length, D]; zero in the gaps."""
    known = np.isfinite(position)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, position, 0.0).sum(axis=0, dtype=np.float64) / count
    out = np.zeros((int(slots[-1]) + 1, position.shape[1]))
    out[slots] = np.where(known, position - mean, 0.0)
    return out


def _correlations(values: Floats, lags: int) -> Floats:
    """Autocovariance of each column at lags 0 to lags − 1, [lags, D]."""
    size = 1 << (len(values) + lags).bit_length()
    spectra = np.fft.rfft(values, size, axis=0)
    found: Floats = np.fft.irfft(np.abs(spectra) ** 2, size, axis=0)[:lags]
    return found


def _band(values: Floats, frequency: float) -> NDArray[np.complex128]:
    """Analytic signal in a band about a frequency (cycles a sample)."""
    size = 1 << len(values).bit_length()
    spectrum = np.fft.fft(values, size)
    at = np.fft.fftfreq(size)
    weight = np.exp(-0.5 * ((at - frequency) / (_BAND * frequency)) ** 2) * (at > 0)
    return 2.0 * np.fft.ifft(spectrum * weight)[: len(values)]


_LONGEST_GAP = 60.0  # s, that is shown as long as it was
BETWEEN = 2.0
"""S that are shown between two recordings."""


@dataclass(frozen=True)
class StateWords:
    """Word for each row and drive, kept as the index into the few texts that occur."""

    texts: tuple[str, ...]
    places: NDArray[np.int32] | NDArray[np.uint8]  # [N, D]

    @classmethod
    def of(cls, words: NDArray[np.str_]) -> 'StateWords':
        """Index words [N, D] by the texts that occur."""
        texts: list[str] = []
        places = np.full(words.shape, -1, np.int32)
        while (places < 0).any():
            texts.append(str(words.flat[np.argmax(places < 0)]))
            places[words == texts[-1]] = len(texts) - 1
        return cls(tuple(texts), places.astype(np.uint8) if len(texts) < 256 else places)

    def rows(self, text: str, column: int) -> NDArray[np.bool_]:
        """Mark the rows [N] of a drive, by its column, that have the word `text`."""
        if text not in self.texts:
            return np.zeros(len(self.places), bool)
        return np.asarray(self.places[:, column] == self.texts.index(text))


@dataclass(frozen=True)
class PowerView:
    """Measured power, the model's residual and the state of the drives, at 50 Hz.

    N rows lie on `slots` of 20 ms in the order in which they are shown; slots without a row are
    gaps. M meters are the drives, or the robot. `content` is what `compare --json` writes of this
    one model, empty without a model.
    """

    meters: tuple[str, ...]
    drives: tuple[str, ...]
    recordings: tuple[str, ...]
    slots: NDArray[np.int64]  # [N], ascending
    recording: NDArray[np.int32]  # [N]
    measured: Singles  # W [N, M]
    noise: Singles  # W [M]
    still: tuple[float, ...]  # rad/s [D], below which a drive is at rest
    residual: Singles | None = None  # measured − estimated, W [N, M], held out
    state: Mapping[str, Singles] = field(default_factory=dict)  # [N, D]
    words: Mapping[str, StateWords] = field(default_factory=dict)
    content: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] | None = None
    share: float = 1.0  # of the recordings that was read
    time: Floats = field(default_factory=lambda: np.empty(0))  # s [N], since the first sample
    left_out: tuple[LeftOut, ...] = ()

    @property
    def length(self) -> int:
        """Number of slots from the first to the last row."""
        return int(self.slots[-1]) + 1 if len(self.slots) else 0

    def spans(self, start: float, stop: float) -> list[LeftOut]:
        """Return the parts of the recordings that are shown from start to stop, s."""
        seconds, found = self.slots / REDUCED_RATE, []
        for number in range(len(self.recordings)):
            own = (self.recording == number) & (seconds >= start) & (seconds < stop)
            if own.any() and len(self.time):
                times = self.time[own].min(), self.time[own].max() + 1.0 / REDUCED_RATE
                found.append(LeftOut(number, *(round(float(one), 2) for one in times)))
        return found

    @property
    def hidden(self) -> list[tuple[float, float]]:
        """Spans (start, stop), s as they are shown, in which the recordings are left out."""
        found = []
        for span in self.left_out:
            own = (self.recording == span.recording) & (self.time >= span.start)
            own &= self.time < span.stop
            if own.any():
                slots = self.slots[own]
                found.append((slots[0] / REDUCED_RATE, (slots[-1] + 1) / REDUCED_RATE))
        return found

    @property
    def errors(self) -> dict[str, float]:
        """Held-out RMS error of the model by meter, W, where there is one."""
        judged = self.content.get('drives', {})
        return {name: own['rmse_w'] for name, own in judged.items() if own['rmse_w'] is not None}

    @property
    def seconds(self) -> float:
        """Length as it is shown, s."""
        return self.length / REDUCED_RATE

    def spread(self, values: Singles) -> Singles:
        """Return values of the rows [N, …] on their slots [length, …], NaN in the gaps."""
        out = np.full((self.length, *values.shape[1:]), np.nan, np.float32)
        out[self.slots] = values
        return out

    @cached_property
    def traces(self) -> Mapping[str, Pyramid]:
        """Measured, estimate, error (estimate − measured): W by meter, the sum as last column."""
        out = {'measured': self.measured}
        if self.residual is not None:
            out |= {'estimate': self.measured - self.residual, 'error': -self.residual}
        return {name: Pyramid(self.spread(with_sum(values))) for name, values in out.items()}

    @cached_property
    def worst(self) -> tuple[float, float]:
        """Span (start, stop), s as shown, of the largest error, without a model of most power."""
        if self.share < 1.0:
            return 0.0, self.seconds
        values = self.measured if self.residual is None else self.residual
        rows = np.sqrt(np.nansum(np.square(values, dtype=np.float64), axis=1))
        slots = self.slots[worst_stretch(rows)]
        return float(slots[0]) / REDUCED_RATE, float(slots[-1]) / REDUCED_RATE

    @cached_property
    def stride(self) -> StridePhase:
        """Phase of the motion, or the reason why it does not repeat itself."""
        if 'position' not in self.state:
            return StridePhase(reason='there is no position')
        return stride_phase(self.state['position'], self.slots)


def with_sum(values: Singles) -> Singles:
    """Return values [N, M] with their sum as a last column, NaN where one of them is."""
    total = values.sum(axis=1, keepdims=True, dtype=np.float32)
    return np.concatenate([values, total], axis=1)


def slots_of(prepared: Prepared) -> NDArray[np.int64]:
    """Return the slot [N] of each row: recordings in turn, long gaps shortened to a minute."""
    step = np.diff(prepared.time, prepend=prepared.time[:1])
    another = np.diff(prepared.recording, prepend=prepared.recording[:1]) != 0
    step = np.where(another, BETWEEN, np.clip(step, 0.0, _LONGEST_GAP))
    places = np.rint(np.cumsum(step) * REDUCED_RATE).astype(np.int64)
    # Two rows never share a slot, though their times may be a little less than a slot apart.
    ordered: NDArray[np.int64] = np.maximum.accumulate(places - np.arange(len(places)))
    return ordered + np.arange(len(places))


def measured_view(loaded: Loaded, prepared: Prepared) -> PowerView:
    """Return the view of recordings without a model."""
    state, words = describe_state(prepared, loaded)
    return _view(prepared, loaded, prepared.power_at(0.0), state, words)


def judged_view(comparison: Comparison, loaded: Loaded, model: Mapping[str, Any]) -> PowerView:
    """Return the view of a comparison's first model; model: its content in words."""
    judged, content = comparison.models[0], comparison.json()
    shown = {
        **content['models'][0],
        'seconds': content['seconds'],
        'sensor_noise_w': content['sensor_noise_w'],
        'both_sides': [line for one in content['both_sides'].values() for line in one['text']],
    }
    view = _view(comparison.prepared, loaded, judged.measured, comparison.state, comparison.labels)
    residual = judged.residual.astype(np.float32)
    return replace(view, residual=residual, content=shown, model=model)


def _view(
    prepared: Prepared,
    loaded: Loaded,
    measured: Floats,
    state: Mapping[str, Floats],
    words: Mapping[str, NDArray[np.str_]],
) -> PowerView:
    scale, data = prepared.signals.scale, loaded.data
    first = [data.time[data.recording == one].min() for one in range(len(data.recordings))]
    return PowerView(
        meters=prepared.names,
        drives=prepared.signals.names,
        recordings=prepared.recordings,
        slots=slots_of(prepared),
        recording=prepared.recording,
        measured=measured.astype(np.float32),
        state={
            name: values.astype(np.float32)
            for name, values in state.items()
            if np.isfinite(values).any() and np.ptp(values[np.isfinite(values)]) > 0
        },
        words={name: StateWords.of(own) for name, own in words.items()},
        noise=prepared.noise.astype(np.float32),
        still=tuple(standstill(scale, drive) for drive in range(len(prepared.signals.names))),
        time=prepared.time - np.asarray(first)[prepared.recording],
        left_out=loaded.left_out,
    )
