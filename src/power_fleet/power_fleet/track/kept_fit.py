"""Fits of recordings as bytes, and what they are kept by in the index."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import accumulate, pairwise
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_recordings.index.store import DriveFigure
from wattwalk_core.arrays import Floats
from wattwalk_core.files import code_fingerprint, file_fingerprint

from power_fleet.track.recording_fit import Occasion, RecordingFit

KIND = 'fit'
CODE = (
    *('power_estimator.effects', 'power_recordings.reading', 'power_recordings.messages'),
    *('power_recordings.alignment', 'power_recordings.quality', 'power_estimator.judge'),
    *('power_fleet.track.recording_fit', 'power_fleet.track.kept_fit'),
    'power_fleet.track.reading',
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

    spec: file of the model. effects: files of the user's own effects. options: how recordings
    are read.
    """
    files = [Path(spec), *effects]
    if model.base is not None:
        base = Path(model.base.removeprefix('ppn:'))
        files += [base] if base.exists() else []
    parts = (code_fingerprint(*CODE), file_fingerprint(files), repr(tuple(options)))
    return sha256(' '.join(parts).encode()).hexdigest()


def to_bytes(fit: RecordingFit | Unfit) -> bytes:
    """Pack a fit: a line of JSON, then its arrays one after the other."""
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
    """Return what `to_bytes` packed."""
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
    """Coefficients with standard errors as rows of a table."""
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
