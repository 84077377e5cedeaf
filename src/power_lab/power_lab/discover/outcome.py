"""Discover on recordings: from files to what is printed and written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import LEAST_SECONDS, Material
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.model import PowerModel
from wattwalk_core.errors import InputError, printable

from power_lab.discover.discovery import Discoverer
from power_lab.discover.effect_file import effect_source
from power_lab.discover.found import Discovery, Found, check_bounds
from power_lab.discover.selection import KEEPS
from power_lab.discover.transfer import OtherRecording, Transfer
from power_lab.structure.words import in_words

Show = Callable[[str], None]


@dataclass(frozen=True)
class DiscoveryOutcome:
    """Everything that discover tells."""

    model: EffectModel
    loaded: Loaded
    own: Material
    discoverer: Discoverer
    discovery: Discovery
    before: JudgedModel  # the model
    after: JudgedModel  # with all that was found that is no time alone
    transfers: tuple[Transfer | None, ...]  # by what was found
    tested_on: tuple[str, ...]

    @property
    def written(self) -> list[Found]:
        """Effects that go into the file."""
        return [one for one in self.discovery.found if one.written is not None]

    def source(self) -> str:
        """Text of the file of effects."""
        check_bounds(self.written)
        names = [entry['name'] for entry in self.loaded.identities]
        return effect_source([one.written for one in self.written if one.written], names)

    @property
    def sentence(self) -> str:
        """Result in words."""
        found, first = self.discovery.found, self._first
        if not found:
            beyond = 'Beyond that nothing' if first else 'Nothing'
            return f'{first}{beyond} is proposed: {self.discovery.nothing}.'
        parts = [
            self.told(one, transfer) for one, transfer in zip(found, self.transfers, strict=True)
        ]
        return first + ' '.join(parts)

    @property
    def _first(self) -> str:
        """Named effects that the model lacks, in a sentence, '' for none."""
        named = self.discovery.named
        if not named:
            return ''
        words = ' and '.join(f'{in_words(one.name)} ({one.explains:.2f} W)' for one in named)
        them = 'it' if len(named) == 1 else 'them'
        return f'The catalogue names {words}: add {them} first. '

    def told(self, one: Found, transfer: Transfer | None) -> str:
        """One effect in a sentence."""
        names = ', '.join(printable(self.own.prepared.names[d]) for d in one.drives)
        watts = f'{one.explains:.2f} W'
        if one.course is not None:
            course = one.course
            return (
                f'{watts} on {names} live in time alone: {course.shape.words}, '
                f'{course.amplitude:.1f} W high. '
                'This is no physics of the drive; look for what else runs at that time.'
            )
        assert one.written is not None
        text = f'{one.name}: {printable(one.written.physics)}; it explains {watts} on {names}'
        if one.kept < KEEPS:
            text += f'; the formula keeps only {one.kept:.0%} of the shape that was learned'
        if transfer is None:
            return f'{text}; no other recording has borne it out yet.'
        return f'{text}; {printable(transfer.reason)}.'

    def json(self) -> dict[str, Any]:
        """As `discover --json` writes it."""
        names = self.own.prepared.names
        d = self.discovery
        return {
            'found': [
                self._one(one, transfer)
                for one, transfer in zip(d.found, self.transfers, strict=True)
            ],
            'named': [
                {
                    'name': one.name,
                    'drives': [names[drive] for drive in one.drives],
                    'explains_w': _short(one.explains),
                }
                for one in d.named
            ],
            'sentence': self.sentence,
            'nothing': None if d.found else d.nothing,
            'chance': _short(d.chance),
            'model': self.model.name,
            'recordings': [entry['name'] for entry in self.loaded.identities],
            'tested_on': list(self.tested_on),
            'drives': {
                name: {
                    'rmse_w': self.before.drives[name].json()['rmse_w'],
                    'rmse_after_w': self.after.drives[name].json()['rmse_w'],
                    'floor_w': _short(float(d.floor[i])),
                    'sensor_noise_w': _finite(float(self.own.prepared.noise[i])),
                }
                for i, name in enumerate(names)
            },
        }

    def _one(self, one: Found, transfer: Transfer | None) -> dict[str, Any]:
        names = self.own.prepared.names
        content: dict[str, Any] = {
            'name': one.name,
            'kind': one.kind,
            'drives': [names[d] for d in one.drives],
            'formula': _course_text(one) if one.formula is None else one.formula.text(),
            'bounds': {},
            'explains_w': _short(one.explains),
            'interval': [_short(bound) for bound in one.interval],
            'transfers': None if transfer is None else transfer.transfers,
            'sentence': self.told(one, transfer),
            'in_file': one.written is not None,
        }
        if one.course is not None:
            period = one.course.shape.period
            content['period_s'] = _short(period) if period else None
        if one.formula is None or one.written is None:
            return content
        content |= {
            'physics': one.written.physics,
            'acts_on': one.formula.family.acts_on,
            'memory': one.formula.family.driver.memory or None,
            'bounds': {name: dict(given) for name, given in one.written.places.items()},
            'formulas': {names[d]: one.formula.text(d) for d in one.formula.places},
            'unit': one.formula.unit,
            'coefficients': {
                names[d]: [_short(v) for v in values]
                for d, values in (one.coefficients or {}).items()
            },
            'intervals': {
                names[d]: [[_short(a), _short(b)] for a, b in values]
                for d, values in (one.coefficient_intervals or {}).items()
            },
            'keeps': _short(one.kept),
            'near': list(one.written.near),
            'excitation': dict(one.written.excitation),
            'rivals': [{'formula': text, 'leaves_w': _short(watts)} for text, watts in one.rivals],
        }
        if transfer is not None:
            content['other_recording'] = {
                'rmse_before_w': dict(
                    zip(transfer.drives, map(_short, transfer.before), strict=True)
                ),
                'rmse_after_w': dict(
                    zip(transfer.drives, map(_short, transfer.after), strict=True)
                ),
                'reason': transfer.reason,
            }
        return content


def _course_text(one: Found) -> str:
    assert one.course is not None
    return f'P = s(t), {one.course.shape.words}'


def discover(
    judge: Judge,
    model: PowerModel,
    spec: str,
    test: Loaded | None = None,
    show: Show = lambda text: None,
    seed: int = 0,
) -> DiscoveryOutcome:
    """Learn what the model misses on the judge's recordings, and test it on another one.

    InputError for recordings that are too short or too still, and where only the whole robot was
    metered.
    """
    loaded, catalogue, given = judge.recordings, judge.catalogue, model
    if not isinstance(model, EffectModel):
        model = EffectModel(model.name, Structure(()), base=spec)
    own = judge.material_under(model, LEAST_SECONDS)
    if own.prepared.whole:
        raise InputError(
            'only the whole robot was metered: which drive an unknown effect is in cannot be '
            'told; meter the drives (topic drive_supply)'
        )
    fitter = own.fitter(per_drive=True)
    terms = measurement_terms(catalogue, shaft='shaft' in model.effects)
    structure = own.structure(model.structure.actives).plus(*terms)
    discoverer = Discoverer(fitter, structure, catalogue, show, seed)
    discovery = discoverer.run()
    better = replace(
        model, structure=model.structure.plus(*discovery.actives), groups=(), fitted_on=()
    )
    before, after = judge.compare([given, better])
    transfers: list[Transfer | None] = [None] * len(discovery.found)
    if test is not None and any(one.written for one in discovery.found):
        show('testing on another recording')
        transfers = _tested(test, judge, own, model, discovery)
    return DiscoveryOutcome(
        model=model,
        loaded=loaded,
        own=own,
        discoverer=discoverer,
        discovery=discovery,
        before=before,
        after=after,
        transfers=tuple(transfers),
        tested_on=() if test is None else tuple(entry['name'] for entry in test.identities),
    )


def _tested(
    test: Loaded,
    judge: Judge,
    own: Material,
    model: EffectModel,
    discovery: Discovery,
) -> list[Transfer | None]:
    """Each effect on the other recording, on top of those before it."""
    effects = {one.name: one.effect for one in discovery.found if one.written and one.effect}
    whole = Catalogue([*judge.catalogue.values(), *effects.values()])
    on_test = Judge(test, whole, judge.settings)
    other = OtherRecording(on_test, own, judge.recordings, model.base)
    actives = [*model.structure.actives, *(one.active for one in discovery.named)]
    before = other.score(actives)
    out: list[Transfer | None] = []
    for one in discovery.found:
        if one.written is None or one.effect is None:
            out.append(None)
            continue
        actives.append(Active.of(one.effect))
        after = other.score(actives)
        names = [own.prepared.names[d] for d in one.drives]
        out.append(other.transfer(names, before, after, one.explains))
        before = after
    return out


def split(bags: Sequence[Any], test: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Recordings to learn from and to test on: the last of several, where none is named."""
    if test or len(bags) < 2:
        return list(bags), list(test)
    return list(bags[:-1]), list(bags[-1:])


def _short(value: float) -> float:
    return float(f'{value:.5g}')


def _finite(value: float) -> float | None:
    return _short(value) if np.isfinite(value) else None
