"""Models against measurements, on held-out data only."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.drive_types import infer_types
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.fit.folds import FOLDS, Folds
from power_estimator.effects.fit.training import Material, material
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.evaluation.scores import score
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.proxies import Proxy
from wattwalk_core.errors import InputError

from power_lab.compare.evidence import Examiner
from power_lab.compare.regimes import Regime, worst_regimes
from power_lab.recordings import Loaded, Unseen, base_power, power_on, power_unseen

Floats = NDArray[np.float64]
_SETTLING = 0.2  # s at the start of a stretch, where not every model can tell
_ON_BASE = 'test part of its base'


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
    at_bound: tuple[str, ...] = ()  # coefficients that stand at a bound


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
            'at_bound': list(judged.at_bound),
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

    A model of effects that was fitted on one of the recordings is refitted fold by fold; a
    network, and what stands on one, is judged on what it was not trained on; proxies are scaled
    on the other folds. Each model has its own best delay against the meter taken out, as a clock
    is no fault of a model. All are judged on the same samples: all that were measured, in whole
    seconds and past the first 0.2 s, less those that a network among the models knows.
    """
    models = [open_model(spec, catalogue) for spec in specs]
    alone = material(loaded.data, window=loaded.window)
    judged = []
    for spec, model in zip(specs, models, strict=True):
        if isinstance(model, EffectModel):
            base = None
            if model.base is not None:
                base = base_power(loaded, model.base)
            if _knows(model, loaded):
                judged.append(_refitted(model, loaded, base, alone, catalogue))
            else:
                power = _predicted(model, loaded, base)
                how = _ON_BASE if base is not None and base.partly else 'other recordings'
                judged.append(_plain(model.name, model.effects, power, alone, how))
            continue
        if isinstance(model, Proxy):
            judged.append(_proxy(model, loaded, alone))
        else:
            judged.append(_network(spec, model, loaded, alone))
    return _together(judged, models, alone, loaded)


def open_model(spec: str, catalogue: Catalogue) -> PowerModel:
    """A power model, whose file may name effects of the catalogue."""
    if spec.endswith(('.yaml', '.yml')):
        return read_model(Path(spec), catalogue)
    return load_model(spec)


def _knows(model: EffectModel, loaded: Loaded) -> bool:
    known = {entry.get('sha256') for entry in model.fitted_on}
    return not model.fitted or any(entry['sha256'] in known for entry in loaded.identities)


def _predicted(model: EffectModel, loaded: Loaded, base: Unseen | None) -> NDArray[np.float32]:
    """As measured, W [T, D]; NaN where the base's power is."""
    if base is None:
        return model.predict(loaded.data, as_measured=True)
    power = model.predict(loaded.data, as_measured=True, base=np.nan_to_num(base.power))
    return np.where(np.isfinite(base.power), power, np.float32(np.nan))


def _plain(
    name: str, effects: Sequence[str], power: NDArray[np.float32], own: Material, how: str
) -> Judged:
    prepared = own.prepared
    estimated = _metered(power, own)
    if not np.isfinite(estimated).any():
        raise InputError(f'{name} lacks the power of {", ".join(_unknown(power, own))}')
    delay = _best_delay(prepared, lambda delay: prepared.power_at(delay) - estimated)
    measured = prepared.power_at(delay)
    return Judged(name, tuple(effects), how, measured - estimated, measured, delay)


def _unknown(power: NDArray[np.float32], own: Material) -> list[str]:
    names = own.prepared.signals.names
    known = np.asarray(np.isfinite(power).any(axis=0), np.bool_)
    return [name for name, told in zip(names, known, strict=True) if not told]


def _best_delay(prepared: Prepared, residual_at: Callable[[float], Floats]) -> float:
    """The delay in s with the least residual [N, D], between the steps by a parabola."""
    errors = [
        float(np.nansum(np.log(np.nanmean(np.square(residual_at(float(shift))), axis=0) + 1e-9)))
        for shift in prepared.shifts
    ]
    best = int(np.argmin(errors))
    delay = float(prepared.shifts[best])
    if 0 < best < len(errors) - 1:
        a, b, c = errors[best - 1 : best + 2]
        curvature = a - 2 * b + c
        delay += (
            0.5 * (a - c) / curvature * (prepared.shifts[1] - prepared.shifts[0])
            if curvature
            else 0.0
        )
    return delay


def _with_unit(proxy: Proxy, loaded: Loaded) -> Proxy:
    """The proxy with any unit: that of its power where drives were metered, else 1 W each."""
    if loaded.data.measured_drives():
        return proxy.fit(loaded.smooth)
    types = infer_types(loaded.data.names)
    return replace(proxy, types=types, factors={kind.name: 1.0 for kind in types})


def _metered(power: NDArray[np.float32], own: Material) -> Floats:
    """The model's power [T, D] as the meters see it, W [N, M]."""
    reduced = own.prepared.reduced(np.asarray(_rows(power, own), dtype=np.float64))
    return reduced.sum(axis=1, keepdims=True) if own.prepared.whole else reduced


def _rows(power: NDArray[np.float32], own: Material) -> NDArray[np.float32]:
    if len(power) != len(own.prepared.signals.time):
        raise InputError('the recording has samples without position, velocity or torque')
    return power


def _refitted(
    model: EffectModel, loaded: Loaded, base: Unseen | None, alone: Material, catalogue: Catalogue
) -> Judged:
    own = alone
    if base is not None:
        own = material(loaded.data, base=base.power, catalogue=catalogue, window=loaded.window)
    terms = measurement_terms(catalogue, shaft='shaft' in model.effects)
    examiner = Examiner(own.fitter())
    fit = examiner.fitter.fit(own.structure(model.structure.actives).plus(*terms), iterations=4)
    found = examiner.residual(examiner.examine(fit), all_rows=True)
    measured = alone.prepared.power_at(fit.delay)
    residual = np.full(measured.shape, np.nan)
    residual[:, [alone.prepared.names.index(name) for name in own.prepared.names]] = found
    how = 'cross-validated'
    if base is not None and base.partly:
        how += f' on the {_ON_BASE}'
    return Judged(model.name, model.effects, how, residual, measured, fit.delay)


def _proxy(proxy: Proxy, loaded: Loaded, own: Material) -> Judged:
    """Scaled on the folds that are not judged."""
    prepared = own.prepared
    blocks = own.fitter().blocks
    folds = Folds.of(blocks)
    unscaled = power_on(loaded.data, loaded.smooth, _with_unit(proxy, loaded))
    signal = _metered(unscaled, own)
    known = np.isfinite(signal) & prepared.measured

    def residual_at(delay: float) -> Floats:
        power = prepared.power_at(delay)
        residual = np.full(power.shape, np.nan)
        for fold in range(FOLDS):
            tested = blocks.rows[folds.test == fold].ravel()
            trained = blocks.rows[folds.training[fold] > 0].ravel()
            means = (
                np.nanmean(np.where(known, values, np.nan)[trained], axis=0)
                for values in (power, signal)
            )
            residual[tested] = power[tested] - signal[tested] * np.divide(*means)
        return residual

    delay = _best_delay(prepared, residual_at)
    measured = prepared.power_at(delay)
    return Judged(proxy.name, (), 'cross-validated', residual_at(delay), measured, delay)


def _network(spec: str, model: PowerModel, loaded: Loaded, own: Material) -> Judged:
    found = power_unseen(loaded, model)
    if not np.isfinite(found.power).any():
        raise InputError(f'{spec} says nothing about {", ".join(loaded.data.names)}')
    how = 'its test part' if found.partly else 'other recordings'
    return _plain(spec, (), found.power, own, how)


def _together(
    judged: Sequence[Judged], given: Sequence[PowerModel], alone: Material, loaded: Loaded
) -> Comparison:
    prepared = alone.prepared
    common = np.zeros(prepared.measured.shape, bool)
    whole = Blocks.of(prepared).rows.ravel()
    common[whole] = prepared.measured[whole]
    for part in prepared.reducer.stretches():
        common[part][: round(_SETTLING * REDUCED_RATE)] = False
    for one in judged:
        common &= np.isfinite(one.residual)
    if not common.any():
        raise InputError('no sample is left that every model may be judged on')
    state, labels = describe_state(prepared, loaded)
    models = []
    for one, model in zip(judged, given, strict=True):
        residual = np.where(common, one.residual, np.nan)
        regimes = worst_regimes(
            by_drive(residual, prepared),
            state,
            prepared.signals.names,
            labels,
            scale=prepared.signals.scale,
        )
        at_bound = model.at_bound if isinstance(model, EffectModel) else ()
        models.append(replace(one, residual=residual, regimes=tuple(regimes), at_bound=at_bound))
    return Comparison(prepared, tuple(models), state, labels)


def by_drive(residual: Floats, prepared: Prepared) -> Floats:
    """Residual of the meters [N, M] beside each drive's state, [N, D]."""
    return np.broadcast_to(residual, (len(residual), len(prepared.signals.names)))


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
    if force is not None and (part := prepared.part) is not None:
        past = prepared.signals.past
        whole = past is not None and len(force) == len(past.time)
        force = force[part.samples] if whole else None
    if force is not None and len(force) == len(prepared.signals.time):
        loads = prepared.reduced(np.nan_to_num(np.asarray(force, dtype=np.float64)))
        words = np.full(shape, '', dtype='<U6')
        for drive, name in enumerate(prepared.signals.names):
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
