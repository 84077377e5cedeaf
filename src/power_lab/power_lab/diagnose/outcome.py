"""Diagnose a model on recordings: from files to the outcome that is printed and written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.model import PowerModel
from power_estimator.posterior.priors import LEAST_TO_JUDGE, MOST_SECONDS

from power_lab.compare.comparison import Comparison, comparison
from power_lab.compare.notes import notes
from power_lab.diagnose.diagnosis import diagnosed
from power_lab.diagnose.findings import Diagnosis, rounded_down, short
from power_lab.diagnose.measurement import MeasurementTerm, measurement_terms
from power_lab.diagnose.next_recording import Motion, separating_motion
from power_lab.diagnose.verdict import remainder, sentence, to_add, to_do, to_learn, undecided
from power_lab.structure.words import in_words


@dataclass(frozen=True)
class JudgedSteps:
    """Held-out errors of a model, and of it with the named effects added one by one.

    A model of other recordings comes twice: as given, and refitted on these.
    """

    comparison: Comparison
    first: int  # index of the model that is judged as the steps are

    @property
    def model(self) -> JudgedModel:
        """The model as given."""
        return self.comparison.models[0]

    @property
    def steps(self) -> tuple[JudgedModel, ...]:
        """The model, then with one, two … named effects, all held out alike."""
        return self.comparison.models[self.first :]

    @property
    def before(self) -> JudgedModel:
        """The model without named effects, held out as `after` is."""
        return self.comparison.models[self.first]

    @property
    def after(self) -> JudgedModel:
        """The model with all effects that the diagnosis names."""
        return self.comparison.models[-1]


def judged_steps(
    judge: Judge, given: PowerModel, model: EffectModel, diagnosis: Diagnosis, spec: str
) -> JudgedSteps:
    """Judge a model as given, and with the named effects added one by one; spec: name to show."""

    def grown(actives: tuple[Active, ...], name: str) -> EffectModel:
        known = (
            replace(active, effect=judge.catalogue[active.name])
            if whole and active.name in judge.catalogue and active.effect.kind == 'physics'
            else active
            for active in actives
        )
        own = (
            replace(one, shape=shapes.get(one.name, one.shape)) for one in model.structure.actives
        )
        structure = Structure((*own, *known))
        return replace(model, name=name, structure=structure, groups=(), fitted_on=(), history=())

    whole = judge.prepared.whole
    shapes = {} if whole else {one.name: one.shape for one in diagnosis.found.known}
    actives = diagnosis.actives
    names = [in_words(one.name) for one in actives]
    models: list[PowerModel] = [
        grown(actives[:count], f'+ {", ".join(names[:count])}')
        for count in range(1, len(actives) + 1)
    ]
    elsewhere = not (given is model and judge.refits(model))
    if elsewhere and models:
        models.insert(0, grown((), f'{model.name}, refitted here'))
    found = comparison(judge, [given, *models], [spec, *(one.name for one in models)])
    return JudgedSteps(found, int(elsewhere and bool(models)))


_MOST_ASKED = 3


@dataclass(frozen=True, repr=False)
class Outcome:
    """Complete result of a diagnosis."""

    model: EffectModel
    loaded: Loaded
    catalogue: Catalogue
    diagnosis: Diagnosis
    measurement: dict[str, MeasurementTerm]
    judged: JudgedSteps
    motion: Motion
    seconds: float  # of the recordings, of which the diagnosis may have judged on pieces

    def __str__(self) -> str:
        return '\n'.join(self.lines)

    __repr__ = __str__

    @property
    def prepared(self) -> Prepared:
        """Signals that were judged."""
        return self.diagnosis.prepared

    @property
    def verdict(self) -> str:
        """`named`, `ambiguous`, `none_of_the_above` or `no_evidence`."""
        return self.diagnosis.verdict

    @cached_property
    def sentence(self) -> str:
        """The verdict in words."""
        return sentence(self.diagnosis, *self._errors)

    @property
    def next_effects(self) -> tuple[str, ...]:
        """Names of the effects to add to the model; empty where held-out data supports none."""
        return to_add(self.diagnosis, *self._errors)

    @property
    def to_learn(self) -> bool:
        """True where `discover` may learn what no known effect explains."""
        return to_learn(self.diagnosis)

    @cached_property
    def headline(self) -> str:
        """Error of a sensor that is beyond what such sensors are known for, '' for none."""
        far = [term for term in self.measurement.values() if term.far_out]
        return max(far, key=lambda term: term.watts).sentence if far else ''

    @cached_property
    def lines(self) -> list[str]:
        """Headline of the measurement, verdict, what is left and what to do, a line each.

        Then the other errors of the measurement that matter, with what would check them.
        """
        left = remainder(self.diagnosis, self._errors[1])
        next_step = to_do(self.diagnosis, *self._errors)
        verdict = [self.headline, self.sentence, *undecided(self.diagnosis), left, next_step]
        first = [one for one in verdict if one]
        matter = [term for term in self.measurement.values() if term.matters]
        matter.sort(key=lambda term: -term.watts)
        return list(dict.fromkeys([*first, *(term.sentence for term in matter)]))

    @cached_property
    def notes(self) -> list[str]:
        """Sentences on what the verdict rests on, each one a limit or a doubt."""
        found = [line for line in self.lines if line != self.sentence]
        shapes = {one.name: one.shape for one in self.diagnosis.found.known}
        for one in self.model.structure.actives:
            better = shapes.get(one.name, one.shape)
            if better != one.shape:
                old, new = (
                    ', '.join(f'{name} = {value:g}' for name, value in shape)
                    for shape in (one.shape, better)
                )
                found.append(f'{in_words(one.name)} fits better with {new} than with {old}')
        if self.prepared.seconds < self.seconds - 1.0:
            judged = f'judged on {self.prepared.seconds:.0f} of {self.seconds:.0f} s'
            found.append(f'{judged}, in pieces spread over the recordings')
        return [*found, *notes(self.prepared)]

    @property
    def limits(self) -> list[dict[str, Any]]:
        """Effects that these recordings cannot decide on, with the motion that would, for JSON."""
        drives = len(self.prepared.signals.names)
        return [
            {
                'effect': one.name,
                'probability': rounded_down(one.probability, 4),
                'up_to_w': short(one.explains[2]),
                'needs': self.catalogue[one.name].excitation.told(drives),
            }
            for one in self.diagnosis.open
        ]

    @property
    def _errors(self) -> tuple[float, float]:
        return self.judged.before.rms_w, self.judged.after.rms_w

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `diagnose --json` writes them."""
        d, names, noise = self.diagnosis, self.prepared.names, self.prepared.noise.tolist()
        left = self.judged.comparison.regimes[-1]
        model, after = self.judged.model.drives, self.judged.after.drives
        missed = float(np.nansum(d.best.mean_mse))
        residual = 0.0 if d.residual is None else d.residual.rms_w**2 * len(d.best.mean_mse)
        return {
            'verdict': d.verdict,
            'sentence': self.sentence,
            'notes': self.notes,
            'effects': list(d.effects),
            'any_missing': rounded_down(d.found.any_missing, 4),
            'undecided': [
                {'effects': list(one.names), 'probability': rounded_down(one.probability, 4)}
                for one in d.found.undecided
            ],
            'active': list(self.model.effects),
            'measurement': {name: term.json() for name, term in self.measurement.items()},
            'candidates': [one.json() for one in d.candidates],
            'leftover': {
                'r2': short(residual / max(missed, 1e-12)),
                'worst': left[0].json() if left else None,
            },
            'unexplained': {'rms_w': short(d.left.rms_w), 'of_power': short(d.left.of_power)},
            'residual': None if d.residual is None else d.residual.json(),
            'limits': self.limits,
            'next_recording': self.motion.content(),
            'drives': {
                name: {
                    'rmse_w': model[name].json()['rmse_w'],
                    'rmse_after_w': after[name].json()['rmse_w'],
                    'sensor_noise_w': short(watts) if np.isfinite(watts) else None,
                }
                for name, watts in zip(names, noise, strict=True)
            },
            'judged_on_s': round(self.prepared.seconds, 2),
            'of_s': round(self.seconds, 2),
        }


def diagnose(
    judge: Judge,
    model: PowerModel,
    spec: str,
    seed: int = 0,
    show: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Find the effects that a model misses on the judge's recordings.

    A network or proxy (named by spec) is taken as the base that effects are added to; a network
    trained on the recordings counts on its test part only. show: takes texts of progress.
    InputError for recordings that are too short or too still.
    """
    loaded, catalogue, given = judge.recordings, judge.catalogue, model
    if not isinstance(model, EffectModel):
        model = EffectModel(model.name, Structure(()), base=spec)
    own = judge.material_under(model, LEAST_TO_JUDGE)
    seconds = own.prepared.seconds
    if not any(catalogue[name].remembers for name in catalogue):
        own = own.at_most(MOST_SECONDS)
    diagnosis = diagnosed(own, model.structure.actives, catalogue, seed, show)
    show('judging the steps on held-out data')
    judged = judged_steps(judge, given, model, diagnosis, spec)
    left = diagnosis.left.within(judged.before.rmse, judged.after.rmse)
    diagnosis, prepared = replace(diagnosis, left=left), diagnosis.prepared
    rms_w, signals = judged.before.rms_w, prepared.signals
    measurement = measurement_terms(diagnosis.found, prepared, rms_w, diagnosis.apart)
    effects, reason = _to_show(diagnosis)
    usable = [name for name in effects if catalogue[name].usable(signals)]
    motion = separating_motion(usable, catalogue, signals.names, reason, signals.scale)
    return Outcome(
        model=model,
        loaded=loaded,
        catalogue=catalogue,
        diagnosis=diagnosis,
        measurement=measurement,
        judged=judged,
        motion=motion,
        seconds=seconds,
    )


def _to_show(diagnosis: Diagnosis) -> tuple[Sequence[str], str]:
    """Effects that the next recording is to show, and the reason."""
    effects = diagnosis.effects
    if diagnosis.verdict == 'named':
        return effects, 'to confirm what was named on a motion that shows it alone'
    if len(effects) > 1:
        return effects, f'to tell {" from ".join(effects)}'
    if effects or diagnosis.uncertain is not None:
        name = effects[0] if diagnosis.uncertain is None else diagnosis.uncertain.name
        return [name], f'to see whether {name} is missing'
    if diagnosis.verdict == 'none_of_the_above':
        reason = 'to see the unknown at rest, over position at slow speed, and over speed and load'
        return ['idle', 'cogging', 'viscous_friction', 'inverter_loss'], reason
    by_watts = sorted(diagnosis.candidates, key=lambda one: -one.explains[2])
    hidden = [one.name for one in diagnosis.open or by_watts][:_MOST_ASKED]
    return hidden, 'to show effects that could hide in this recording'
