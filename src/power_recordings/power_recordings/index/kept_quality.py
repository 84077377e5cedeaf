"""Quality of a recording from the index, or checked and kept there."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from wattwalk_core.files import code_fingerprint
from wattwalk_core.schema import parse

from power_recordings.card import Card
from power_recordings.index import store
from power_recordings.index.store import RecordingIndex, Stamp
from power_recordings.quality.check import Quality, check_recording
from power_recordings.reading.reader import Recording

KIND = 'quality'
_UNITS = {'updates_hz': 'Hz', 'power_slope': '', 'velocity_slope': '', 'cells': ''}


@dataclass(frozen=True)
class Checked:
    """Quality of a recording, its card and the problems found while reading it."""

    path: Path
    card: Card
    problems: tuple[str, ...]
    quality: Quality

    @classmethod
    def of(cls, recording: Recording) -> 'Checked':
        """Check a recording; InputError where a topic is there but cannot be read."""
        return cls(recording.path, recording.card, recording.problems, check_recording(recording))


def checked(path: Path, index: RecordingIndex) -> Checked:
    """Return a recording's quality from the index; if absent, check it and add the result."""
    stamp, key = Stamp.of(path), code_fingerprint('power_recordings')
    kept = index.answer(stamp, KIND, key)
    if kept is not None:
        known = json.loads(kept)
        quality = parse(Quality, known['quality'], f'quality of {path} in the index')
        return Checked(path, Card.of(known['card']), tuple(known['problems']), quality)
    recording = Recording.open(path)
    found = Checked.of(recording)
    content = {
        'card': store.card_content(found.card),
        'problems': found.problems,
        'quality': asdict(found.quality),
    }
    figures = [
        store.DriveFigure(drive, name, float(getattr(own, name)), unit)
        for drive, own in found.quality.drives.items()
        for name, unit in _UNITS.items()
    ]
    about = store.RecordingFacts(found.card, recording.start_ns / 1e9, recording.duration)
    text = json.dumps(content, default=str).encode()
    index.keep(stamp, about, store.IndexAnswer(KIND, key, text, figures))
    return found
