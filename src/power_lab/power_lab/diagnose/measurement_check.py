"""Measurement check: offset, gain, bias, lag and delay with intervals."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects.fit.fitter import Fit, Fitter
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE

from power_lab.diagnose.findings import Diagnosis

Floats = NDArray[np.float64]

TERMS = (
    'time_offset',
    'power_gain',
    'current_offset',
    'torque_bias',
    'velocity_lag',
    'torque_bend',
    'offset_drift',
)
UNITS = {
    'time_offset': 's',
    'power_gain': '1',
    'current_offset': 'A',
    'torque_bias': 'N·m',
    'velocity_lag': 's',
    'torque_bend': '1',
    'offset_drift': 'A/min',
    'torque_scale': '1',
}
_DRAWS = 40
_UNKNOWN_OFFSET = np.array([-0.03, 0.03])  # A, where the idle draw takes up any offset


@dataclass(frozen=True)
class MeasurementTerm:
    """One error of the measurement: of the drive where it costs most, and of all."""

    name: str
    value: float
    interval: tuple[float, float]
    watts: float  # rms error if it is not corrected
    matters: bool
    drive: str
    drives: Mapping[str, float]
    at_bound: str = ''
    recording: str = ''  # where the term is one recording's own: that where it costs most
    recordings: Mapping[str, float] = field(default_factory=dict)  # that drive's, by recording

    def json(self) -> dict[str, object]:
        """As `diagnose --json` writes it."""
        return {
            'value': self.value,
            'interval': list(self.interval),
            'matters': self.matters,
            'unit': UNITS[self.name],
            'watts': round(self.watts, 4),
            'drive': self.drive,
            'drives': dict(self.drives),
            'at_bound': self.at_bound or None,
            'recording': self.recording or None,
            'recordings': dict(self.recordings),
        }


def check_measurement(
    diagnosis: Diagnosis,
    fitter: Fitter,
    model: EffectModel,
    *,
    other_recording: bool,
    delays: Floats | None = None,
    seed: int = 0,
) -> dict[str, MeasurementTerm]:
    """
    The terms of the best fit with 95 % intervals, by name.

    With other_recording, a change of the idle draw
    against the model's counts as current offset: at one bus voltage they are the same. delays: of
    each recording beside that of all, s [R].
    """
    fit = diagnosis.best.fit
    prepared = fitter.prepared
    intervals = fitter.intervals(fit, seed)
    found: dict[str, MeasurementTerm] = {}
    drawn = np.quantile(fitter.delay_draws(fit, _DRAWS, seed), [0.025, 0.975])
    rate = np.gradient(prepared.power_at(fit.delay), axis=0) * REDUCED_RATE
    slope = np.sqrt(np.nanmean(np.square(rate), axis=0))
    found['time_offset'] = _term(
        'time_offset',
        prepared,
        np.full(len(prepared.names), round(fit.delay, 9)),
        np.tile(np.round(drawn, 9), (len(prepared.names), 1)),
        np.abs(fit.delay) * slope,
        diagnosis.floor,
    )
    if delays is not None and delays.any():
        own = {n: _short(fit.delay + float(d)) for n, d in _named(prepared, delays)}
        found['time_offset'] = replace(found['time_offset'], recordings=own)
    for name in TERMS[1:]:
        columns = fit.structure.columns_of(name)
        if not columns:
            continue
        sizes = _sizes(fit, prepared, columns)
        costs = np.abs(fit.coefficients[:, columns]) * sizes / diagnosis.floor[:, None]
        worst = int(np.nanargmax(costs.max(axis=0)))
        column, size = columns[worst], sizes[:, worst]
        values, bounds = fit.coefficients[:, column], intervals[:, column]
        if name == 'velocity_lag':
            lag = prepared.lag.mean(keepdims=True) if prepared.whole else prepared.lag
            values, bounds = values + lag, bounds + lag[:, None]
        if name == 'current_offset' and fit.structure.columns_of('idle'):
            if other_recording and not prepared.whole:
                values, bounds = _against_idle(model, fit, prepared, values, bounds)
            else:
                bounds = bounds + _UNKNOWN_OFFSET
        term = _term(name, prepared, values, bounds, np.abs(values) * size, diagnosis.floor)
        drive = prepared.names.index(term.drive)
        found[name] = replace(term, at_bound=fit.at_bound(drive, column))
        if len(columns) > 1:
            every = _named(prepared, fit.coefficients[drive, columns])
            found[name] = replace(
                found[name],
                recording=prepared.recordings[worst],
                recordings={one: _short(float(value)) for one, value in every},
            )
    return found


def _named(prepared: Prepared, values: Floats) -> Iterator[tuple[str, float]]:
    """Recordings with their values [R]; a name that comes twice gets its number."""
    seen: set[str] = set()
    for number, (name, value) in enumerate(zip(prepared.recordings, values, strict=True)):
        one = f'{name} ({number + 1})' if name in seen else name
        seen.add(one)
        yield one, float(value)


def _sizes(fit: Fit, prepared: Prepared, columns: Sequence[int]) -> Floats:
    """W per unit [D, n] of columns, rms where they are not zero throughout a recording."""
    own = fit.design.columns[..., columns]
    square = np.nanmean(np.square(own), axis=0)
    if len(columns) == 1:
        return np.sqrt(square)
    rows = np.array([np.mean(prepared.recording == one) for one in range(len(columns))])
    return np.asarray(np.sqrt(square / np.maximum(rows, 1e-9)))


def _term(
    name: str,
    prepared: Prepared,
    values: Floats,
    bounds: Floats,
    watts: Floats,
    floor: Floats,
) -> MeasurementTerm:
    worst = int(np.nanargmax(watts / floor))
    low, high = (float(bound) for bound in bounds[worst])
    matters = bool(watts[worst] >= floor[worst] and not low <= 0.0 <= high)
    return MeasurementTerm(
        name,
        _short(float(values[worst])),
        (_short(low), _short(high)),
        float(watts[worst]),
        matters,
        prepared.names[worst],
        {drive: _short(float(v)) for drive, v in zip(prepared.names, values, strict=True)},
    )


def _short(value: float) -> float:
    return float(f'{value:.5g}')


def _against_idle(
    model: EffectModel, fit: Fit, prepared: Prepared, values: Floats, bounds: Floats
) -> tuple[Floats, Floats]:
    """Add the change of the idle draw since the model was fitted, as a current."""
    columns = fit.structure.columns_of('idle')
    if not columns or not model.fitted or 'idle' not in model.effects:
        return values, bounds
    voltage = np.median(prepared.signals.voltage, axis=0)
    values, bounds = values.copy(), bounds.copy()
    for drive, name in enumerate(prepared.names):
        for group in model.groups:
            if group.type.matches(name):
                idle = group.coefficients['idle'][0]
                offset = group.measurement.get('current_offset')
                before = idle.value + (offset.value if offset else 0.0) * voltage[drive]
                change = (fit.coefficients[drive, columns[0]] - before) / voltage[drive]
                spread = (idle.interval[1] - idle.interval[0]) / 2 / voltage[drive]
                values[drive] += change
                bounds[drive] += change + np.array([-spread, spread])
                break
    return values, bounds
