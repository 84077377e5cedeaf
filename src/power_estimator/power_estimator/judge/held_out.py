"""Power of models where they were not fitted, by the fingerprints of recordings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import LEAST_SECONDS
from power_estimator.judge.recordings import Loaded
from power_estimator.loader import base_of
from power_estimator.model import PowerModel
from power_estimator.network.ppn import PowerPredictionNetwork

_LOST = 1.4  # s of each stretch, to the low-pass and to whole seconds


@dataclass(frozen=True)
class HeldOutPower:
    """Power of a model where it was not trained."""

    power: Singles  # W [T, D], NaN elsewhere
    partly: bool  # whether it was trained on some of the samples


def knows(model: EffectModel, loaded: Loaded) -> Bools:
    """Mark the recordings [R] on which a model of effects must be refitted to be judged."""
    known = {entry.get('sha256') for entry in model.fitted_on}
    return np.array([not model.fitted or own['sha256'] in known for own in loaded.identities])


def held_out_rows(
    model: PowerModel, loaded: Loaded, time: Floats, recording: NDArray[np.integer]
) -> Bools:
    """Mark the rows and drives [N, D] that a network was not trained on; all for other models.

    time: s [N]; recording: index [N].
    """
    allowed = np.ones((len(time), len(loaded.data.names)), bool)
    if not isinstance(model, PowerPredictionNetwork):
        return allowed
    trained = {known.sha256: known.held_out for known in model.checkpoint.recordings}
    for index, identity in enumerate(loaded.identities):
        rows = recording == index
        for drive, name in enumerate(loaded.data.names):
            kind = next((kind.name for kind in model.types if kind.matches(name)), '')
            spans = trained.get(identity['sha256'], {}).get(kind)
            if spans is not None:
                inside = np.zeros(len(time), bool)
                for start, stop in spans:
                    inside |= (time >= start - 1e-6) & (time <= stop + 1e-6)
                allowed[rows & ~inside, drive] = False
    return allowed


def power_on(loaded: Loaded, model: PowerModel) -> Singles:
    """Return a model's power on the samples of the recordings, W [T, D].

    Models that need smoothed signals get these, at 200 Hz; all others get the signals as they were
    measured.
    """
    data = loaded.data
    if not model.needs.smooth:
        return model.predict(data)
    smooth = loaded.smooth
    power = model.predict(smooth)
    if smooth is data:
        return power
    out = np.full(data.torque.shape, np.nan, np.float32)
    for index in range(len(data.recordings)):
        here, there = data.recording == index, smooth.recording == index
        if here.any() and there.any():
            out[here] = _between(data.time[here], smooth.time[there], power[there], smooth.rate)
    return out


def power_under(loaded: Loaded, model: EffectModel) -> HeldOutPower | None:
    """Return the power of a model's base where that is held out; None without a base."""
    base = base_of(model)
    return None if base is None else base_power(loaded, base, model.base or base.name)


def base_power(loaded: Loaded, model: PowerModel, spec: str) -> HeldOutPower:
    """Return the power of a base model; of a network on its test part only.

    spec: its file or name, for messages. InputError where too little of a drive is left.
    """
    data = loaded.data
    power = power_on(loaded, model)
    allowed = held_out_rows(model, loaded, data.time, data.recording)
    power[~allowed] = np.nan
    partly = not allowed.all()
    if not np.isfinite(power).any() and not partly:
        raise InputError(f'{spec} says nothing about {", ".join(data.names)}')
    if partly:
        _require_seconds(spec, power, data)
    return HeldOutPower(power, partly)


def _require_seconds(spec: str, power: Singles, data: AlignedDataset) -> None:
    for drive, name in enumerate(data.names):
        known = np.isfinite(power[:, drive]) & np.isfinite(data.power[:, drive])
        edges = np.flatnonzero(np.diff(np.r_[False, known, False]))
        lengths = (edges[1::2] - edges[::2]) / data.rate
        seconds = float(np.maximum(lengths - _LOST, 0.0).sum())
        if seconds < LEAST_SECONDS:
            raise InputError(
                f'{spec} was trained on these recordings: its test part leaves '
                f'{seconds:.0f} s of {name} to judge on, not {LEAST_SECONDS:.0f}; give a '
                'recording that it was not trained on (or a longer one)'
            )


def _between(time: Floats, known: Floats, values: Singles, rate: float) -> Singles:
    """Values [K, D] at other times: linear, not across gaps or NaN; held half a sample at ends."""
    right = np.clip(np.searchsorted(known, time), 1, len(known) - 1)
    left = right - 1
    width = np.maximum(known[right] - known[left], 1e-9)
    weight = (time - known[left]) / width
    outside = (weight < -0.01) | (weight > 1.01) | (width > 1.5 / rate)
    nearest = np.where(weight < 0.5, left, right)
    near = np.abs(time - known[nearest]) < 0.6 / rate
    result = np.empty((len(time), values.shape[1]), np.float32)
    for drive, own in enumerate(values.T):
        inside = (1.0 - weight) * own[left] + weight * own[right]
        result[:, drive] = np.where(outside, np.where(near, own[nearest], np.nan), inside)
    return result
