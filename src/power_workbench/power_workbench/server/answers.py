"""Answers to the page: a session's state as JSON, traces as float32."""

import json
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.judge.result import over_meters
from power_lab.structure.words import in_words
from wattwalk_core.arrays import Bools, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import read_yaml

from power_workbench.sessions.session import WorkbenchSession
from power_workbench.sessions.steps import Commands, SessionRecord, SessionStep
from power_workbench.views import maps
from power_workbench.views.pyramid import Span, extremes
from power_workbench.views.view import PowerView

KEPT = re.compile(
    r'(session|notes|import_\d+|model_\d+|next_\d+)\.yaml|report_\d+\.html|effects_\d+\.py'
)
"""Files of a session that the page may have."""
SUM = 'sum'
"""Name of the column that adds up all meters."""
_MOST_WIDE = 4000  # blocks of a trace


def catalogue_content(catalogue: Catalogue) -> list[dict[str, Any]]:
    """Return the physical effects of a catalogue in words, as content of JSON."""
    return [
        {
            'name': effect.name,
            'words': in_words(effect.name),
            'physics': effect.physics,
            'formula': effect.formula,
            'excitation': effect.excitation.text,
        }
        for effect in catalogue.physics()
    ]


def state(session: WorkbenchSession) -> dict[str, Any]:
    """Return all that the page shows of a session but traces and maps, as content of JSON."""
    record, view, job, found = session.record, session.view, session.runner.job, session.findings
    return {
        'revision': session.revision,
        'folder': str(session.folder),
        'steps': [_step(session, record, index) for index in range(len(record.steps))],
        'at': record.at,
        'recordings': session.recordings,
        'opened': list(record.opened.recordings) if record.opened else [],
        'effect_files': [
            {'file': file, 'allowed': file in session.approved} for file in record.effect_files
        ],
        'model': None if view is None else view.model,
        'before': coefficients_before(session),
        'model_file': record.shaped.model if record.shaped else '',
        'view': None if view is None else _view(view),
        'stairs': [
            {'label': label(own), 'kind': own.kind, 'rmse_w': mean_of(own.rmse_w), 'index': index}
            for index, own in enumerate(record.done)
            if own.kind not in ('open', 'effects') and own.rmse_w
        ],
        'budget': budget_state(session),
        'diagnosis': None if found is None else found.content,
        'previews': [] if found is None else list(found.explained),
        'log': session.log.get('turn'),
        'job': job.content() if job is not None and job.state == 'running' else None,
        'error': session.error,
        'commands': _commands(session, record),
        'learned': session.learned,
        'lines': [dict(line) for line in session.lines],
        'made': [str(path) for path in session.recordings_made],
        'files': sorted(p.name for p in session.folder.iterdir() if KEPT.fullmatch(p.name)),
    }


def budget_state(session: WorkbenchSession) -> dict[str, Any]:
    """Return headline and origin of the budget, or its error, as JSON; empty until it is known."""
    found = session.budget or {}
    told = {
        name: found[name] for name in ('headline', 'origin', 'error', 'first') if name in found
    }
    return told | ({'effects': found['effects']} if found.get('chosen') else {})


def coefficients_before(session: WorkbenchSession) -> dict[str, Any]:
    """Return {effect: {group: values}} before a last step `add` or `remove`; {} after others."""
    kinds = ('load', 'fit', 'add', 'remove')
    shaped = [step for step in session.record.done if step.kind in kinds]
    if len(shaped) < 2 or shaped[-1].kind not in ('add', 'remove') or not shaped[-2].model:
        return {}
    try:
        model = read_yaml(session.folder / shaped[-2].model, 'model')
    except InputError:
        return {}
    found: dict[str, Any] = {name: {} for name in model['effects']}
    for group, own in model['drives'].items():
        for effect, values in own['coefficients'].items():
            found[effect][group] = values
    return found


def _commands(session: WorkbenchSession, record: SessionRecord) -> dict[str, str]:
    if record.opened is None:
        return {}
    commands = Commands(session.folder, record)
    budget = {'budget': commands.budget()}
    if not session.spec:
        return budget
    return {
        **budget,
        'compare': commands.compare(),
        'diagnose': commands.on_model('diagnose'),
        'report': commands.on_model('diagnose', '--report', 'why.html'),
        'motion': commands.on_model('diagnose', '--motion', 'next.yaml', '--limits'),
        'discover': commands.on_model('discover', '-o', 'effect.py'),
    }


def _step(session: WorkbenchSession, record: SessionRecord, index: int) -> dict[str, Any]:
    step = record.steps[index]
    return {
        'kind': step.kind,
        'label': label(step),
        'command': Commands(session.folder, record).of(index),
        'rmse_w': mean_of(step.rmse_w),
        'model': step.model,
    }


def label(step: SessionStep) -> str:
    """Return a step in a few words, as `add copper loss`."""
    words = ', '.join(in_words(name) for name in step.effects)
    if step.without:
        return f'leave out {", ".join(step.without)} s'
    if step.kind == 'open':
        return f'open {", ".join(Path(path).name for path in step.recordings)}'
    if step.kind in ('load', 'effects'):
        return f'{"load" if step.kind == "load" else "allow"} {Path(step.file).name}'
    base = f' on {step.base}' if step.base else ''
    return f'{step.kind} {words}{base}'


def mean_of(errors: Mapping[str, float]) -> float | None:
    """Return the root of the mean square, W, of errors by meter; None for no errors."""
    return maps.short_one(over_meters(errors.values())) if errors else None


def _view(view: PowerView) -> dict[str, Any]:
    return {
        'meters': list(view.meters),
        'drives': list(view.drives),
        'recordings': list(view.recordings),
        'seconds': view.seconds,
        'judged_seconds': round(len(view.slots) / REDUCED_RATE, 2),
        'worst': list(view.worst),
        'hidden': [[round(one, 2) for one in span] for span in view.hidden],
        'quantities': [
            {'name': name, 'unit': maps.UNITS_OF.get(name, '')}
            for name in (*view.state, *([] if view.stride.phase is None else [maps.STRIDE]))
        ],
        'stride': _stride(view),
        'phases': sorted(view.words),
        'noise': maps.rounded(view.noise),
        'noise_w': maps.short_one(maps.rms(view.noise)),
        'share': maps.short_one(view.share),
        'scores': view.content or None,
        'by_recording': _by_recording(view),
    }


def _by_recording(view: PowerView) -> list[dict[str, Any]]:
    """Error and power over the meters of each of several recordings, W."""
    if view.residual is None or len(view.recordings) < 2:
        return []
    found = []
    for number, name in enumerate(view.recordings):
        rows = (view.recording == number) & np.isfinite(view.residual).all(axis=1)
        if rows.any():
            error, mean = maps.rms(view.residual[rows]), float(view.measured[rows].mean())
            shown = {'rmse_w': maps.short_one(error), 'mean_w': maps.short_one(mean)}
            found.append({'name': name, **shown})
    return found


def _stride(view: PowerView) -> str:
    """Say of the stride, or why there is none."""
    found = view.stride
    if found.phase is None:
        return f'No phase of the stride: {found.reason}.'
    drive = view.drives[found.drive]
    return (
        f'A stride takes {found.period:.2f} s; its phase is 0 where {drive} has its largest '
        'position.'
    )


def view_of(session: WorkbenchSession) -> PowerView:
    """Return the view of a session; InputError before there is one."""
    if session.view is None:
        raise InputError('no recording is open yet')
    return session.view


def column(view: PowerView, meter: str) -> int:
    """Return the column of a meter, or of the sum, in traces; InputError for another name."""
    if meter == SUM:
        return len(view.meters)
    if meter in view.meters:
        return view.meters.index(meter)
    if len(view.meters) == 1 and meter in view.drives:
        return 0  # the robot's
    raise InputError(f'no drive {meter!r}; there are {", ".join([*view.meters, SUM])}')


def traces(view: PowerView, meter: str, start: float, stop: float, width: int) -> bytes:
    """Return packed extremes of measured, estimate and error of a meter, W, from start to stop, s.

    width: pixels, of which each block has two. A header in JSON precedes the float32 arrays.
    """
    own, window = column(view, meter), _window(view, start, stop, width)
    return packed(_drawn({name: p.span(*window) for name, p in view.traces.items()}, own), {})


def lit(
    view: PowerView, rows: Bools, meter: str, start: float, stop: float, width: int
) -> dict[str, Singles]:
    """Return measured power and error of a meter, W, at the marked rows [N] alone, as extremes.

    start, stop: s as they are shown; width: pixels. Keys are lit_t (s), lit_measured, lit_error.
    """
    own, window = column(view, meter), _window(view, start, stop, width)
    values = {'measured': view.measured}
    if view.residual is not None:
        values['error'] = -view.residual
    spans = {}
    for name, given in values.items():
        lit = np.where(rows[:, None], _column(given, own), np.float32(np.nan))
        spans[name] = extremes(view.spread(lit), *window)
    return {f'lit_{name}': one for name, one in _drawn(spans, 0).items()}


def preview(
    view: PowerView, explained: Singles, meter: str, start: float, stop: float, width: int
) -> bytes:
    """Return the packed error of a meter, W, that would be left with a candidate, and its RMS.

    explained: W [N, M] of the residual. InputError without a model or for another shape.
    """
    if view.residual is None or explained.shape != view.residual.shape:
        raise InputError('there is no preview of this candidate')
    own = column(view, meter)
    left = _column(explained, own) - _column(view.residual, own)
    span = extremes(view.spread(left), *_window(view, start, stop, width))
    known = np.isfinite(left) & np.isfinite(view.residual.sum(axis=1, keepdims=True))
    rms = maps.rms(left[known]) if known.any() else 0.0
    return packed(_drawn({'preview': span}, 0), {'rmse_w': maps.short_one(rms)})


def strip(view: PowerView, width: int) -> dict[str, Any]:
    """Return the RMS error of each meter in `width` equal parts; of the power without a model.

    Returns middles `t` in s, `meters`, and `z` in W by meter and part.
    """
    values = view.measured if view.residual is None else view.residual
    count = int(np.clip(width, 20, 400))
    edges = np.linspace(0, view.length, count + 1)
    place = np.clip(np.searchsorted(edges, view.slots, side='right') - 1, 0, count - 1)
    rows = []
    for meter in range(values.shape[1]):
        known = np.isfinite(values[:, meter])
        squares = np.square(np.nan_to_num(values[:, meter]), dtype=np.float64)
        sums = np.bincount(place, weights=squares, minlength=count)
        counts = np.bincount(place, weights=known, minlength=count)
        with np.errstate(invalid='ignore', divide='ignore'):
            rows.append(maps.rounded(np.sqrt(np.where(counts > 0, sums / counts, np.nan))))
    middles = 0.5 * (edges[1:] + edges[:-1]) / REDUCED_RATE
    return {'t': maps.rounded(middles), 'meters': list(view.meters), 'z': rows}


def _window(view: PowerView, start: float, stop: float, width: int) -> tuple[int, int, int]:
    """First slot, the one after the last, and number of blocks for `width` pixels."""
    if not (np.isfinite(start) and np.isfinite(stop)):
        raise InputError('give the span in seconds')
    low, high = sorted((start, stop))
    first = int(np.clip(np.floor(low * REDUCED_RATE), 0, max(view.length - 2, 0)))
    last = int(np.clip(np.ceil(high * REDUCED_RATE) + 1, first + 2, view.length))
    return first, last, int(np.clip(width // 2, 20, _MOST_WIDE))


def _times(span: Span) -> Singles:
    """Seconds of each value of `_woven`: the block's two halves, or the slots themselves."""
    if span.step == 1:
        return np.asarray(span.centres / REDUCED_RATE, np.float32)
    quarter = span.step / 4
    both = np.stack([span.centres - quarter, span.centres + quarter], axis=1)
    return np.asarray(both.ravel() / REDUCED_RATE, np.float32)


def _woven(span: Span, own: int) -> Singles:
    """Least and greatest value of each block in turn; the values themselves of single slots."""
    if span.step == 1:
        return np.ascontiguousarray(span.low[:, own])
    return np.stack([span.low[:, own], span.high[:, own]], axis=1).ravel()


def _column(values: Singles, own: int) -> Singles:
    """One meter of values [N, M], or their sum as the column after the last, [N, 1]."""
    if own < values.shape[1]:
        return values[:, own : own + 1]
    return values.sum(axis=1, keepdims=True, dtype=np.float32)


def _drawn(spans: Mapping[str, Span], own: int) -> dict[str, Singles]:
    """Times `t` of spans of the same blocks, and the values of one column of each."""
    times = _times(next(iter(spans.values())))
    return {'t': times, **{name: _woven(span, own) for name, span in spans.items()}}


def packed(arrays: Mapping[str, Singles], more: Mapping[str, Any]) -> bytes:
    """Pack the length of a header, the header as JSON, then float32 arrays in its order."""
    lengths = [[name, len(values)] for name, values in arrays.items()]
    header = json.dumps({'arrays': lengths, **more}).encode()
    header += b' ' * (-(4 + len(header)) % 4)
    parts = [struct.pack('<I', len(header)), header]
    return b''.join([*parts, *(np.asarray(v, '<f4').tobytes() for v in arrays.values())])
