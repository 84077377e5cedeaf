"""Diagnose a model on recordings: from files to the outcome that is printed and written."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue, Signals
from power_estimator.effects.fit.design import Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import LEAST_SECONDS, material
from power_estimator.judge.estimator import together
from power_estimator.judge.held_out import power_under
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.model import PowerModel
from power_estimator.posterior.judged import JudgedEffects

from power_lab.diagnose.diagnosis import Diagnoser
from power_lab.diagnose.findings import Candidate, Diagnosis
from power_lab.diagnose.judged_steps import JudgedSteps, judged_steps
from power_lab.diagnose.measurement_check import MeasurementTerm, check_measurement
from power_lab.diagnose.next_recording import Motion, separating_motion
from power_lab.diagnose.probable import probable, torque_scale, with_names
from power_lab.diagnose.verdict import noise_w, remainder, sentence
from power_lab.structure.candidates import CONSTANT_TORQUE
from power_lab.structure.words import in_words

Floats = NDArray[np.float64]
MOST_SECONDS = 150.0
"""
s of all recordings together that a diagnosis judges on, as long as those of the blind benchmark.

On all of ten minutes the verdicts are the same (docs/results/power_lab.md).
"""
_TOO_LITTLE = 0.01  # of what the largest candidate explains, to be compared at all
_HIDES = 3.0  # times the floor: what other terms of the model may have swallowed
_MOST_ASKED = 3
_TIED = 0.998
"""Correlation of what two effects explain above which they are one family here."""


@dataclass(frozen=True)
class Row:
    """A candidate as it is shown."""

    name: str
    family: str
    delta_r2: float
    delta_rmse_w: float
    symbol: str
    unit: str
    coefficient: float
    interval: tuple[float, float]
    could_hide_w: float  # rms that the interval's far end would put on, on the worst drive
    in_confidence_set: bool
    drive: str  # the one that coefficient and interval are of
    shape: dict[str, float]
    coefficients: dict[str, list[float]]  # by drive
    at_bound: str  # 'lower' or 'upper' where the coefficient stands at its bound

    def json(self) -> dict[str, Any]:
        """As `diagnose --json` writes it."""
        return {
            'name': self.name,
            'family': self.family,
            'delta_r2': _short(self.delta_r2),
            'delta_rmse_w': _short(self.delta_rmse_w),
            'coefficient': _short(self.coefficient),
            'interval': [_short(bound) for bound in self.interval],
            'could_hide_w': _short(self.could_hide_w),
            'unit': self.unit,
            'symbol': self.symbol,
            'in_confidence_set': self.in_confidence_set,
            'drive': self.drive,
            'shape': self.shape,
            'coefficients': self.coefficients,
            'at_bound': self.at_bound or None,
        }


@dataclass(frozen=True)
class Outcome:
    """Everything that diagnose tells."""

    model: EffectModel
    loaded: Loaded
    diagnoser: Diagnoser
    diagnosis: Diagnosis
    rows: tuple[Row, ...]
    measurement: dict[str, MeasurementTerm]
    judged: JudgedSteps
    motion: Motion
    probable: JudgedEffects | None
    seconds: float  # of the recordings, of which the diagnosis may have judged on pieces

    @property
    def verdict(self) -> str:
        """`named`, `ambiguous`, `none_of_the_above` or `no_evidence`."""
        return self.diagnosis.verdict

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        told = sentence(self.diagnosis, self.judged.before.rms_w, self.judged.after.rms_w)
        if self.diagnosis.verdict != 'no_evidence':
            return told
        hidden = _could_be_there(self.diagnosis, self.rows)
        if not hidden:
            return told
        words = ', '.join(f'{in_words(row.name)} ({row.could_hide_w:.1f} W)' for row in hidden)
        return f'{told} Other terms of the model would cover up to this much of: {words}.'

    def json(self) -> dict[str, Any]:
        """As `diagnose --json` writes it."""
        d = self.diagnosis
        left = self.judged.regimes_after
        worst = left[0].json() if left else None
        model, after = self.judged.model.drives, self.judged.after.drives
        names = self.diagnoser.fitter.prepared.names
        return {
            'verdict': d.verdict,
            'sentence': self.sentence,
            'effects': list(d.effects),
            'beyond_physics': list(d.beyond),
            'certain': [name for name in d.effects if name in d.certain],
            'active': list(self.model.effects),
            'measurement': {name: term.json() for name, term in self.measurement.items()},
            'candidates': [{**row.json(), **self._probability(row.name)} for row in self.rows],
            'leftover': {
                'r2': _short(d.unexplained.r2),
                'worst': worst,
                'watts': {
                    'state': _roots(d.unexplained.state, names),
                    'other_drives': _roots(d.unexplained.cross, names),
                    'time': _roots(d.unexplained.slow, names),
                },
                'period_s': _values(d.unexplained.period, names),
                'ljung_box_p': _values(d.unexplained.ljung_box, names),
            },
            'residual': self._residual(),
            'next_recording': self.motion.content(),
            'drives': {
                name: {
                    'rmse_w': model[name].json()['rmse_w'],
                    'rmse_after_w': after[name].json()['rmse_w'],
                    'sensor_noise_w': _short(float(self.diagnoser.fitter.prepared.noise[i])),
                    'floor_w': _short(float(d.floor[i])),
                    'stranger_floor_w': _short(float(d.structure_floor[i])),
                }
                for i, name in enumerate(names)
            },
            'share_explained': _short(d.share),
            'judged_on_s': round(self.diagnoser.fitter.prepared.seconds, 2),
            'of_s': round(self.seconds, 2),
            'steps': [
                {
                    'before': list(step.added),
                    'possible': [list(member) for member in step.members],
                    'none_possible': step.none_possible,
                }
                for step in d.steps
            ],
        }

    def _probability(self, name: str) -> dict[str, Any]:
        """What the posterior says of an effect, where it judged."""
        if self.probable is None or name not in self.probable.probability:
            return {}
        low, middle, high = self.probable.explains(name).tolist()
        return {
            'probability': round(self.probable.probability[name], 4),
            'explains_w': _short(middle),
            'explains_interval': [_short(low), _short(high)],
            'share': _short(self.probable.share(name)),
        }

    def _residual(self) -> dict[str, Any] | None:
        """Structure that no known effect explains; None where it is too small to be one."""
        d = self.diagnosis
        if d.verdict == 'no_evidence' or (d.remainder is None and not d.unmodelled):
            return None
        left, noise = remainder(d), noise_w(d)
        return {
            'rms_w': _short(float(np.sqrt(left.mean()))),
            'noise_w': _short(noise) if np.isfinite(noise) else None,
            'over': [] if d.remainder is None else list(d.remainder.over),
            'drives': _roots(left, self.diagnoser.fitter.prepared.names),
        }


def diagnose(
    loaded: Loaded, model: PowerModel, spec: str, catalogue: Catalogue, seed: int = 0
) -> Outcome:
    """
    Say which effect the model misses on these recordings.

    A model that is not made of effects is taken as the base that effects are added to; a network
    that knows the recordings counts on its test part only. InputError for recordings that are too
    short or too still.
    """
    given = model
    if not isinstance(model, EffectModel):
        model = EffectModel(model.name, Structure(()), base=spec)
    base, seen = None, False
    under = power_under(loaded, model)
    if under is not None:
        base, seen = under.power, under.partly
    own = material(
        loaded.data,
        base=base,
        catalogue=catalogue,
        least=max(LEAST_SECONDS, LEAST_SECONDS * loaded.window),
        window=loaded.window,
    )
    seconds = own.prepared.seconds
    if not any(catalogue[name].remembers for name in catalogue):
        own = own.at_most(MOST_SECONDS)
    structure = own.structure(model.structure.actives)
    own, terms, delays = together(own, structure, catalogue)
    fitter = own.fitter(per_drive=True)
    diagnoser = Diagnoser(fitter, structure.plus(*terms), catalogue, seed)
    diagnosis = diagnoser.run()
    found = probable(own, structure.actives, catalogue, loaded.window)
    if found is not None:
        diagnosis = with_names(diagnosis, found, diagnoser)
    known = {entry.get('sha256') for entry in model.fitted_on}
    other = not seen and not any(entry['sha256'] in known for entry in loaded.identities)
    beside = diagnosis.beside or diagnosis
    rows = _rows(beside, diagnoser)
    measurement = check_measurement(
        beside, fitter, model, other_recording=other, delays=delays, seed=seed
    )
    if found is not None:
        measurement['torque_scale'] = torque_scale(found, own.prepared.names)
    return Outcome(
        model=model,
        loaded=loaded,
        diagnoser=diagnoser,
        diagnosis=diagnosis,
        rows=rows,
        measurement=measurement,
        judged=judged_steps(Judge(loaded, catalogue), given, model, diagnosis, spec),
        motion=_motion(diagnosis, rows, catalogue, own.prepared.signals),
        probable=found,
        seconds=seconds,
    )


def _rows(diagnosis: Diagnosis, diagnoser: Diagnoser) -> tuple[Row, ...]:
    fitter = diagnoser.fitter
    power = fitter.prepared.power_at(0.0)
    variance = np.nansum(np.nanvar(power, axis=0))
    before = np.sqrt(np.sum(diagnosis.base.mean_mse))
    families = _families(diagnosis)
    count = len(fitter.prepared.names)
    out = []
    for candidate in diagnosis.singles:
        fit = candidate.evidence.fit
        columns = fit.structure.columns_of(candidate.name)
        drive = int(np.argmax(candidate.gain / np.square(diagnosis.floor)))
        values = fit.coefficients[:, columns]
        lead = int(np.argmax(np.abs(values[drive]) * _column_size(candidate, drive)))
        bounds = candidate.intervals[drive, lead]
        term = candidate.active.effect.terms[lead]
        after = np.sqrt(np.sum(candidate.evidence.mean_mse))
        out.append(
            Row(
                name=candidate.name,
                family=families[candidate.name],
                delta_r2=float(candidate.gain.sum() / max(variance, 1e-12)),
                delta_rmse_w=float((before - after) / np.sqrt(count)),
                symbol=term.symbol,
                unit=term.unit,
                coefficient=float(values[drive, lead]),
                interval=(float(bounds[0]), float(bounds[1])),
                could_hide_w=_could_hide(candidate),
                in_confidence_set=candidate.name in diagnosis.in_set,
                drive=fitter.prepared.names[drive],
                shape=candidate.active.parameters,
                coefficients={
                    name: [_short(v) for v in row]
                    for name, row in zip(fitter.prepared.names, values.tolist(), strict=True)
                },
                at_bound=fit.at_bound(drive, columns[lead]),
            )
        )
    out.sort(key=lambda row: (not row.in_confidence_set, -row.delta_rmse_w))
    return tuple(out)


def _column_size(candidate: Candidate, drive: int) -> Floats:
    size: Floats = np.sqrt(np.mean(np.square(candidate.columns[:, drive]), axis=0))
    return size


def _could_hide(candidate: Candidate) -> float:
    """W rms on the drive where most of the effect may be, at the interval's end."""
    ends = np.nan_to_num(candidate.intervals)
    used = [candidate.columns[:, drive] @ own for drive, own in enumerate(ends)]
    return float(np.sqrt([np.nanmean(np.square(own), axis=0) for own in used]).max())


def _families(diagnosis: Diagnosis) -> dict[str, str]:
    """Effects that explain the same in this recording, joined by slashes."""
    names = [candidate.name for candidate in diagnosis.singles]
    explained = [np.nan_to_num(candidate.explained).ravel() for candidate in diagnosis.singles]
    size = [float(np.linalg.norm(part)) for part in explained]
    tied = {name: {name} for name in names}
    for a in range(len(names)):
        for b in range(a):
            if min(size[a], size[b]) < _TOO_LITTLE * max(size):
                continue
            dot = float(explained[a] @ explained[b])
            if dot / (size[a] * size[b]) > _TIED:
                tied[names[a]].add(names[b])
                tied[names[b]].add(names[a])
    ties = {c.name: set(c.active.effect.ties) for c in diagnosis.singles}
    return {name: '/'.join(sorted(tied[name] | ties[name])) for name in names}


def _motion(
    diagnosis: Diagnosis, rows: Sequence[Row], catalogue: Catalogue, signals: Signals
) -> Motion:
    def motion(effects: Sequence[str], reason: str) -> Motion:
        usable = [name for name in effects if catalogue[name].usable(signals)]
        return separating_motion(usable, catalogue, signals.names, reason, signals.scale)

    if diagnosis.verdict == 'named':
        reason = 'to confirm what was named on a motion that shows it alone'
        return motion(diagnosis.effects, reason)
    if diagnosis.verdict == 'ambiguous':
        open_ = [name for name in diagnosis.effects if name not in diagnosis.certain]
        reason = f'to tell {" from ".join(open_)}'
        return motion(open_, reason)
    if diagnosis.verdict == 'none_of_the_above' and diagnosis.chosen == (CONSTANT_TORQUE,):
        return motion(diagnosis.chosen, 'to see the constant torque in both directions')
    if diagnosis.verdict == 'none_of_the_above':
        reason = 'to see the unknown at rest, over position at slow speed, and over speed and load'
        return motion(['idle', 'cogging', 'viscous_friction', 'inverter_loss'], reason)
    hidden = _could_be_there(diagnosis, rows)
    if hidden:
        reason = 'to show effects that could hide in this recording'
        return motion([row.name for row in hidden], reason)
    largest = sorted(rows, key=lambda row: -row.could_hide_w)[:_MOST_ASKED]
    reason = 'to look closer at what would come next'
    return motion([row.name for row in largest], reason)


def _could_be_there(diagnosis: Diagnosis, rows: Sequence[Row]) -> list[Row]:
    """Effects that other terms may have swallowed, the largest first."""
    least = _HIDES * float(np.max(diagnosis.floor))
    hidden = [r for r in rows if r.could_hide_w >= least and r.name != CONSTANT_TORQUE]
    return sorted(hidden, key=lambda row: -row.could_hide_w)[:_MOST_ASKED]


def _roots(values: Floats, names: Sequence[str]) -> dict[str, float]:
    return {n: _short(float(np.sqrt(max(v, 0.0)))) for n, v in zip(names, values, strict=True)}


def _values(values: Floats, names: Sequence[str]) -> dict[str, float | None]:
    return {
        n: _short(float(v)) if np.isfinite(v) else None for n, v in zip(names, values, strict=True)
    }


def _short(value: float) -> float:
    return float(f'{value:.5g}')
