"""One model fitted to one recording: estimates, covariance and response to each fault."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import accumulate, pairwise
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Normal, modelled
from power_estimator.effects.fit.delay_search import group_limits
from power_estimator.effects.fit.fitter import Fit, Fitter, measurement_terms
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.judge import Judge
from power_recordings.index.store import DriveFigure
from wattwalk_core.arrays import Floats
from wattwalk_core.files import code_fingerprint, file_fingerprint

TIME_OFFSET = 'time_offset'
_DRAWS = 120  # bootstraps of the blocks
_DELAY_DRAWS = 20
_SEED = 0
_LEAST_SHARE = 1e-9  # of the mean of a gram matrix's diagonal, so that it can be inverted


@dataclass(frozen=True)
class Occasion:
    """Identity and circumstances of a recording."""

    name: str
    time: float  # s since 1970, of the start
    robot: str = ''
    facts: Mapping[str, float] | None = None  # numbers of the card: temperature, payload, …
    motions: Mapping[str, str] | None = None  # words of the card: controller, terrain
    sha256: str = ''  # of the recording's data


@dataclass(frozen=True)
class RecordingFit:
    """Model fitted to one recording without bounds, m coefficients for each of D meters.

    responses[name] [D, m] is the change of the estimates by one unit of an effect or of a fault of
    the measurement. Two may be alike: the offset of a current sensor raises the same estimates as
    the idle draw.
    """

    occasion: Occasion
    drives: tuple[str, ...]
    labels: tuple[tuple[str, int], ...]  # (effect, term) of each coefficient
    values: Floats  # [D, m]
    covariance: Floats  # [D, m, m]
    responses: Mapping[str, Floats]
    watts: Floats  # W per unit [D, m], mean over the recording
    rms: Floats  # W per unit [D, m], rms over the recording
    conditions: Mapping[str, Floats]  # by name [D]: temperature, load, speed, voltage
    error: Floats  # W rms [D]
    power: Floats  # W [D, 2], mean and rms that the drive draws


def fit_recording(judge: Judge, model: EffectModel, occasion: Occasion) -> RecordingFit:
    """Fit the effects of a model and the errors of measurement to one recording, per drive.

    InputError for a recording that is too short or too still.
    """
    own = judge.material_under(model, per='drive')
    structure = own.structure(model.structure.actives)
    terms = measurement_terms(judge.catalogue, shaft='shaft' in structure.names)
    fitter = own.fitter(per_drive=True)
    fit = fitter.fit(structure.plus(*terms), iterations=4)
    values, covariance, inverse, gram = _solved(fitter, fit)
    columns = fit.design.columns
    responses = _responses(fitter, fit, inverse, gram)
    delays = fitter.delay_draws(fit, _DELAY_DRAWS, _SEED)
    of_grid = fitter.settings.fine_delay / np.sqrt(12.0)  # s, standard deviation
    spread = np.square(max(float(delays.std()), of_grid))
    values, covariance, responses = _with_delay(values, covariance, responses, fit.delay, spread)
    drawn = fitter.prepared.power_at(fit.delay)
    rate = np.sqrt(np.nanmean(np.square(np.gradient(drawn, axis=0)))) * REDUCED_RATE
    edge = np.full((len(values), 1), float(rate))
    return RecordingFit(
        occasion=occasion,
        drives=fitter.prepared.names,
        labels=(*fit.structure.labels, (TIME_OFFSET, 0)),
        values=values,
        covariance=covariance,
        responses=responses,
        watts=np.concatenate([columns.mean(axis=0), 0.0 * edge], axis=1),
        rms=np.concatenate([np.sqrt(np.square(columns).mean(axis=0)), edge], axis=1),
        conditions=_conditions(fitter),
        error=np.sqrt(fit.mse),
        power=np.stack([np.nanmean(drawn, axis=0), np.sqrt(np.nanmean(drawn**2, axis=0))], axis=1),
    )


def _solved(fitter: Fitter, fit: Fit) -> tuple[Floats, Floats, Floats, Floats]:
    """Coefficients [D, m] without bounds, their covariance, and the matrices behind [D, m, m].

    A bounded estimate is no longer linear in the power: next to a bound its mean and its spread
    say little of a change. The prior of the errors of measurement stays.
    """
    normal, design = fit.normal, fit.design
    prior = design.structure.priors(fitter.scale)
    _, _, ridge = group_limits(design, prior, fitter.weight, fitter.groups)
    drawn = fitter.drawn(_DRAWS, _SEED)
    drives, m = normal.moment.shape[1:]
    values, covariance = np.empty((drives, m)), np.empty((drives, m, m))
    inverse, grams = np.empty((drives, m, m)), np.empty((drives, m, m))
    for group, own_ridge in zip(fitter.groups, ridge, strict=True):
        drive = group[0]
        weight = fit.weights[:, drive] * normal.valid[:, drive]
        gram, moment = normal.gram[:, drive], normal.moment[:, drive]
        grams[drive] = np.tensordot(weight, gram, axes=1)
        least = _LEAST_SHARE * float(np.trace(grams[drive])) / m
        added = np.diag(np.nan_to_num(own_ridge, posinf=0.0) + least)
        inverse[drive] = np.linalg.inv(grams[drive] + added)
        values[drive] = inverse[drive] @ (weight @ moment)
        often = drawn * weight
        left = np.tensordot(often, gram, axes=1) + added
        sampled = np.linalg.solve(left, (often @ moment)[..., None])[..., 0]
        covariance[drive] = np.cov(sampled, rowvar=False)
    return values, covariance, inverse, grams


def _responses(fitter: Fitter, fit: Fit, inverse: Floats, gram: Floats) -> dict[str, Floats]:
    """Estimates [D, m] per unit of each effect's first term and of each fault."""
    known = inverse @ gram
    labels = fit.structure.labels
    out = {name: known[..., column] for column, (name, term) in enumerate(labels) if term == 0}
    design = fit.design
    power = modelled(design.columns, fit.coefficients) + design.constant
    normal = Normal.of(design.columns, power, fit.blocks)
    moment = np.einsum('bd,bdm->dm', fit.weights * normal.valid, normal.moment)
    out['power_gain'] = np.einsum('dij,dj->di', inverse, moment)
    return out


def _with_delay(
    values: Floats,
    covariance: Floats,
    responses: Mapping[str, Floats],
    delay: float,
    spread: float,
) -> tuple[Floats, Floats, dict[str, Floats]]:
    """Append the delay, which all drives have in common, as a last coefficient of each."""
    last = ((0, 0), (0, 1))
    joined = np.pad(values, last, constant_values=delay)
    wider = np.pad(covariance, (*last, (0, 1)))
    wider[:, -1, -1] = spread
    out = {name: np.pad(own, last) for name, own in responses.items()}
    out[TIME_OFFSET] = np.zeros_like(joined)
    out[TIME_OFFSET][:, -1] = 1.0
    return joined, wider, out


def _conditions(fitter: Fitter) -> dict[str, Floats]:
    """Circumstances of each meter [D] that its signals show."""
    signals = fitter.prepared.signals
    found = {
        'load': np.sqrt(np.square(signals.torque).mean(axis=0)),
        'speed': np.sqrt(np.square(signals.velocity).mean(axis=0)),
        'supply voltage': np.median(signals.voltage, axis=0),
    }
    known = np.isfinite(signals.temperature)
    if known.any(axis=0).all():
        found['temperature'] = np.nanmean(signals.temperature, axis=0)
    if fitter.prepared.whole:
        return {name: own.mean(keepdims=True) for name, own in found.items()}
    return found


KIND = 'fit'
CODE = (
    *('power_estimator.effects', 'power_recordings.reading', 'power_recordings.messages'),
    *('power_recordings.alignment', 'power_recordings.quality', 'power_estimator.judge'),
    *('power_fleet.track.recording_fit', 'power_fleet.track.reading'),
)
"""Packages and modules that a fit is made by: another version of them fits anew."""
_ARRAYS = ('values', 'covariance', 'watts', 'rms', 'error', 'power')


@dataclass(frozen=True)
class Unfit:
    """A recording that no model can be fitted to, with the reason."""

    reason: str


def key_of(
    model: EffectModel, spec: str, effects: Sequence[Path], options: Sequence[object]
) -> str:
    """Return the hash of all that a fit depends on besides the recording.

    spec: file of the model; effects: of the user's own; options: how recordings are read.
    """
    files = [Path(spec), *effects]
    if model.base is not None:
        base = Path(model.base.removeprefix('ppn:'))
        files += [base] if base.exists() else []
    parts = (code_fingerprint(*CODE), file_fingerprint(files), repr(tuple(options)))
    return sha256(' '.join(parts).encode()).hexdigest()


def to_bytes(fit: RecordingFit | Unfit) -> bytes:
    """Pack a fit, or the reason of an unfit recording, as `from_bytes` reads it."""
    if isinstance(fit, Unfit):
        return json.dumps({'unfit': fit.reason}).encode()
    arrays = [getattr(fit, name) for name in _ARRAYS]
    arrays += [*fit.responses.values(), *fit.conditions.values()]
    head = {
        'occasion': asdict(fit.occasion),
        'drives': fit.drives,
        'labels': fit.labels,
        'responses': list(fit.responses),
        'conditions': list(fit.conditions),
        'shapes': [array.shape for array in arrays],
    }
    packed = np.concatenate([np.asarray(array, np.float64).ravel() for array in arrays])
    return json.dumps(head).encode() + b'\n' + packed.astype('<f8').tobytes()


def from_bytes(content: bytes) -> RecordingFit | Unfit:
    """Unpack what `to_bytes` packed."""
    text, _, packed = content.partition(b'\n')
    head: dict[str, Any] = json.loads(text)
    if 'unfit' in head:
        return Unfit(str(head['unfit']))
    flat = np.frombuffer(packed, '<f8')
    ends = list(accumulate((prod(shape) for shape in head['shapes']), initial=0))
    places = zip(pairwise(ends), head['shapes'], strict=True)
    arrays = (flat[begin:end].reshape(shape) for (begin, end), shape in places)
    known: dict[str, Floats] = {name: next(arrays) for name in _ARRAYS}
    return RecordingFit(
        occasion=Occasion(**head['occasion']),
        drives=tuple(head['drives']),
        labels=tuple((name, term) for name, term in head['labels']),
        responses={name: next(arrays) for name in head['responses']},
        conditions={name: next(arrays) for name in head['conditions']},
        **known,
    )


def figures_of(fit: RecordingFit, model: str, catalogue: Catalogue) -> list[DriveFigure]:
    """Return a row for each coefficient of each drive, with its standard error; model: a name."""
    errors = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))
    return [
        DriveFigure(
            drive=drive,
            name=name,
            value=float(fit.values[place, column]),
            unit=catalogue[name.split('.')[0]].terms[term].unit,
            term=term,
            error=float(errors[place, column]),
            model=model,
        )
        for place, drive in enumerate(fit.drives)
        for column, (name, term) in enumerate(fit.labels)
    ]
