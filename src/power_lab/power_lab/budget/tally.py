"""Sums of power over phases, as measured and in draws of what is uncertain."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
        """Add tallies of different drives over the same rows."""
        return replace(cls.joined(members), drives=sum(member.drives for member in members))

    @classmethod
    def joined(cls, recordings: Sequence['Tally']) -> 'Tally':
        """Add tallies of the same drives over several recordings."""
        sums = np.sum([tally.sums for tally in recordings], axis=0)
        counts = np.sum([tally.counts for tally in recordings], axis=0)
        return replace(recordings[0], sums=sums, counts=counts)

    def with_constant(self, part: str, watts: Floats) -> 'Tally':
        """Return a tally with a further part of constant power, W [1 + R], metered as well."""
        added = (watts[:, None] * self.counts / self.drives)[..., None]
        ends = self.sums[..., :-1], added, self.sums[..., -1:] + added
        return replace(self, parts=(*self.parts, part), sums=np.concatenate(ends, axis=2))

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the parts, what is unexplained, and the meter."""
        return (*self.parts, UNEXPLAINED, METERED)

    @property
    def means(self) -> Floats:
        """Mean power in W by phase and part, in the order of `rows` [1 + R, P, E + 2]."""
        with np.errstate(invalid='ignore', divide='ignore'):
            means = self.sums / self.counts[..., None] * self.drives
        rest = means[..., -1:] - means[..., :-1].sum(axis=2, keepdims=True)
        return np.concatenate([means[..., :-1], rest, means[..., -1:]], axis=2)


def interval(draws: Floats) -> Floats:
    """90 % bounds [..., 2] of an estimate and its R draws [1 + R, ...]; they include the estimate.

    A NaN draw, in which a rare phase did not occur, counts as the estimate. NaN without draws.
    """
    if len(draws) < 2:
        return np.full((*draws.shape[1:], 2), np.nan)
    draws = np.where(np.isfinite(draws), draws, draws[:1])
    low, high = np.quantile(draws[1:], TAILS, axis=0)
    return np.stack([np.minimum(low, draws[0]), np.maximum(high, draws[0])], axis=-1)


def blocks_of(stretches: Sequence[slice], length: int) -> NDArray[np.intp]:
    """Number of each row's block [N]; a block has `length` rows, or the rest of its stretch."""
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

    Entry 0 counts each row once. In draw r, block b counts often[r, b] times; often: [R, B];
    block: number of the block of each row [N].
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
    """Boolean masks [N, D] by phase, from torque in N·m and velocity in rad/s [N, D] at 50 Hz.

    standstill: speed below which a drive rests, rad/s [D]; feet: `stance`, `swing` or '' [N, D].
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
