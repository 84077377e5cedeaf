"""Discover on recordings: from files to what is printed and written."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import LEAST_SECONDS, Material, fit_model
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import on_base
from power_estimator.model import PowerModel
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, printable

from power_lab.diagnose.findings import short
from power_lab.discover.discovery import Discoverer, Show
from power_lab.discover.effect_file import effect_source
from power_lab.discover.found import Discovery, Found, check_bounds, drawn_means
from power_lab.discover.selection import KEEPS
from power_lab.structure.words import in_words

_BOOTSTRAPS = 400
_LEAST_FALL = 0.05  # of the squared error, to be borne out
_LEAST_SHOWN = 0.15  # of what it explains in its own recording, for the other to tell


@dataclass(frozen=True)
class Transfer:
    """Errors on another recording without and with the effect, W by drive."""

    drives: tuple[str, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    transfers: bool | None  # None where the other recording does not show it
    reason: str
    time: Floats  # s [N]
    measured: Floats  # W [N, d]
    residuals: tuple[Floats, Floats]  # W [N, d], without and with it


def transfer_to(
    judge: Judge, drives: Sequence[str], before: JudgedModel, after: JudgedModel, explains: float
) -> Transfer:
    """Judge whether an effect lowers the error of the named drives on another recording, too.

    judge: of that recording; before, after: scores without and with the effect; explains: W rms,
    in its own recording.
    """
    prepared = judge.prepared
    shared = [name for name in drives if name in prepared.names]
    columns = [prepared.names.index(name) for name in shared]
    errors = [tuple(j.drives[name].rmse_w for name in shared) for j in (before, after)]
    parts = (before.residual[:, columns], after.residual[:, columns])
    change = (after.estimated - before.estimated)[:, columns]
    verdict = _verdict(parts, change, explains, Blocks.of(prepared, judge.settings.fit).rows)
    measured = before.measured[:, columns]
    return Transfer(tuple(shared), errors[0], errors[1], *verdict, prepared.time, measured, parts)


def _verdict(
    parts: tuple[Floats, Floats], change: Floats, explains: float, rows: NDArray[np.intp]
) -> tuple[bool | None, str]:
    """Whether an effect transfers, and why.

    parts: residuals without and with it, W [N, d]; change: of the estimate by it, W [N, d];
    explains: as in `transfer_to`; rows: of each block [B, L].
    """
    if not change.size:
        return None, 'the other recording has none of its drives'
    moved = np.nanstd(change)
    if moved < _LEAST_SHOWN * explains:
        return None, f'the other recording hardly shows it ({moved:.2f} W)'
    fall = np.square(parts[0]) - np.square(parts[1])
    by_block = np.nanmean(fall[rows].reshape(len(rows), -1), axis=1)
    by_block = by_block[np.isfinite(by_block)]
    drawn = drawn_means(by_block, _BOOTSTRAPS, seed=0)
    whole = float(np.nanmean(np.square(parts[0])))
    share = float(by_block.mean()) / max(whole, 1e-12)
    if float(np.quantile(drawn, 0.025)) > 0.0 and share >= _LEAST_FALL:
        return True, f'it takes {share:.0%} off the squared error of the other recording'
    return False, (
        f'it changes the squared error of the other recording by {-share:+.0%}: not borne out'
    )


@dataclass(frozen=True)
class DiscoveryOutcome:
    """Complete result of a discovery."""

    model: EffectModel
    loaded: Loaded
    own: Material
    discoverer: Discoverer
    discovery: Discovery
    before: JudgedModel  # the model
    after: JudgedModel  # with all that was found that is no time alone
    transfers: tuple[Transfer | None, ...]  # by what was found
    tested_on: tuple[str, ...]

    def __str__(self) -> str:
        return self.sentence

    @property
    def written(self) -> list[Found]:
        """Effects that go into the file."""
        return [one for one in self.discovery.found if one.written is not None]

    def source(self) -> str:
        """Python text of the effect file; ValueError for bounds that exclude a coefficient."""
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
        """Describe one effect, and its test on the other recording, in a sentence."""
        names = ', '.join(printable(self.own.prepared.names[d]) for d in one.drives)
        watts = f'{one.explains:.2f} W'
        if one.course is not None:
            high = f'{one.course.shape.words}, {one.course.amplitude:.1f} W high'
            look = 'This is no physics of the drive; look for what else runs at that time.'
            return f'{watts} on {names} live in time alone: {high}. {look}'
        assert one.written is not None
        text = f'{one.name}: {printable(one.written.physics)}; it explains {watts} on {names}'
        if one.kept < KEEPS:
            text += f'; the formula keeps only {one.kept:.0%} of the shape that was learned'
        if transfer is None:
            return f'{text}; no other recording has borne it out yet.'
        return f'{text}; {printable(transfer.reason)}.'

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `discover --json` writes them."""
        d, names = self.discovery, self.own.prepared.names
        noise = self.own.prepared.noise.tolist()
        return {
            'found': [
                self._one(one, transfer)
                for one, transfer in zip(d.found, self.transfers, strict=True)
            ],
            'named': [
                {
                    'name': one.name,
                    'drives': [names[drive] for drive in one.drives],
                    'explains_w': short(one.explains),
                }
                for one in d.named
            ],
            'sentence': self.sentence,
            'nothing': None if d.found else d.nothing,
            'chance': short(d.chance),
            'model': self.model.name,
            'recordings': [entry['name'] for entry in self.loaded.identities],
            'tested_on': list(self.tested_on),
            'drives': {
                name: {
                    'rmse_w': self.before.drives[name].json()['rmse_w'],
                    'rmse_after_w': self.after.drives[name].json()['rmse_w'],
                    'floor_w': short(floor),
                    'sensor_noise_w': short(watts) if np.isfinite(watts) else None,
                }
                for name, floor, watts in zip(names, d.floor.tolist(), noise, strict=True)
            },
        }

    def _one(self, one: Found, transfer: Transfer | None) -> dict[str, Any]:
        names = self.own.prepared.names
        text = '' if one.formula is None else one.formula.text()
        content: dict[str, Any] = {
            'name': one.name,
            'kind': one.kind,
            'drives': [names[d] for d in one.drives],
            'formula': text if one.course is None else f'P = s(t), {one.course.shape.words}',
            'bounds': {},
            'explains_w': short(one.explains),
            'interval': [short(bound) for bound in one.interval],
            'transfers': None if transfer is None else transfer.transfers,
            'sentence': self.told(one, transfer),
            'in_file': one.written is not None,
        }
        if one.course is not None:
            period = one.course.shape.period
            content['period_s'] = short(period) if period else None
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
                names[d]: [short(v) for v in values]
                for d, values in (one.coefficients or {}).items()
            },
            'intervals': {
                names[d]: [[short(a), short(b)] for a, b in values]
                for d, values in (one.coefficient_intervals or {}).items()
            },
            'keeps': short(one.kept),
            'near': list(one.written.near),
            'excitation': dict(one.written.excitation),
            'rivals': [{'formula': text, 'leaves_w': short(watts)} for text, watts in one.rivals],
        }
        if transfer is not None:
            before, after = (
                dict(zip(transfer.drives, map(short, errors), strict=True))
                for errors in (transfer.before, transfer.after)
            )
            content['other_recording'] = {
                'rmse_before_w': before,
                'rmse_after_w': after,
                'reason': transfer.reason,
            }
        return content


def discover(
    judge: Judge,
    model: PowerModel,
    spec: str,
    test: Loaded | None = None,
    show: Show = lambda text: None,
    seed: int = 0,
) -> DiscoveryOutcome:
    """Learn what a model misses on the judge's recordings, and test it on another one.

    spec: file or name of the model; test: the other recording; show: takes texts of progress.
    InputError for recordings that are too short, too still, or have no meter for each drive.
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
    with_found = model.structure.plus(*discovery.actives)
    better = replace(model, structure=with_found, groups=(), fitted_on=())
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
    test: Loaded, judge: Judge, own: Material, model: EffectModel, discovery: Discovery
) -> list[Transfer | None]:
    """Each effect on the other recording, on top of those before it."""
    effects = {one.name: one.effect for one in discovery.found if one.written and one.effect}
    whole = Catalogue([*judge.catalogue.values(), *effects.values()])
    on_test, under = Judge(test, whole, judge.settings), judge.base(model.base)
    fitted_on = judge.recordings.identities

    def score(actives: Sequence[Active]) -> JudgedModel:
        """Fit effects to the first recording, and judge them on the other one."""
        fitted, _ = fit_model('trial', own, actives, whole, base=model.base, fitted_on=fitted_on)
        return on_test.score(on_base(fitted, under))

    actives = [*model.structure.actives, *(one.active for one in discovery.named)]
    before = score(actives)
    out: list[Transfer | None] = []
    for one in discovery.found:
        if one.written is None or one.effect is None:
            out.append(None)
            continue
        actives.append(Active.of(one.effect))
        after = score(actives)
        names = [own.prepared.names[d] for d in one.drives]
        out.append(transfer_to(on_test, names, before, after, one.explains))
        before = after
    return out


def split(bags: Sequence[Any], test: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Split recordings into those to learn from and to test on, by default the last of several."""
    if test or len(bags) < 2:
        return list(bags), list(test)
    return list(bags[:-1]), list(bags[-1:])
