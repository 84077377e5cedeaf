"""What a policy sounds like in figures, and by how much one is louder than another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from arch.bootstrap import optimal_block_length
from numpy.typing import NDArray
from scipy.special import stdtrit

Floats = NDArray[np.float64]

FIGURES = ('leq', 'l10', 'l50', 'l90')
_PIECE = 0.125  # s
_DRAWS = 1000
_SEED = 7
_LOWEST = 1e-30
ENOUGH = 4
"""Files of each policy under which an interval from files is told to be wide for want of them."""


@dataclass(frozen=True)
class Stretch:
    """
    What counts of one sound, in pieces of 125 ms: mean squares [N] in any one unit.

    energy: mean over the piece. detector: with the time weighting, at its end. peak: the largest
    value of the detector.
    """

    name: str
    energy: Floats
    detector: Floats
    peak: float

    @classmethod
    def of(
        cls, name: str, step: float, energy: Floats, detector: Floats, highest: Floats
    ) -> 'Stretch':
        """Join bins of `step` s into pieces; a rest at the end is left out."""
        length = max(1, round(_PIECE / step))
        whole = len(energy) // length * length
        return cls(
            name,
            energy[:whole].reshape(-1, length).mean(axis=1),
            detector[:whole].reshape(-1, length)[:, -1],
            float(highest.max(initial=0.0)),
        )

    @property
    def seconds(self) -> float:
        """Duration."""
        return len(self.energy) * _PIECE


@dataclass(frozen=True)
class Levels:
    """Levels in dB re the unit of the mean squares: `l10` is exceeded for 10 % of the time."""

    seconds: float
    leq: float
    l10: float
    l50: float
    l90: float
    max: float


@dataclass(frozen=True)
class Difference:
    """By how many dB one policy is louder than another, and its 95 % interval."""

    value: float
    interval: tuple[float, float]


def levels(stretches: Sequence[Stretch]) -> Levels:
    """Levels over all of a policy's sounds together."""
    leq, l10, l50, l90 = _together(stretches).tolist()
    peak = float(decibels(np.array(max(s.peak for s in stretches))))
    return Levels(sum(s.seconds for s in stretches), leq, l10, l50, l90, peak)


def differences(
    first: Sequence[Stretch], second: Sequence[Stretch]
) -> tuple[Mapping[str, Difference], float | None]:
    """
    By how much the second policy is louder than the first, by figure; and the block length in s.

    With two files and more of both, it is the difference of the mean levels of files, and
    intervals are Welch's t on these levels: files count as independent, and whatever varies within
    one is in how files differ. Block length None.

    With a single file of either, what differs between files is unknown, and intervals are from a
    block bootstrap within each: neighbouring pieces resemble each other, so blocks are drawn that
    are as long as the likeness lasts (Politis and White 2004). Of a policy with several files,
    files are drawn first, then blocks of them.
    """
    block = None
    if min(len(first), len(second)) > 1:
        value, low, high = _welch(_each(first), _each(second))
    else:
        random = np.random.default_rng(_SEED)
        block = max(block_length(s) for s in (*first, *second))
        drawn = _draws(second, block, random) - _draws(first, block, random)
        value = _together(second) - _together(first)
        low, high = np.quantile(drawn, [0.025, 0.975], axis=1)
    found = {
        name: Difference(float(value[i]), (float(low[i]), float(high[i])))
        for i, name in enumerate(FIGURES)
    }
    return found, None if block is None else block * _PIECE


def _each(stretches: Sequence[Stretch]) -> Floats:
    """Figures of each sound, [sound, figure]."""
    return np.stack([_together([stretch]) for stretch in stretches])


def _together(stretches: Sequence[Stretch]) -> Floats:
    """Figures of all sounds joined, [figure]."""
    energy = np.concatenate([s.energy for s in stretches])
    detector = np.concatenate([s.detector for s in stretches])
    return _figures(energy[None], detector[None])[:, 0]


def _welch(first: Floats, second: Floats) -> tuple[Floats, Floats, Floats]:
    """Second less first, low and high of the mean levels [figure] (Welch 1947)."""
    value = second.mean(axis=0) - first.mean(axis=0)
    parts = np.stack([side.var(axis=0, ddof=1) / len(side) for side in (first, second)])
    error = parts.sum(axis=0)
    rest = parts**2 / np.array([[len(first) - 1.0], [len(second) - 1.0]])
    freedom = np.maximum(error**2 / np.maximum(rest.sum(axis=0), _LOWEST), 1.0)
    half = stdtrit(freedom, 0.975) * np.sqrt(error)
    return value, value - half, value + half


def block_length(stretch: Stretch) -> int:
    """How many pieces a block needs for what one piece says of the next to be within it."""
    level = decibels(stretch.energy)
    if len(level) < 16 or np.ptp(level) < 1e-9:
        return 1
    found = float(optimal_block_length(level)['circular'].iloc[0])
    return int(np.clip(np.ceil(found), 1, max(1, len(level) // 4)))


def decibels(mean_square: Floats) -> Floats:
    """Ten times the logarithm."""
    return np.asarray(10.0 * np.log10(np.maximum(mean_square, _LOWEST)))


def _draws(stretches: Sequence[Stretch], block: int, random: np.random.Generator) -> Floats:
    """Figures of bootstrap samples, [figure, draw]."""
    columns = []
    for _ in range(_DRAWS):
        chosen = stretches
        if len(stretches) > 1:
            chosen = [stretches[i] for i in random.integers(len(stretches), size=len(stretches))]
        energy, detector = [], []
        for stretch in chosen:
            count = len(stretch.energy)
            starts = random.integers(count, size=-(-count // block))
            index = (starts[:, None] + np.arange(block)).ravel()[:count] % count
            energy.append(stretch.energy[index])
            detector.append(stretch.detector[index])
        columns.append(_figures(np.concatenate(energy)[None], np.concatenate(detector)[None]))
    return np.concatenate(columns, axis=1)


def _figures(energy: Floats, detector: Floats) -> Floats:
    """Leq, L10, L50, L90 of rows, [4, rows]."""
    exceeded = np.quantile(detector, [0.9, 0.5, 0.1], axis=1)
    return decibels(np.concatenate([energy.mean(axis=1)[None], exceeded]))
