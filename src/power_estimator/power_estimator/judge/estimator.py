"""Estimates of power models where they were not fitted."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import assign, infer_types
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.fit.per_recording import OWN_TERMS, in_step, own_delays, own_terms
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared, prepare
from power_estimator.effects.training import LEAST_TO_FIT, Material, material
from power_estimator.judge.evidence import Examiner
from power_estimator.judge.held_out import (
    HeldOutPower,
    held_out_rows,
    knows,
    power_on,
    power_under,
)
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import HeldOut
from power_estimator.loader import base_of
from power_estimator.model import PowerModel
from power_estimator.proxies import Proxy

_LIKE_A_DELAY = ('rotor_inertia', 'spring')


def together(
    own: Material, structure: Structure, catalogue: Catalogue, apart: Collection[str] = OWN_TERMS
) -> tuple[Material, tuple[Active, ...], Floats]:
    """Return recordings in step, errors of their measurement as effects, and delays, s [R].

    own: of all recordings. Delays, and the errors named in `apart`, are separate by recording.
    """
    prepared = own.prepared
    steady = prepared.steady
    terms = measurement_terms(catalogue, shaft='shaft' in structure.names, steady=steady)
    alike = [
        catalogue[name]
        for name in _LIKE_A_DELAY
        if name in catalogue
        and not any(known.partition('@')[0] == name for known in structure.names)
        and catalogue[name].usable(prepared.signals)
    ]
    whole = structure.plus(*own.structure([Active.of(effect) for effect in alike]).actives, *terms)

    def fitter(alone: Prepared) -> Fitter:
        return replace(own, prepared=alone).fitter(per_drive=True)

    delays = own_delays(prepared, whole, fitter)
    aligned = replace(own, prepared=in_step(prepared, delays))
    return aligned, own_terms(terms, len(prepared.recordings), apart), delays


@dataclass(frozen=True)
class JudgeSettings:
    """Settings of the judge: folds, samples left out, refits, spread of R², lag of the supply."""

    fit: FitSettings = field(default_factory=FitSettings)  # folds and refits
    settling: float = 0.2  # s at the start of a stretch: networks begin with an empty memory
    iterations: int = 12  # of a refit: the linearisation no longer moves
    together: int = 4  # recordings refitted at once: each adds its own columns of meter errors
    spread: int = 6  # stretches whose R² gives its spread, as many as training has segments
    shortest: float = 10.0  # s of such a stretch: R² of a shorter one means little
    longest_lag: float = 0.05  # s by which a robot's supply may be read late


CROSS_VALIDATED = 'cross-validated'
ELSEWHERE = 'other recordings'
_TEST_PART, _OF_BASE = 'its test part', 'test part of its base'


class HeldOutEstimator:
    """Estimates power models on recordings, held out in the way that each kind of model needs."""

    def __init__(self, recordings: Loaded, catalogue: Catalogue, settings: JudgeSettings) -> None:
        self.recordings, self.catalogue, self.settings = recordings, catalogue, settings

    @cached_property
    def prepared(self) -> Prepared:
        """Signals and reduced power, with the N rows and M meters of all scores."""
        return prepare(self.recordings.data, self.recordings.window)

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of the prepared rows, of a second as a rule."""
        return Blocks.of(self.prepared, self.settings.fit)

    def folds(self, blocks: Blocks) -> Folds:
        """Return the folds of a cross-validation in pieces of 10 s, also with many recordings."""
        return Folds.of(blocks, self.settings.fit, by_recording=False)

    def material(
        self, base: HeldOutPower | None, per: str = 'type', least: float = LEAST_TO_FIT
    ) -> Material:
        """Return signals for a fit of effects on a base model's power, None for no base.

        per: `type` or `drive`; least: s or, if windows are longer than 1 s, number of windows.
        """
        window = self.recordings.window
        return material(
            self.recordings.data,
            per=per,
            base=None if base is None else base.power,
            catalogue=self.catalogue,
            least=max(least, least * window),
            window=window,
            settings=self.settings.fit,
            prepared=self.prepared if base is None else None,
        )

    def estimate(self, model: PowerModel, name: str) -> HeldOut:
        """Return a model's estimate where it may be judged; NaN in the residual elsewhere.

        name: for messages. InputError for a model that knows none of the drives.
        """
        if isinstance(model, EffectModel):
            return self._effects(model)
        if isinstance(model, Proxy):
            power = self._unscaled(model)
            signal = self._metered(power)
            estimated = signal * self._factors(model, signal)
            return self._predicted(estimated, model.name, power, CROSS_VALIDATED)
        power = power_on(self.recordings, model)
        if not np.isfinite(power).any():
            raise InputError(f'{name} says nothing about {", ".join(self.recordings.data.names)}')
        prepared = self.prepared
        allowed = held_out_rows(model, self.recordings, prepared.time, prepared.recording)
        found = self._predicted(self._metered(power), name, power)
        if prepared.whole:
            allowed = np.asarray(allowed.all(axis=1, keepdims=True))
        how = tuple(
            ELSEWHERE if allowed[prepared.recording == index].all() else _TEST_PART
            for index in range(len(found.how))
        )
        return replace(found, residual=np.where(allowed, found.residual, np.nan), how=how)

    def _predicted(
        self, estimated: Floats, name: str, power: NDArray[np.floating], how: str = ELSEWHERE
    ) -> HeldOut:
        """An estimate [N, M] with the best delay of each recording taken out."""
        if not np.isfinite(estimated).any():
            known = np.isfinite(power).any(axis=0)
            names = zip(self.prepared.signals.names, known, strict=True)
            lacking = ', '.join(drive for drive, has_power in names if not has_power)
            raise InputError(f'{name} lacks the power of {lacking}')
        prepared = self.prepared
        measured, delays = prepared.power_at(0.0), []
        for index in range(len(prepared.recordings)):
            rows = prepared.recording == index
            delays.append(self._best_delay(estimated, rows))
            measured[rows] = prepared.power_at(delays[-1])[rows]
        return HeldOut(measured, measured - estimated, tuple(delays), (how,) * len(delays))

    def _best_delay(self, estimated: Floats, rows: Bools) -> float:
        """The delay in s with the least residual, between the steps by a parabola."""
        prepared = self.prepared
        if prepared.steady:
            return 0.0
        known = rows[:, None] & np.isfinite(estimated) & prepared.measured
        errors = np.zeros(len(prepared.shifts))
        for meter in np.flatnonzero(known.any(axis=0)):
            own = known[:, meter]
            apart = prepared.power[:, own, meter] - estimated[own, meter]
            errors += np.log(np.mean(np.square(apart), axis=1) + 1e-9)
        best = int(np.argmin(errors))
        delay = float(prepared.shifts[best])
        if 0 < best < len(errors) - 1:
            a, b, c = errors[best - 1 : best + 2].tolist()
            curvature = a - 2 * b + c
            step = prepared.shifts[1] - prepared.shifts[0]
            delay += float(0.5 * (a - c) / curvature * step) if curvature else 0.0
        return delay

    def _metered(self, power: NDArray[np.floating]) -> Floats:
        """A model's power [T, D] as the meters see it, W [N, M]."""
        if len(power) != len(self.prepared.signals.time):
            raise InputError('the recording has samples without position, velocity or torque')
        reduced = self.prepared.reduced(np.asarray(power, dtype=np.float64))
        return reduced.sum(axis=1, keepdims=True) if self.prepared.whole else reduced

    def _unscaled(self, proxy: Proxy) -> Singles:
        """A proxy's signal on all samples [T, D]."""
        types = proxy.types or infer_types(self.recordings.data.names)
        unit = replace(proxy, types=types, factors={kind.name: 1.0 for kind in types})
        return power_on(self.recordings, unit)

    def _factors(self, proxy: Proxy, signal: Floats) -> Floats:
        """W per unit of a proxy's signal [N, M] in each fold, by drive type, from the others."""
        prepared = self.prepared
        types = proxy.types or infer_types(self.recordings.data.names)
        nominal = prepared.power_at(0.0)
        known = np.isfinite(signal) & prepared.measured
        groups = [[0]] if prepared.whole else list(assign(prepared.names, types).values())
        folds, factors = self.folds(self.blocks), np.full(signal.shape, np.nan)
        for fold, training in enumerate(folds.training):
            tested = self.blocks.rows[folds.test == fold].ravel()
            trained = self.blocks.rows[training > 0].ravel()
            for own in groups:
                both = known[trained][:, own]
                drawn, of_signal = (v[trained][:, own][both] for v in (nominal, signal))
                mean = of_signal.mean() if both.any() else 0.0
                if mean > 0.0:
                    factors[np.ix_(tested, own)] = drawn.mean() / mean
        return factors

    def _scaled(self, proxy: Proxy) -> Singles:
        """A proxy's power on all samples, W [T, D], with the factors of the nearest fold."""
        data, prepared, power = self.recordings.data, self.prepared, self._unscaled(proxy)
        factors = self._factors(proxy, self._metered(power))
        scaled = np.full_like(power, np.nan)
        for meter, name in enumerate(prepared.names):
            drive = data.names.index(name)
            for index in range(len(data.recordings)):
                known = np.isfinite(factors[:, meter]) & (prepared.recording == index)
                if known.any():
                    here, times = data.recording == index, prepared.time[known]
                    nearest = np.searchsorted((times[1:] + times[:-1]) / 2, data.time[here])
                    scaled[here, drive] = power[here, drive] * factors[known, meter][nearest]
        return scaled

    def _effects(self, model: EffectModel) -> HeldOut:
        """Recordings that it was fitted on in groups, and the others, each part by itself."""
        known = knows(model, self.recordings)
        if known.all() and len(known) <= self.settings.together:
            return self._refitted(model)
        if not known.any():
            return self._as_it_is(model)
        parts = np.array_split(
            np.flatnonzero(known), -(-int(known.sum()) // self.settings.together)
        )
        if not known.all():
            parts.append(np.flatnonzero(~known))
        prepared = self.prepared
        measured = prepared.power_at(0.0)
        residual = np.full(measured.shape, np.nan)
        delays, how = [0.0] * len(prepared.recordings), [''] * len(prepared.recordings)
        for places in parts:
            own = self.recordings.only(places.tolist())
            part = HeldOutEstimator(own, self.catalogue, self.settings)
            found = part._refitted(model) if known[places[0]] else part._as_it_is(model)
            columns = np.array([prepared.names.index(name) for name in part.prepared.names])
            for index, place in enumerate(places.tolist()):
                there = part.prepared.recording == index
                here = np.flatnonzero(prepared.recording == place)
                rows = here[np.isin(prepared.time[here], part.prepared.time[there])]
                there &= np.isin(part.prepared.time, prepared.time[here])
                measured[np.ix_(rows, columns)] = found.measured[there]
                residual[np.ix_(rows, columns)] = found.residual[there]
                delays[place], how[place] = found.delays[index], found.how[index]
        return HeldOut(measured, residual, tuple(delays), tuple(how))

    def _as_it_is(self, model: EffectModel) -> HeldOut:
        """Physics alone, on recordings that the model was not fitted on."""
        data, under = self.recordings.data, base_of(model)
        rescaled = isinstance(under, Proxy) and not under.factors
        base, how = self._base(model, rescaled), CROSS_VALIDATED if rescaled else ELSEWHERE
        if base is not None and base.partly:
            how = _OF_BASE
        if base is None:
            power = model.predict(data)
        else:
            power = model.predict(data, base=np.nan_to_num(base.power))
            power = np.where(np.isfinite(base.power), power, np.float32(np.nan))
        return self._predicted(self._metered(power), model.name, power, how)

    def _base(self, model: EffectModel, rescaled: bool) -> HeldOutPower | None:
        """Power under the effects; rescaled: where that is of a proxy, on the other folds."""
        under = base_of(model)
        if rescaled and isinstance(under, Proxy) and not self.prepared.whole:
            return HeldOutPower(self._scaled(under), partly=False)
        return power_under(self.recordings, model)

    def _refitted(self, model: EffectModel) -> HeldOut:
        """Refitted fold by fold, with errors of measurement of each recording's own."""
        base = self._base(model, rescaled=True)
        own = self.material(base)
        if model.groups and not own.prepared.whole:
            own = replace(own, types=tuple(group.type for group in model.groups))
        structure = own.structure(model.structure.actives)
        apart = [term.name for term in measurement_terms(self.catalogue, shaft=True)]
        own, terms, delays = together(own, structure, self.catalogue, apart)
        terms = tuple(term for term in terms if term.name not in structure.names)
        fitter = own.fitter(prior=model.prior)
        examiner = Examiner(fitter, folds=self.folds(fitter.blocks))
        fit = fitter.fit(structure.plus(*terms), iterations=self.settings.iterations)
        columns = [self.prepared.names.index(name) for name in own.prepared.names]
        measured = self.prepared.power_at(fit.delay)
        residual = np.full(measured.shape, np.nan)
        residual[:, columns] = examiner.residual(examiner.examine(fit), all_rows=True)
        measured[:, columns] = own.prepared.power_at(fit.delay)
        how = CROSS_VALIDATED
        if base is not None and base.partly:
            how += f' on the {_OF_BASE}'
        known = assign(own.prepared.names, own.types)
        unknown = {*range(len(columns))} - {place for places in known.values() for place in places}
        if not own.prepared.whole:
            residual[:, [columns[place] for place in sorted(unknown)]] = np.nan
        return HeldOut(
            measured,
            residual,
            tuple(float(fit.delay + later) for later in delays),
            (how,) * len(delays),
        )
