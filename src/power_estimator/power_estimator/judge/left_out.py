"""Seconds of recordings that are left out: their power counts as not measured."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Bools
from wattwalk_core.errors import InputError, quoted

_SPAN = re.compile(r'(?:([1-9]\d{0,3})@)?(\d+(?:\.\d+)?):(\d+(?:\.\d+)?)')


@dataclass(frozen=True)
class LeftOut:
    """A span of one recording, s from its first sample."""

    recording: int  # counted from 0
    start: float
    stop: float

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse FROM:TO of the first recording, or N@FROM:TO; InputError for anything else."""
        found = _SPAN.fullmatch(text.strip())
        if not found or float(found[2]) >= float(found[3]):
            raise InputError(
                f'{quoted(text)}: expected FROM:TO in seconds, as 12.5:14, or N@FROM:TO of the '
                'N-th recording'
            )
        return cls(int(found[1] or 1) - 1, float(found[2]), float(found[3]))

    def __str__(self) -> str:
        number = f'{self.recording + 1}@' if self.recording else ''
        return f'{number}{self.start:g}:{self.stop:g}'

    def rows(self, data: AlignedDataset) -> Bools:
        """Mark the samples [T]."""
        own = np.asarray(data.recording == self.recording)
        time = data.time - (data.time[own].min() if own.any() else 0.0)
        return own & (time >= self.start) & (time < self.stop)


def spans_of(texts: Sequence[str]) -> tuple[LeftOut, ...]:
    """Parse spans, of which a text has one or more with commas between them."""
    return tuple(LeftOut.of(part) for text in texts for part in text.split(','))


def without(data: AlignedDataset, spans: Sequence[LeftOut]) -> AlignedDataset:
    """Make the power in the spans one that was not measured; motion stays, so no gap arises.

    InputError for steady points and for a span in which there is no sample.
    """
    if not spans:
        return data
    if data.steady:
        raise InputError('operating points have no time, so that no seconds can be left out')
    hidden = np.zeros(len(data.time), bool)
    for span in spans:
        rows = span.rows(data)
        if not rows.any():
            raise InputError(f'{span}: the recordings have no such seconds')
        hidden |= rows
    power, current, supply = (
        np.where(hidden if values.ndim == 1 else hidden[:, None], np.float32(np.nan), values)
        for values in (data.power, data.current, data.supply)
    )
    return replace(data, power=power, current=current, supply=supply)
