"""Actions of the page on a session: their contents checked, then passed on to it."""

import datetime
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Name, Printable, Quantity, parse, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml

from power_workbench.files.folders import Folders
from power_workbench.server import answers
from power_workbench.sessions.session import WorkbenchSession
from power_workbench.sessions.steps import SessionStep
from power_workbench.views import maps


def keep_note(folder: Path, text: str, recording: str) -> None:
    """Append a note with its time and the recording, '' for none, to notes.yaml in the folder."""
    file = folder / 'notes.yaml'
    before = read_yaml(file, 'notes') if file.exists() else []
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec='milliseconds')
    entry = {'time': now, 'text': text} | ({'recording': recording} if recording else {})
    write_whole(file, dump_yaml([*before, entry]))


_Seconds = Annotated[float, Quantity(-1e9, 1e9, 's')]
_Value = Annotated[float, Quantity(-1e12, 1e12)]
_Text = Annotated[str, Printable(0, 4000)]


@schema
class Selection:
    """Content of `select`: a box on the map, a span of the traces, or a regime; one of them."""

    drive: _Text
    x: _Text
    y: _Text
    shown: _Text = ''  # meter of the traces, the drive's own by default
    start: _Seconds = 0.0  # of the traces
    stop: _Seconds = 1e9
    width: Annotated[int, Quantity(1, 10_000)] = 800
    box: dict[str, tuple[_Value, _Value]] | None = None
    span: tuple[_Seconds, _Seconds] | None = None
    regime: Annotated[int, Quantity(0, 100)] | None = None


@schema
class HistoryPlace:
    """Content of `go`: number of steps that are to be in force."""

    at: Annotated[int, Quantity(0, 100_000)]


@schema
class Allowed:
    """A file of effects that may be run."""

    file: _Text


@schema
class BenchDrive:
    """A drive of the simulated bench, and to how many seconds the motion is cut."""

    drive: Name
    seconds: Annotated[float, Quantity(10.0, 1e5, 's')] | None = None


@schema
class OneModel:
    """A model to compare with."""

    model: Name


@schema
class OneLog:
    """Content of `log`: a log of others; with a map it is imported or, with preview, shown."""

    file: _Text
    map: dict[str, Any] | None = None
    preview: bool = False


@schema
class ShownSpans:
    """Content of `leave_out`: spans of the traces, s as they are shown."""

    spans: tuple[tuple[_Seconds, _Seconds], ...]


@schema
class LiveNote:
    """A note on a running robot."""

    text: Annotated[str, Printable(0, 500)]


def take(folders: Folders, session: WorkbenchSession, step: SessionStep) -> None:
    """Take a step; InputError for files in folders that were not named."""
    if step.model or step.rmse_w or step.sha256:
        raise InputError('step: model, rmse_w and sha256 are found by the session itself')
    for path in step.recordings:
        folders.within(path)
    if step.kind == 'effects':
        folders.within(step.file)
    elif step.kind == 'load':
        folders.check_model(step.file)
    folders.check_model(step.base)
    session.take(step)


def leave_out(_: Folders, session: WorkbenchSession, given: ShownSpans) -> None:
    """Leave spans, s as they are shown, out of all judgement; with none, take all in again."""
    view = answers.view_of(session)
    spans = [str(own) for one in given.spans for own in view.spans(*one)]
    opened = session.record.opened
    if opened is None or bool(spans) != bool(given.spans):
        raise InputError('these seconds hold no row that is judged')
    without = tuple(dict.fromkeys([*opened.without, *spans])) if spans else ()
    session.take(replace(opened, without=without, rmse_w={}))


def line(folders: Folders, session: WorkbenchSession, given: OneModel) -> None:
    """Begin to judge another model beside the present one."""
    folders.check_model(given.model)
    session.line(given.model)


def log(folders: Folders, session: WorkbenchSession, given: OneLog) -> None:
    """Begin to list a log's columns or, with a map, to import or preview it."""
    folders.within(given.file)
    if given.map is None:
        session.look_at_log(given.file)
    else:
        session.import_log(given.file, given.map, only_look=given.preview)


def note(_: Folders, session: WorkbenchSession, given: LiveNote) -> dict[str, Any]:
    """Keep a note with its time, in the card of what is being recorded and in the session.

    Returns {recording: its folder, '' for none}. InputError for an empty text.
    """
    text = given.text.strip()
    if not text:
        raise InputError('the note is empty; say what happened')
    recording = session.live.recorder
    session.live.note(text)
    keep_note(session.folder, text, recording)
    return {'recording': recording}


def select(_: Folders, session: WorkbenchSession, chosen: Selection) -> bytes:
    """Answer a selection with the states of the map and the parts of the traces to light up.

    Returns bytes of `answers.packed`: errors in words, points of the map, parts of the traces.
    InputError for neither box, span nor regime, or a regime that is not there.
    """
    view = answers.view_of(session)
    if chosen.box is not None:
        found = maps.in_box(view, chosen.drive, chosen.box)
    elif chosen.span is not None:
        found = maps.in_span(view, chosen.drive, *chosen.span)
    elif chosen.regime is not None:
        regimes = view.content.get('regimes', [])
        if chosen.regime >= len(regimes):
            raise InputError(f'there are {len(regimes)} regimes')
        found = maps.in_regime(view, regimes[chosen.regime])
    else:
        raise InputError('selection: give box, span or regime')
    drive = str(found.content['drive'])
    place = (chosen.shown or drive, chosen.start, chosen.stop, chosen.width)
    points = maps.scatter_points(view, drive, found.rows, chosen.x, chosen.y)
    return answers.packed({**points, **answers.lit(view, found.rows, *place)}, found.content)


Action = Callable[[Folders, WorkbenchSession, Any], dict[str, Any] | bytes | None]
ACTIONS: Mapping[str, tuple[Any, Action]] = {
    'step': (SessionStep, take),
    'go': (HistoryPlace, lambda _, session, given: session.go(given.at)),
    'leave_out': (ShownSpans, leave_out),
    'diagnose': (dict, lambda _, session, __: session.begin('diagnose')),
    'discover': (dict, lambda _, session, __: session.begin('discover')),
    'report': (dict, lambda _, session, __: session.begin('report')),
    'bench': (BenchDrive, lambda _, session, given: session.begin('bench', **vars(given))),
    'line': (OneModel, line),
    'cancel': (dict, lambda _, session, __: session.cancel()),
    'allow': (Allowed, lambda _, session, given: session.approve(given.file)),
    'log': (OneLog, log),
    'note': (LiveNote, note),
    'select': (Selection, select),
}
"""Of each action the type of its content, and what it does in the folders that may be read."""


def act(
    name: str, folders: Folders, session: WorkbenchSession, content: Mapping[str, Any]
) -> dict[str, Any] | bytes | None:
    """Do an action, and return its answer, if it has one; InputError for a wrong content."""
    kind, action = ACTIONS[name]
    return action(folders, session, parse(kind, content, name))
