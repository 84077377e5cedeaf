"""Models against measurements, on held-out data only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_daq.cli import InputError
from power_daq.recording.aligned import AlignedDataset
from power_estimator.effect_design import Structure
from power_estimator.effect_fit import measurement_terms
from power_estimator.effect_folds import FOLDS, Folds
from power_estimator.effect_model import EffectModel
from power_estimator.effect_signals import REDUCED_RATE, Prepared
from power_estimator.effect_training import Material, material
from power_estimator.effects import Catalogue
from power_estimator.model import PowerModel, load_model
from power_estimator.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.recordings import describe, held_out
from power_estimator.scores import score

from power_lab.evidence import Examiner
from power_lab.recordings import Loaded, power_on
from power_lab.regimes import Regime, worst_regimes

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Judged:
    """One model on the recordings."""

    name: str
    effects: tuple[str, ...]
    how: str  # how it was kept from knowing the answers
    residual: Floats  # measured − estimated, W [N, D]
    measured: Floats  # W [N, D], with the delay taken out
    delay: float  # s
    regimes: tuple[Regime, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """All models on the same samples."""

    prepared: Prepared
    models: tuple[Judged, ...]
    state: Mapping[str, Floats]
    labels: Mapping[str, NDArray[np.str_]]

    def json(self) -> dict[str, Any]:
        """As `compare --json` writes it."""
        return {
            'models': [self._model(judged) for judged in self.models],
            'drives': list(self.prepared.names),
            'seconds': round(self.prepared.seconds, 2),
            'sensor_noise_w': {
                name: _round(noise)
                for name, noise in zip(self.prepared.names, self.prepared.noise, strict=True)
            },
        }

    def _model(self, judged: Judged) -> dict[str, Any]:
        drives = {
            name: _scores(judged.measured[:, column], judged.residual[:, column])
            for column, name in enumerate(self.prepared.names)
        }
        whole = np.isfinite(judged.residual).all(axis=1)
        total = _scores(judged.measured[whole].sum(axis=1), judged.residual[whole].sum(axis=1))
        return {
            'name': judged.name,
            'effects': list(judged.effects),
            'held_out': judged.how,
            'time_offset': round(judged.delay, 6),
            'drives': drives,
            'total': total,
            'regimes': [regime.json() for regime in judged.regimes],
        }


def _scores(measured: Floats, residual: Floats) -> dict[str, float | None]:
    good = np.isfinite(measured) & np.isfinite(residual)
    found = score(measured[good], (measured - residual)[good], REDUCED_RATE)
    joules = float(-residual[good].sum() / REDUCED_RATE) if good.any() else float('nan')
    energy = float(measured[good].sum() / REDUCED_RATE) if good.any() else float('nan')
    return {
        'r2': _round(found.r2),
        'rmse_w': _round(found.rmse_w),
        'bias_w': _round(found.bias_w),
        'error_j': _round(joules),
        'energy_j': _round(energy),
    }


def _round(value: float) -> float | None:
    return float(f'{value:.6g}') if np.isfinite(value) else None


def compare(loaded: Loaded, specs: Sequence[str], catalogue: Catalogue) -> Comparison:
    """
    Judge models by name or file.

    A model of effects that was fitted on one of the recordings is refitted fold by fold; a network
    is judged on what it was not trained on; proxies are scaled on the other folds. Each model has
    its own best delay against the meter taken out, as a clock is no fault of a model. All are
    judged on the same samples.
    """
    models = [open_model(spec, catalogue) for spec in specs]
    plain = material(loaded.data)
    prepared = plain.prepared
    smooth = None
    judged = []
    for spec, model in zip(specs, models, strict=True):
        if isinstance(model, EffectModel) and _knows(model, loaded):
            judged.append(_refitted(model, loaded, catalogue))
            continue
        if isinstance(model, EffectModel) and model.base is None:
            power = model.predict(loaded.data, as_measured=True)
            judged.append(_plain(model.name, model.effects, power, plain, 'other recordings'))
            continue
        smooth = smooth or loaded.smooth()
        if isinstance(model, EffectModel):
            base = power_on(loaded.data, smooth, load_model(str(model.base)))
            power = model.predict(loaded.data, as_measured=True, base=base)
            judged.append(_plain(model.name, model.effects, power, plain, 'other recordings'))
        elif isinstance(model, Proxy):
            judged.append(_proxy(model, loaded, smooth, plain))
        else:
            judged.append(_network(spec, model, loaded, smooth, plain))
    return _together(judged, prepared, loaded)


def open_model(spec: str, catalogue: Catalogue) -> PowerModel:
    """A power model, whose file may name effects of the catalogue."""
    if spec.endswith(('.yaml', '.yml')):
        return EffectModel.load(Path(spec), catalogue)
    return load_model(spec)


def _knows(model: EffectModel, loaded: Loaded) -> bool:
    known = {entry.get('sha256') for entry in model.fitted_on}
    return not model.fitted or any(entry['sha256'] in known for entry in loaded.identities)


def _plain(
    name: str, effects: Sequence[str], power: NDArray[np.float32], own: Material, how: str
) -> Judged:
    prepared = own.prepared
    estimated = prepared.reduced(np.asarray(_rows(power, own), dtype=np.float64))
    errors = []
    for shift in prepared.shifts:
        residual = prepared.power_at(float(shift)) - estimated
        errors.append(float(np.nansum(np.log(np.nanmean(np.square(residual), axis=0) + 1e-9))))
    best = int(np.argmin(errors))
    delay = float(prepared.shifts[best])
    if 0 < best < len(errors) - 1:
        a, b, c = errors[best - 1 : best + 2]
        bend = a - 2 * b + c
        delay += 0.5 * (a - c) / bend * (prepared.shifts[1] - prepared.shifts[0]) if bend else 0.0
    measured = prepared.power_at(delay)
    return Judged(name, tuple(effects), how, measured - estimated, measured, delay)


def _rows(power: NDArray[np.float32], own: Material) -> NDArray[np.float32]:
    if len(power) != len(own.prepared.signals.time):
        raise InputError('the recording has samples without position, velocity or torque')
    return power


def _refitted(model: EffectModel, loaded: Loaded, catalogue: Catalogue) -> Judged:
    base = None
    if model.base is not None:
        base = power_on(loaded.data, loaded.smooth(), load_model(model.base))
    own = material(loaded.data, base=base, catalogue=catalogue)
    terms = measurement_terms(catalogue, shaft='shaft' in model.effects)
    examiner = Examiner(own.fitter())
    fit = examiner.fitter.fit(Structure(model.structure.actives).plus(*terms), iterations=4)
    evidence = examiner.examine(fit)
    residual = examiner.residual(evidence)
    measured = own.prepared.power_at(fit.delay)
    return Judged(model.name, model.effects, 'cross-validated', residual, measured, fit.delay)


def _proxy(proxy: Proxy, loaded: Loaded, smooth: AlignedDataset, own: Material) -> Judged:
    """Scaled on the folds that are not judged."""
    prepared = own.prepared
    fitter = own.fitter()
    folds = Folds.of(fitter.blocks)
    unscaled = power_on(loaded.data, smooth, proxy.fit(smooth))
    signal = prepared.reduced(np.asarray(_rows(unscaled, own), dtype=np.float64))
    power = prepared.power_at(0.0)
    residual = np.full(power.shape, np.nan)
    for fold in range(FOLDS):
        tested = fitter.blocks.rows[folds.test == fold].ravel()
        trained = fitter.blocks.rows[folds.training[fold] > 0].ravel()
        scale = np.nanmean(power[trained], axis=0) / np.nanmean(signal[trained], axis=0)
        residual[tested] = power[tested] - signal[tested] * scale
    return Judged(proxy.name, (), 'cross-validated', residual, power, 0.0)


def _network(
    spec: str, model: PowerModel, loaded: Loaded, smooth: AlignedDataset, own: Material
) -> Judged:
    power = power_on(loaded.data, smooth, model)
    how = 'other recordings'
    if isinstance(model, PowerPredictionNetwork):
        known = [describe(path) for path in loaded.paths]
        for drive, name in enumerate(loaded.data.names):
            kinds = [t.name for t in model.types if t.matches(name)]
            if kinds:
                allowed = held_out(loaded.data, known, model.checkpoint.recordings, kinds[0])
                if not allowed.all():
                    how = 'its test part'
                power[~allowed, drive] = np.nan
    if not np.isfinite(power).any():
        raise InputError(f'{spec} says nothing about {", ".join(loaded.data.names)}')
    return _plain(spec, (), power, own, how)


def _together(judged: Sequence[Judged], prepared: Prepared, loaded: Loaded) -> Comparison:
    common = np.logical_and.reduce([np.isfinite(one.residual) for one in judged])
    if not common.any():
        raise InputError('no sample is left that every model may be judged on')
    state, labels = describe_state(prepared, loaded)
    models = []
    for one in judged:
        residual = np.where(common, one.residual, np.nan)
        regimes = worst_regimes(residual, state, prepared.names, labels)
        models.append(
            Judged(
                one.name, one.effects, one.how, residual, one.measured, one.delay, tuple(regimes)
            )
        )
    return Comparison(prepared, tuple(models), state, labels)


def describe_state(
    prepared: Prepared, loaded: Loaded
) -> tuple[dict[str, Floats], dict[str, NDArray[np.str_]]]:
    """Signals and words over which a model may fail, [N, D] each."""
    state = prepared.state()
    shape = state['torque'].shape
    since = prepared.time - prepared.time[0]
    state['time'] = np.broadcast_to(since[:, None], shape)
    labels: dict[str, NDArray[np.str_]] = {}
    force = loaded.data.extras.get('foot_force')
    if force is not None and len(force) == len(prepared.signals.time):
        loads = prepared.reduced(np.nan_to_num(np.asarray(force, dtype=np.float64)))
        words = np.full(shape, '', dtype='<U6')
        for drive, name in enumerate(prepared.names):
            leg = name.split('_')[0].upper()
            if leg in _LEGS and loads.shape[1] == len(_LEGS):
                stands = loads[:, _LEGS.index(leg)] > _STANCE
                words[:, drive] = np.where(stands, 'stance', 'swing')
        labels['phase'] = words
    if len(set(loaded.controllers)) > 1:
        names = np.array(loaded.controllers)[prepared.recording]
        labels['controller'] = np.broadcast_to(names[:, None], shape)
    return state, labels


_LEGS = ('LF', 'RF', 'LH', 'RH')
_STANCE = 20.0  # N
