"""Inputs and memory of effects, found by changing what they are given."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset

from power_estimator.effects.catalogue import regressors_of
from power_estimator.effects.effect import Effect, Shape
from power_estimator.effects.signals.carried import Carried
from power_estimator.effects.signals.prepared import signals_of
from power_estimator.effects.signals.state import Signals
from power_estimator.model import Needs

RATE: Final = 400.0
"""Hz of the samples that effects multiply, not smoothed."""
NOMINAL: Final = {'position': 0.0, 'voltage': 48.0, 'temperature': 40.0}  # beside torque and speed
_ROWS = (4, 8, 16, 32)  # of memory that is tried; derivatives see three
_ALL = 512
_ENDS = (*range(_ALL // 2, _ALL, _ALL // 16), _ALL)  # rows that are judged: at one, little may act
_FORGOTTEN = 0.05  # share of each term's size that an older past may change


def needs_of(effect: Effect, shape: Shape, names: Sequence[str]) -> Needs:
    """Return the needs of an effect with this shape in drives of these names."""
    random = np.random.default_rng(0)
    given = {
        name: middle + spread * random.normal(size=(2, _ALL, len(names)))
        for name, middle, spread in (
            *(('torque', 0.0, 20.0), ('velocity', 0.0, 3.0)),
            *((name, middle, 5.0) for name, middle in NOMINAL.items()),
        )
    }
    data = AlignedDataset.blank(
        RATE,
        names,
        np.arange(_ALL) / RATE,
        'random',
        **{name: values[0] for name, values in given.items()},
    )

    def regressors(signals: Signals) -> NDArray[np.float64]:
        return regressors_of(effect, signals, shape)

    signals, carried = signals_of(data), Carried()
    whole = regressors(replace(signals, carried=carried))
    inputs = {
        name
        for name in NOMINAL
        if not np.array_equal(regressors(replace(signals, **{name: given[name][1]})), whole)
    }
    if not whole.any():  # of a user's effect in drives that it names itself
        code = getattr(effect.regressors, '__code__', None)
        inputs = set(NOMINAL) & set(code.co_names if code else ())

    def last(rows: int) -> NDArray[np.float64]:
        """Regressors at the ends, of so many rows before each."""
        parts = (data.rows(slice(max(end - rows, 0), end)) for end in _ENDS)
        return np.stack([regressors(signals_of(part))[-1] for part in parts])

    memory = np.inf
    if not effect.remembers:
        of_all, size = last(_ALL), np.square(whole).mean(axis=(0, 1))
        for rows in _ROWS:
            if (np.square(last(rows) - of_all).mean(axis=(0, 1)) <= _FORGOTTEN**2 * size).all():
                memory = rows / RATE
                break
    return Needs(
        inputs={name: effect.name for name in sorted(inputs - {'voltage'})},
        rate=RATE,
        smooth=False,
        improved_by={'voltage': effect.name} if 'voltage' in inputs else {},
        memory=memory,
        remembers=effect.name,
        carried=carried.used or bool(np.isfinite(memory)),
        together='' if effect.per_drive else effect.name,
    )
