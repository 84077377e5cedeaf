"""Errors of the measurement that differ from recording to recording of one robot."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects import Effect, Signals
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import SHIFT_STEP

OWN_TERMS = ('power_gain', 'current_offset', 'offset_drift')
"""What changes when a power meter is switched off and on, warms, or is another."""
MOST_RECORDINGS = 8
"""More recordings than this share their terms, which would else be most of a model."""
_LEAST_BLOCKS = 20  # s, of a recording whose delay can be told
_LEAST_DELAY = 0.0015  # s: what delays of recordings differ by for no reason


def per_recording(of: Effect, recordings: int) -> Effect:
    """Return an error of measurement with a coefficient for each of so many recordings."""
    term = of.terms[0]
    return replace(
        of,
        terms=tuple(replace(term, symbol=f'{term.symbol}{n + 1}') for n in range(recordings)),
        regressors=lambda signals, **shape: (
            of.regressors(signals, **shape) * _within(signals, recordings)
        ),
        sizes=lambda scale: np.repeat(of.factors(scale), recordings, axis=1),
        per_recording=True,
        made=(per_recording, (of, recordings)),
    )


def gain_per_recording(of: Effect, recordings: int) -> Effect:
    """Return the meter's gain error with a coefficient for each recording, on all of its power.

    In one recording the losses take up their part of the gain, so that the shaft alone shows it;
    losses common to several cannot.
    """

    def slope(signals: Signals, coefficients: Floats, **_: float) -> Floats:
        return np.asarray((coefficients * _within(signals, recordings)).sum(axis=2))

    return replace(
        per_recording(of, recordings),
        formula='g·P',
        follows=frozenset({'drawn'}),
        regressors=lambda signals, **_: signals.drawn[..., None] * _within(signals, recordings),
        drawn_slope=slope,
        made=(gain_per_recording, (of, recordings)),
    )


def _within(signals: Signals, recordings: int) -> Floats:
    """1 in the column of the recording, 0 in the others [T, 1, R]."""
    return (signals.recording[:, None, None] == np.arange(recordings)).astype(np.float64)


def own_terms(
    terms: Sequence[Active], recordings: int, apart: Collection[str] = OWN_TERMS
) -> tuple[Active, ...]:
    """Return terms of the measurement where those named in `apart` are separate by recording.

    They are returned as they are for one recording and for more than MOST_RECORDINGS.
    """
    if not 1 < recordings <= MOST_RECORDINGS:
        return tuple(terms)

    def own(effect: Effect) -> Effect:
        made = gain_per_recording if effect.name == 'power_gain' else per_recording
        return made(effect, recordings)

    return tuple(Active.of(own(term.effect)) if term.name in apart else term for term in terms)


def has_own_terms(structure: Structure) -> bool:
    """Return whether a structure has coefficients that are separate by recording."""
    return any(active.effect.per_recording for active in structure.actives)


def own_delays(
    prepared: Prepared, structure: Structure, fitter_of: Callable[[Prepared], Fitter]
) -> Floats:
    """Return the delay of each recording's power relative to that of the others, s [R].

    structure: the model with all that resembles a delay (inertia, spring), whose share of the
    motion differs between recordings. fitter_of: makes a fitter. Zero where delays hardly differ.
    """
    count = len(prepared.recordings)
    none = np.zeros(count)
    if not 1 < count <= MOST_RECORDINGS:
        return none
    found = np.full(count, np.nan)
    for one in range(count):
        only = np.where((prepared.recording == one)[:, None], prepared.power, np.float32(np.nan))
        fitter = fitter_of(replace(prepared, power=only))
        if int(fitter.blocks.valid.any(axis=1).sum()) >= _LEAST_BLOCKS:
            found[one] = fitter.fit(structure, iterations=3).delay
    if np.isnan(found).all():
        return none
    apart = np.nan_to_num(found - np.nanmedian(found))
    return np.where(np.abs(apart) >= _LEAST_DELAY, apart, 0.0)


def in_step(prepared: Prepared, delays: Floats) -> Prepared:
    """Return the signals with the delay of each recording's power, s [R], taken out."""
    if not delays.any():
        return prepared
    power = prepared.power.copy()
    places = np.arange(len(prepared.shifts), dtype=np.float64)
    for one in np.flatnonzero(delays):
        rows = prepared.recording == one
        moved = np.clip(places + delays[one] / SHIFT_STEP, 0.0, len(places) - 1.001)
        left = moved.astype(np.intp)
        weight = (moved - left)[:, None, None].astype(np.float32)
        own = prepared.power[:, rows]
        power[:, rows] = (1.0 - weight) * own[left] + weight * own[left + 1]
    return replace(prepared, power=power)
