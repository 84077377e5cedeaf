"""Split of samples for training and test: six segments of 80/10/10, folds, no overlap."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError
from wattwalk_core.schema import CheckedFields, Quantity

TENTHS = 10


class Part(IntEnum):
    """Part of the data that a sample belongs to."""

    UNUSED = -1
    TRAIN = 0
    VALIDATION = 1
    TEST = 2


@dataclass(frozen=True)
class Protocol(CheckedFields):
    """Split of the measured samples (Section II-A).

    The samples are cut into `segments` equal stretches and each of them into ten parts: eight
    train, one validates, one tests. Fold 0 tests on the last tenth; the other folds move the
    testing tenth (and the validating one before it) evenly through the stretch, so that with up
    to ten folds no sample is tested twice. Where the set changes, `margin` samples are dropped, so
    that neither a window of that history nor a zero-phase filter reaches into another set.
    """

    segments: Annotated[int, Quantity(1, 60)] = 6
    folds: Annotated[int, Quantity(1, TENTHS)] = 6
    margin: Annotated[int, Quantity(0, 10_000, 'samples')] = 60  # the history of the network

    def minimum(self) -> int:
        """Return the least number of usable samples, below which `labels` raises InputError."""
        return self.segments * TENTHS * max(2 * self.margin, 8)

    def labels(self, segment: NDArray[np.integer], fold: int) -> NDArray[np.int8]:
        """Return the `Part` of each sample [T] in one fold; InputError for too few samples.

        segment [T] numbers the gap-free stretches; below zero is a sample that cannot be used.
        """
        if not 0 <= fold < self.folds:
            raise ValueError(f'fold {fold} is not within 0 … {self.folds - 1}')
        segment = np.asarray(segment)
        usable = np.flatnonzero(segment >= 0)
        if usable.size < self.minimum():
            raise InputError(
                f'{usable.size} samples are too few for {self.segments} segments of 80/10/10; '
                f'record at least {self.minimum()} or ask for fewer segments'
            )
        rank = np.arange(usable.size)
        tenth = rank * (self.segments * TENTHS) // usable.size % TENTHS
        test = TENTHS - 1 - fold * TENTHS // self.folds
        labels = np.full(segment.shape, Part.UNUSED, np.int8)
        labels[usable] = Part.TRAIN
        labels[usable[tenth == test]] = Part.TEST
        labels[usable[tenth == (test - 1) % TENTHS]] = Part.VALIDATION
        change = np.flatnonzero(np.diff(labels[usable]))
        for border in change + 1:
            labels[usable[border : border + self.margin]] = Part.UNUSED
        return labels


def runs(
    labels: NDArray[np.int8], segment: NDArray[np.integer], part: Part, shortest: int = 1
) -> Iterator[slice]:
    """Yield slices of at least `shortest` rows of one part, each within one segment.

    labels, segment: part and number of the gap-free stretch of each row [T].
    """
    inside = labels == part
    border = np.flatnonzero((np.diff(inside.astype(np.int8)) != 0) | (np.diff(segment) != 0)) + 1
    edges = [0, *border.tolist(), len(labels)]
    for start, stop in pairwise(edges):
        if stop - start >= max(shortest, 1) and inside[start]:
            yield slice(start, stop)


def rows_of(data: AlignedDataset, labels: NDArray[np.int8], part: Part) -> AlignedDataset:
    """Return the samples of one part; each stretch becomes a segment of its own."""
    stretches = list(runs(labels, data.segment, part))
    index = np.concatenate([np.arange(s.start, s.stop) for s in stretches] or [np.arange(0)])
    chosen = data.rows(index)
    lengths = [s.stop - s.start for s in stretches]
    chosen.segment[:] = np.repeat(np.arange(len(stretches)), lengths)
    return chosen
