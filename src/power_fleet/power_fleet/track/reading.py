"""Fits of many recordings: from the index, or read, fitted and kept there one by one."""

import platform
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded, load
from power_recordings.index.store import (
    DriveFigure,
    IndexAnswer,
    RecordingFacts,
    RecordingIndex,
    Stamp,
)
from power_recordings.reading.reader import Recording
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from power_fleet.track.recording_fit import (
    CODE,
    KIND,
    Occasion,
    RecordingFit,
    Unfit,
    figures_of,
    fit_recording,
    from_bytes,
    to_bytes,
)

_WORDS = ('controller', 'terrain')  # of a card, that say how a robot moved


@dataclass(frozen=True)
class Request:
    """Model and options that recordings are fitted with; key: hash of all of it.

    The key finds fits in the index: other settings need another key.
    """

    model: EffectModel
    catalogue: Catalogue
    spec: str = ''  # file of the model
    drives: Sequence[str] = ()  # only these; () for all
    slow: bool = False  # the meter averages slowly: judge energy over its window
    anyway: bool = False  # also with conflicting units
    key: str = ''
    settings: JudgeSettings = field(default_factory=JudgeSettings)

    def judge(self, loaded: Loaded) -> Judge:
        """Return the judge of loaded recordings, with the request's catalogue and settings."""
        return Judge(loaded, self.catalogue, self.settings)

    def with_effects(self, actives: Sequence[Active]) -> 'Request':
        """Return the request with effects added to the model, and another key."""
        structure = self.model.structure.plus(*actives)
        added = ' '.join(repr(active.key) for active in actives)
        model = replace(self.model, structure=structure)
        return replace(self, model=model, key=f'{self.key} with {added}')


@dataclass(frozen=True)
class Read:
    """Fits of recordings, paths of these by name, and reasons why others were left out."""

    fits: tuple[RecordingFit, ...]
    left_out: tuple[str, ...]
    paths: Mapping[str, Path]


@dataclass(frozen=True)
class Fitted:
    """Packed fit for the index; facts is None for a recording that could not be read."""

    content: bytes
    facts: RecordingFacts | None = None
    figures: Sequence[DriveFigure] = ()


def read_fits(
    paths: Sequence[Path],
    request: Request,
    index: RecordingIndex,
    engine: TaskEngine,
    show: Callable[[str], None] = lambda text: None,
) -> Read:
    """Fit the model to each recording that the index has no fit of.

    Fits are kept in the index one by one, by this process alone; engine: runs them in processes. A
    recording that is damaged, too short or too still, or there twice, is left out.
    """
    contents: dict[Path, bytes] = {}
    unfitted: dict[Path, Stamp] = {}
    for path in dict.fromkeys(paths):
        try:
            stamp = Stamp.of(path)
        except InputError as error:
            contents[path] = to_bytes(Unfit(str(error)))
            continue
        kept = index.answer(stamp, KIND, request.key)
        if kept is not None:
            contents[path] = kept
        else:
            unfitted[path] = stamp
    ended = engine.completed(partial(fit_stamped, request), [*unfitted.values()], CODE)
    show(f'fitting {len(unfitted)} recordings')
    for count, (place, fitted) in enumerate(ended, 1):
        path, stamp = [*unfitted.items()][place]
        contents[path] = fitted.content
        if fitted.facts is not None:
            answer = IndexAnswer(KIND, request.key, fitted.content, fitted.figures)
            index.keep(stamp, fitted.facts, answer)
        show(f'fitted {count} of {len(unfitted)}: {path.name}')
    fits: list[RecordingFit] = []
    left_out: list[str] = []
    known: dict[str, Path] = {}
    taken: dict[str, Path] = {}
    for path, name in _named(paths):
        found = from_bytes(contents[path])
        if isinstance(found, Unfit):
            left_out.append(found.reason)
            continue
        digest = found.occasion.sha256
        if digest and digest in known:
            left_out.append(f'{path} holds the same as {known[digest]}: taken once')
            continue
        known[digest] = taken[name] = path
        fits.append(replace(found, occasion=replace(found.occasion, name=name)))
    return Read(tuple(fits), tuple(left_out), taken)


def fit_stamped(request: Request, stamp: Stamp) -> Fitted:
    """Read a recording on this machine and fit the model to it; return the packed fit or reason.

    InputError where this machine has nothing at its path. One that differs in size from its stamp,
    or that cannot be read, is left out with the reason.
    """
    path = Path(stamp.path)
    if not path.exists():
        raise InputError(
            f'{path} is not there on {platform.node()}: recordings must lie under the same path '
            'on every machine that works on them'
        )
    try:
        if Stamp.of(path).size != stamp.size:
            raise InputError(
                f'{path} has grown, or is another recording on {platform.node()}: left out'
            )
        loaded = load([path], request.drives, slow=request.slow, anyway=request.anyway)
    except InputError as error:
        return Fitted(to_bytes(Unfit(str(error))))
    recording = loaded.recordings[0]
    found: RecordingFit | Unfit
    try:
        judge = request.judge(loaded)
        found = fit_recording(judge, request.model, occasion_of(loaded))
        figures = figures_of(found, request.model.name, request.catalogue)
    except InputError as error:
        found, figures = Unfit(f'{path}: {error}'), []
    facts = RecordingFacts(recording.card, begin_of(recording), recording.duration)
    return Fitted(to_bytes(found), facts, figures)


def _named(paths: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """Recordings with names: those of their folders, longer where two have the same."""
    parts = {path: path.resolve().parts for path in paths}
    length = dict.fromkeys(parts, 1)
    while True:
        names = {path: '/'.join(own[-length[path] :]) for path, own in parts.items()}
        often = Counter(names.values())
        alike = [p for p, n in names.items() if often[n] > 1 and length[p] < len(parts[p])]
        if not alike:
            return iter(names.items())
        for path in alike:
            length[path] += 1


def occasion_of(loaded: Loaded) -> Occasion:
    """Name, start and circumstances of a recording, from its card and its stamps."""
    recording: Recording = loaded.recordings[0]
    card = recording.card
    facts = {
        name: float(value)
        for name, value in card.other.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    words = {name: str(getattr(card, name)) for name in _WORDS if getattr(card, name)}
    return Occasion(
        name=loaded.identities[0]['name'],
        time=begin_of(recording),
        robot=' '.join(part for part in (card.robot, card.unit) if part),
        facts=facts,
        motions=words,
        sha256=loaded.identities[0]['sha256'],
    )


def begin_of(recording: Recording) -> float:
    """Start of a recording in s since 1970: the date of its card, or else its first stamp."""
    try:
        moment = datetime.fromisoformat(recording.card.created)
    except ValueError:
        return recording.start_ns / 1e9
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
