"""Parts of a discovery: effects, finalists, bounds and the check of a file."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from power_estimator.effects import Effect, load_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.judge.evidence import Evidence
from wattwalk_core.arrays import Floats

from power_lab.discover.effect_file import Written, effect_source
from power_lab.discover.formula import Formula
from power_lab.discover.known import Examined, Named, explained_w
from power_lab.discover.selection import Option
from power_lab.structure.floors import above_floor
from power_lab.structure.in_time import InTime
from power_lab.structure.shapes import LearnedShape

_BOOTSTRAPS = 200
_WIDER = 3.0  # times the bootstrap's interval, for the bounds of a file


@dataclass(frozen=True)
class Found:
    """Discovered effect: its formula, what it explains, and on which drives."""

    name: str
    kind: str
    drives: tuple[int, ...]
    gain: Floats  # W² [D], held out, in a fit of the whole model
    interval: tuple[float, float]  # W, of what it explains
    formula: Formula | None = None  # None for what lives in time alone
    effect: Effect | None = None
    written: Written | None = None
    shapes: Mapping[int, LearnedShape] | None = None
    course: InTime | None = None
    kept: float = 1.0  # share of the free shape's gain
    coefficients: Mapping[int, tuple[float, ...]] | None = None
    coefficient_intervals: Mapping[int, tuple[tuple[float, float], ...]] | None = None
    rivals: tuple[tuple[str, float], ...] = ()  # other explanations, W that they leave more

    @property
    def explains(self) -> float:
        """Rms power that it explains over its drives, W."""
        return explained_w(self.gain, self.drives)


@dataclass(frozen=True)
class Discovery:
    """Effects that were found, with held-out evidence before and after."""

    found: tuple[Found, ...]
    base: Evidence
    best: Evidence
    floor: Floats  # W [D]
    chance: float  # that the first effect's gain is chance
    nothing: str  # reason where nothing was found
    named: tuple[Named, ...] = ()  # of the catalogue, that the model has to have first

    @property
    def actives(self) -> tuple[Active, ...]:
        """Effects that the model lacks, of the catalogue and learned."""
        learned = (Active.of(one.effect) for one in self.found if one.effect is not None)
        return (*(one.active for one in self.named), *learned)


@dataclass(frozen=True)
class Finalist:
    """Formula that was refitted with the whole model, and its held-out gain."""

    option: Option
    name: str
    formula: Formula
    effect: Effect
    after: Evidence
    gain: Floats  # W² [D]


def interval_of(
    before: Evidence, after: Evidence, drives: Sequence[int], seed: int
) -> tuple[float, float]:
    """95 % interval of the rms power in W that is explained over drives, by a block bootstrap."""
    falls = (before.mse - after.mse)[:, list(drives)]
    known = np.isfinite(falls)
    fall = np.where(known, falls, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    low, high = np.quantile(drawn_means(fall, _BOOTSTRAPS, seed), (0.025, 0.975))
    return float(np.sign(low) * np.sqrt(abs(low))), float(np.sqrt(max(high, 0.0)))


def drawn_means(blocks: Floats, count: int, seed: int) -> Floats:
    """Bootstrap means [count] of values by block [B]; five successive ones are drawn at once."""
    random, size = np.random.default_rng(seed), min(5, len(blocks))
    starts = random.integers(0, len(blocks) - size + 1, (count, -(-len(blocks) // size)))
    return blocks[(starts[..., None] + np.arange(size)).reshape(count, -1)].mean(axis=1)


def bounds_of(between: Floats, values: Floats) -> list[tuple[float, float]]:
    """Bounds of each coefficient from intervals [d, n, 2] and coefficients [d, n] of one fit.

    Wider than the bootstrap's interval, so that another recording may differ; they keep the sign
    where interval and coefficients do, and hold all coefficients.
    """
    out = []
    for term in range(between.shape[1]):
        low = float(min(between[:, term, 0].min(), values[:, term].min()))
        high = float(max(between[:, term, 1].max(), values[:, term].max()))
        room = max(_WIDER * (high - low), 0.5 * max(abs(low), abs(high)))
        wide_low = max(low - room, 0.0) if low > 0.0 else low - room
        wide_high = min(high + room, 0.0) if high < 0.0 else high + room
        out.append((float(f'{wide_low:.4g}'), float(f'{wide_high:.4g}')))
    return out


def check_bounds(found: Sequence[Found]) -> None:
    """Raise ValueError where the bounds of an effect exclude one of its own coefficients."""
    for one in found:
        if one.effect is None or one.coefficients is None:
            continue
        for values in one.coefficients.values():
            for term, value in zip(one.effect.terms, values, strict=True):
                if not term.lower <= value <= term.upper:
                    raise ValueError(
                        f'{one.name}: {term.symbol} = {value:.4g} {term.unit} is outside its '
                        f'bounds {term.lower:.4g} … {term.upper:.4g}'
                    )


def load_effect(written: Written) -> Effect:
    """Write an effect to a temporary file and load it, with the checks of any user's file."""
    with tempfile.TemporaryDirectory(prefix='discover') as folder:
        path = Path(folder) / 'effect.py'
        path.write_text(effect_source([written], ()), encoding='utf-8')
        return load_catalogue([path])[written.name]


def without_superseded(
    found: Sequence[Found], best: Evidence, structure: Structure, examined: Examined, floor: Floats
) -> tuple[list[Found], Evidence]:
    """Drop effects that later ones make superfluous; return the others, largest first, and fit.

    For example a drift in time whose cause is found after it, or a square that stood for an excess
    over a limit. best, structure: fit and terms with all; examined: refits terms; floor: W [D].
    """
    kept = list(found)
    for one in found:
        if len(kept) < 2:
            break
        less = structure.without(one.name)
        trial = examined(less, best)
        if not above_floor(trial.mean_mse - best.mean_mse, floor):
            structure, best = less, trial
            kept.remove(one)
    if len(kept) < len(found):
        kept = _judged_anew(kept, best, structure, examined)
    return sorted(kept, key=lambda one: -float(one.gain.sum())), best


def _judged_anew(
    kept: Sequence[Found], best: Evidence, structure: Structure, examined: Examined
) -> list[Found]:
    """The effects with what each explains on top of those before it."""
    for one in kept:
        structure = structure.without(one.name)
    before, out = examined(structure, best), []
    for one in kept:
        assert one.effect is not None
        structure = structure.plus(Active.of(one.effect))
        after = examined(structure, before)
        gain, drives = np.zeros(len(one.gain)), list(one.drives)
        gain[drives] = (before.mean_mse - after.mean_mse)[drives]
        out.append(replace(one, gain=gain, interval=interval_of(before, after, drives, 0)))
        before = after
    return out
