"""Sums of power over phases, as measured and in draws of what is uncertain."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats

TAILS = (0.05, 0.95)
UNEXPLAINED, METERED, ELECTRONICS = 'unexplained', 'metered', 'electronics'


@dataclass(frozen=True)
class Tally:
    """Power summed over the rows of P phases, of E parts and, last, the meter's reading.

    Entry 0 is the estimate, the others are draws. Tallies of several drives add up: the mean of
    a phase is that of all their rows in it, times the number of drives.
    """

    parts: tuple[str, ...]
    sums: Floats  # W [1 + R, P, E + 1]; the meter's are NaN where there is none
    counts: Floats  # rows [1 + R, P]
    drives: int = 1

    @classmethod
    def beside(cls, members: Sequence['Tally']) -> 'Tally':
        """The tally of several drives."""
        drives = sum(member.drives for member in members)
        return cls(members[0].parts, *_summed(members), drives)

    @classmethod
    def joined(cls, recordings: Sequence['Tally']) -> 'Tally':
        """The tally of the same drives over several recordings."""
        return cls(recordings[0].parts, *_summed(recordings), recordings[0].drives)

    def with_constant(self, part: str, watts: Floats) -> 'Tally':
        """The same with a constant draw, W [1 + R], as another part, which the meter sees too."""
        added = (watts[:, None] * self.counts / self.drives)[..., None]
        ends = self.sums[..., :-1], added, self.sums[..., -1:] + added
        return Tally((*self.parts, part), np.concatenate(ends, axis=2), self.counts, self.drives)

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the parts, what is unexplained, and the meter."""
        return (*self.parts, UNEXPLAINED, METERED)

    @property
    def means(self) -> Floats:
        """W in each phase of each of the rows [1 + R, P, E + 2]."""
        with np.errstate(invalid='ignore', divide='ignore'):
            means = self.sums / self.counts[..., None] * self.drives
        rest = means[..., -1:] - means[..., :-1].sum(axis=2, keepdims=True)
        return np.concatenate([means[..., :-1], rest, means[..., -1:]], axis=2)


def _summed(tallies: Sequence[Tally]) -> tuple[Floats, Floats]:
    sums = np.sum([tally.sums for tally in tallies], axis=0)
    return sums, np.sum([tally.counts for tally in tallies], axis=0)


def interval(draws: Floats) -> Floats:
    """The 90 % interval of an estimate and its draws [1 + R, …], which holds the estimate.

    A draw in which a rare phase did not occur has NaN, and says nothing against the estimate.
    NaN without draws.
    """
    if len(draws) < 2:
        return np.full((*draws.shape[1:], 2), np.nan)
    draws = np.where(np.isfinite(draws), draws, draws[:1])
    low, high = np.quantile(draws[1:], TAILS, axis=0)
    return np.stack([np.minimum(low, draws[0]), np.maximum(high, draws[0])], axis=-1)


def blocks_of(stretches: Sequence[slice], length: int) -> NDArray[np.intp]:
    """Number of the block of so many rows, or what is left of a stretch, of each row."""
    numbers, first = [np.empty(0, np.intp)], 0
    for part in stretches:
        own = np.arange(part.stop - part.start) // length
        numbers.append(first + own)
        first += int(own[-1]) + 1 if own.size else 0
    return np.concatenate(numbers)


def block_sums(
    rows: Floats, masks: Sequence[Bools], block: NDArray[np.intp], often: Floats
) -> tuple[Floats, Floats]:
    """Sums [1 + R, P, E] and counts [1 + R, P] of rows [N, E] in phases [P, N].

    First as they are, then with the blocks, numbered in block [N], drawn anew: each counts often
    [R, B].
    """
    weights = np.concatenate([np.ones((1, often.shape[1])), often])
    sums, counts = [], []
    for mask in masks:
        own = np.flatnonzero(mask)
        by_block = np.zeros((often.shape[1], rows.shape[1]))
        np.add.at(by_block, block[own], rows[own])
        sums.append(weights @ by_block)
        counts.append(weights @ np.bincount(block[own], minlength=often.shape[1]))
    return np.stack(sums, axis=1), np.stack(counts, axis=1)


PHASES: Final = ('all', 'driving', 'braking', 'rest', 'stance', 'swing')


def phase_masks(
    torque: Floats, velocity: Floats, standstill: Floats, feet: NDArray[np.str_] | None
) -> Mapping[str, Bools]:
    """Rows of each phase [N, D], from N·m and rad/s at 50 Hz; feet: words by leg, '' for none.

    At rest the speed is below standstill [D], whatever the load.
    """
    rest = np.abs(velocity) < standstill
    drives = torque * velocity >= 0.0
    found = {
        'all': np.ones(torque.shape, bool),
        'driving': drives & ~rest,
        'braking': ~drives & ~rest,
        'rest': rest,
    }
    if feet is not None:
        found |= {word: feet == word for word in ('stance', 'swing')}
    return found
