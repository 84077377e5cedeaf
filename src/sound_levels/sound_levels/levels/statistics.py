"""Level statistics of a policy, and differences between policies with intervals."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from arch.bootstrap import optimal_block_length
from scipy.stats import ttest_ind
from wattwalk_core.arrays import Bools, Floats

from sound_levels.levels.meter import Sound

FIGURES = ('leq', 'l10', 'l50', 'l90')
_PIECE = 0.125  # s
_DRAWS = 1000
_SEED = 7
_LOWEST = 1e-30
ENOUGH = 4
"""Files of each policy below which the interval is reported to be wide for lack of files."""


@dataclass(frozen=True)
class Stretch:
    """Evaluated part of one sound, in pieces of 125 ms: mean squares [N] in any one unit.

    energy: mean over the piece. detector: with the time weighting, at the end of the piece. peak:
    largest value of the detector.
    """

    energy: Floats
    detector: Floats
    peak: float

    @classmethod
    def of(cls, sound: Sound, rows: Bools) -> 'Stretch':
        """Join the marked bins of a sound to pieces; an incomplete one at the end is left out."""
        length = max(1, round(_PIECE / sound.step))
        whole = int(rows.sum()) // length * length
        energy, detector = (
            values[rows][:whole].reshape(-1, length) for values in (sound.energy, sound.detector)
        )
        highest = float(sound.highest[rows].max(initial=0.0))
        return cls(energy.mean(axis=1), detector[:, -1], highest)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return len(self.energy) * _PIECE


@dataclass(frozen=True)
class Levels:
    """Levels in dB: `l10` is exceeded for 10 % of the time."""

    seconds: float
    leq: float
    l10: float
    l50: float
    l90: float
    max: float


@dataclass(frozen=True)
class Difference:
    """Difference in dB between two policies, and its 95 % interval."""

    value: float
    interval: tuple[float, float]


def levels(stretches: Sequence[Stretch], shift: float = 0.0) -> Levels:
    """Return the levels over all sounds of a policy together, plus `shift` dB."""
    peak = decibels(max(stretch.peak for stretch in stretches))
    found = np.append(_together(stretches), peak) + shift
    return Levels(sum(stretch.seconds for stretch in stretches), *found.tolist())


def differences(
    first: Sequence[Stretch], second: Sequence[Stretch]
) -> tuple[Mapping[str, Difference], float | None]:
    """Return the second policy's levels less the first's, by figure, and the block length in s.

    With at least two files of both, it is the difference of the mean levels of files, with Welch's
    t interval on these levels: files are independent, and variation within a file is contained in
    the variation between files. Block length None.

    With a single file of either, the variation between files is unknown, and intervals are those
    of a block bootstrap within each: neighbouring pieces correlate, so blocks are as long as the
    correlation lasts (Politis and White 2004). Of a policy with several files, files are drawn
    first, then blocks of them.
    """
    block = None
    if min(len(first), len(second)) > 1:
        sides = [np.stack([_together([one]) for one in side]) for side in (second, first)]
        value = sides[0].mean(axis=0) - sides[1].mean(axis=0)
        # Files of one level have no variance, of which scipy warns.
        with warnings.catch_warnings(action='ignore', category=RuntimeWarning):
            ends = ttest_ind(*sides, equal_var=False).confidence_interval(0.95)
        low, high = (np.where(np.isnan(end), value, end) for end in ends)
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


def _together(stretches: Sequence[Stretch]) -> Floats:
    """Return the figures of all sounds joined, [figure]."""
    return _figures([s.energy for s in stretches], [s.detector for s in stretches])


def block_length(stretch: Stretch) -> int:
    """Return the number of pieces over which the level correlates (Politis and White 2004)."""
    level = decibels(stretch.energy)
    if len(level) < 16 or np.ptp(level) < 1e-9:
        return 1
    found = float(optimal_block_length(level)['circular'].iloc[0])
    return int(np.clip(np.ceil(found), 1, max(1, len(level) // 4)))


def decibels(mean_square: Floats | float) -> Floats:
    """Return 10·log10 of mean squares, at least 1e-30."""
    return np.asarray(10.0 * np.log10(np.maximum(mean_square, _LOWEST)))


def _draws(stretches: Sequence[Stretch], block: int, random: np.random.Generator) -> Floats:
    """Return the figures of bootstrap samples, [figure, draw]."""
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
        columns.append(_figures(energy, detector))
    return np.stack(columns, axis=1)


def _figures(energy: Sequence[Floats], detector: Sequence[Floats]) -> Floats:
    """Return Leq, L10, L50, L90 of parts joined, [4]."""
    exceeded = np.quantile(np.concatenate(detector), [0.9, 0.5, 0.1])
    return decibels(np.append(np.concatenate(energy).mean(), exceeded))
