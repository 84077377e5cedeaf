"""Outcome of tracking: series, changes, alarms in words, and JSON."""

import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from power_estimator.effects import Catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_lab.diagnose.findings import short
from power_recordings.index.store import RecordingIndex
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError, printable

from power_fleet.track.change_test import LEAST_RECORDINGS, Change
from power_fleet.track.history import DriveHistory, histories
from power_fleet.track.reading import Request, read_fits
from power_fleet.track.recording_fit import TIME_OFFSET, RecordingFit
from power_fleet.track.search import FALSE_ALARMS, CertainChange, Explained, Search, search
from power_fleet.track.shared import Common, Points, common_levels, shrunk
from power_fleet.track.unmodelled import Growth, Unmodelled, explain, growths

_WIDTH = 1.96  # standard errors of a 95 % interval
_MOST_EXPLAINED = 2  # drives of which growth of what the model misses is diagnosed


@dataclass(frozen=True)
class Tracked:
    """Result of `track`: histories of D drives, changes found, and shrunk estimates."""

    model: EffectModel
    catalogue: Catalogue
    histories: tuple[DriveHistory, ...]
    result: Search
    points: tuple[Points, ...]  # [D]
    common: Mapping[tuple[str, int], Common]
    left_out: tuple[str, ...] = ()  # recordings that say nothing, with the reason
    unmodelled: Mapping[str, Unmodelled] = field(default_factory=dict)  # by drive
    paths: Mapping[str, Path] = field(default_factory=dict)  # of the recordings by name

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        count = max(len(own.time) for own in self.histories)
        drives = ', '.join(own.drive for own in self.histories)
        if count < LEAST_RECORDINGS:
            return f'{count} recordings decide nothing; {LEAST_RECORDINGS} or more do'
        if not self.alarms:
            return f'Nothing changed on {drives} over {count} recordings that is certain.'
        return ' '.join(self.alarms)

    @property
    def headline(self) -> str:
        """Short text on the first certain change, or else the whole sentence."""
        if not self.result.findings:
            grown = next(iter(self.unmodelled), None)
            return self.sentence if grown is None else f'What the model misses on {grown} grew'
        finding = self.result.findings[0]
        drive = self.histories[finding.drive].drive
        rest = len(self.result.findings) - 1
        more = f', and {rest} more' if rest else ''
        return f'{_name(finding.change.hypothesis)} of {drive} changed{more}'

    @property
    def alarms(self) -> list[str]:
        """Certain changes in words: one text of one or more sentences for each."""
        tracked = {self._unmodelled(finding) for finding in self.result.findings}
        first = [
            f'{drive}: {one.course}. {one.cause}'
            for drive, one in self.unmodelled.items()
            if drive not in tracked
        ]
        return first + [self.told(finding) for finding in self.result.findings]

    def _unmodelled(self, finding: CertainChange) -> str:
        """Return the drive of a finding if its effect was added to the model, else ''."""
        drive = self.histories[finding.drive].drive
        found = self.unmodelled.get(drive)
        added = () if found is None else [active.name for active in found.added]
        return drive if finding.change.hypothesis in added else ''

    @property
    def explained(self) -> list[str]:
        """Sentences on changes that covariates explain, one each."""
        return [self._explained(one) for one in self.result.explained]

    def next_command(self, spec: str) -> str:
        """Return what to type next: examine the recordings after a change, or record on."""
        unknown = next((one for one in self.unmodelled.values() if one.discovered), None)
        if unknown is not None:
            bags = ' '.join(map(self._typed, unknown.after.recordings))
            return f'ros2 run power_lab discover {bags} --model {spec} -o effect.py'
        if not self.result.findings:
            return 'record on, and track again with the new recordings'
        finding = self.result.findings[0]
        history, change = self.histories[finding.drive], finding.change
        bag = self._typed(history.recordings[change.profile.end])
        return f'ros2 run power_lab diagnose {bag} --model {spec} --report why.html'

    def _typed(self, recording: str) -> str:
        """Return a recording as one types it."""
        return shlex.quote(printable(str(self.paths.get(recording, recording))))

    def told(self, finding: CertainChange) -> str:
        """Describe one certain change in a sentence or more."""
        history, change = self.histories[finding.drive], finding.change
        first = change.profile.first
        day = datetime.fromtimestamp(float(history.time[first]), UTC).strftime('%Y-%m-%d')
        begin, end = self.ends(finding.drive, change)
        unit = self.unit(change.hypothesis)
        percent = self.percent(finding.drive, change)
        watts = self.watts(finding.drive, change)
        course = 'changed' if change.profile.step else 'has drifted'
        size = f'from {begin:.4g} to {end:.4g} {unit}'.strip()
        share = '' if percent is None else f' ({percent:+.0f} %)'
        text = (
            f'{history.drive}: {_name(change.hypothesis)} {course} {size}{share}, '
            f'{watts:+.2f} W, since {printable(history.recordings[first])} ({day}).'
        )
        if finding.rivals:
            others = ' or '.join(
                f'{_name(rival.hypothesis)} ({rival.size:+.3g} {self.unit(rival.hypothesis)})'
                for rival in finding.rivals
            )
            text += f' These recordings cannot tell it from {others}.'
        if drive := self._unmodelled(finding):
            text += f' The model lacks it. {self.unmodelled[drive].cause}'
        elif history.drive in self.unmodelled:
            text += ' It may be a part of what the model misses.'
        return text

    def _explained(self, one: Explained) -> str:
        drive = self.histories[one.drive].drive
        return (
            f'{drive}: what looks like a change of {_name(one.change.hypothesis)} '
            f'({self.watts(one.drive, one.change):+.2f} W) goes with {one.covariate}; it is no '
            'evidence of wear.'
        )

    def unit(self, hypothesis: str) -> str:
        """Unit of an effect or fault, '' for a share."""
        unit = self.catalogue[hypothesis.split('.')[0]].terms[0].unit
        return '' if unit == '1' else unit

    def ends(self, drive: int, change: Change) -> tuple[float, float]:
        """Return the estimate before and after a change, in its unit; drive: index."""
        label = (change.hypothesis, 0)
        labels = self.histories[drive].labels
        before = float(self.points[drive].level[labels.index(label)]) if label in labels else 0.0
        earlier = [c for c in self.result.models[drive].changes if c is not change]
        before += sum(
            c.size
            for c in earlier
            if c.hypothesis == change.hypothesis and c.profile.end <= change.profile.begin
        )
        return before, before + change.size

    def percent(self, drive: int, change: Change) -> float | None:
        """Return the change in per cent of the level before; for a gain, the gain in per cent.

        None for errors of the measurement, and where nothing was there before for certain.
        """
        if change.hypothesis == 'power_gain':
            return 100.0 * change.size
        if self.catalogue[change.hypothesis.split('.')[0]].kind == 'measurement':
            return None
        before, _ = self.ends(drive, change)
        place = self.histories[drive].labels.index((change.hypothesis, 0))
        least = _WIDTH * float(self.points[drive].level_errors[place])
        return 100.0 * change.size / before if before > max(least, 1e-12) else None

    def watts(self, drive: int, change: Change) -> float:
        """Return the mean power of a change over the recordings, W; drive: index."""
        history = self.histories[drive]
        if change.hypothesis == 'power_gain':
            return history.mean_power * change.size
        column = history.labels.index((change.hypothesis, 0))
        return float(history.watts[column] * change.size)

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `track --json` writes them."""
        return {
            'series': [
                self._series(drive, column)
                for drive, history in enumerate(self.histories)
                for column in range(len(history.labels))
            ],
            'alarms': self.alarms,
            'explained_by': [
                {
                    'drive': self.histories[one.drive].drive,
                    'effect': one.change.hypothesis,
                    'covariate': one.covariate,
                    'text': self._explained(one),
                }
                for one in self.result.explained
            ],
            'sentence': self.sentence,
            'model': self.model.name,
            'false_alarm_rate': FALSE_ALARMS,
            'covariates': {own.drive: list(own.names) for own in self.histories},
            'in_common': {
                name: {'value': short(own.value), 'spread': short(own.spread)}
                for (name, term), own in self.common.items()
                if term == 0
            },
            'unmodelled': [one.json(drive) for drive, one in self.unmodelled.items()],
            'left_out': list(self.left_out),
        }

    def _series(self, drive: int, column: int) -> dict[str, Any]:
        history, points = self.histories[drive], self.points[drive]
        name, term = history.labels[column]
        known = self.catalogue[name.split('.')[0]].terms[term]
        values, errors = points.values[:, column], _WIDTH * points.errors[:, column]
        return {
            'drive': history.drive,
            'effect': name,
            'symbol': known.symbol,
            'unit': known.unit,
            'points': [
                {
                    'recording': recording,
                    'time': float(time),
                    'value': short(float(value)),
                    'interval': [short(float(value - error)), short(float(value + error))],
                }
                for recording, time, value, error in zip(
                    history.recordings, history.time, values, errors, strict=True
                )
            ],
            'change': self._change(drive, column),
        }

    def _change(self, drive: int, column: int) -> dict[str, Any]:
        history, points = self.histories[drive], self.points[drive]
        name, term = history.labels[column]
        own = (
            finding
            for finding in self.result.findings
            if finding.drive == drive and finding.change.hypothesis == name and term == 0
        )
        finding = next(own, None)
        if finding is None:
            level, error = float(points.level[column]), float(points.level_errors[column])
            certainty = self.result.certainties[drive].get(name, 0.0) if term == 0 else 0.0
            return {
                'verdict': 'steady',
                'at': None,
                'from': short(level),
                'to': short(level),
                'interval': [short(level - _WIDTH * error), short(level + _WIDTH * error)],
                'certainty': round(min(certainty, 1.0 - FALSE_ALARMS), 4),
            }
        change = finding.change
        begin, end = self.ends(drive, change)
        error = _WIDTH * change.error
        percent = self.percent(drive, change)
        return {
            'verdict': 'step' if change.profile.step else 'drift',
            'at': history.recordings[change.profile.first],
            'until': history.recordings[change.profile.end],
            'from': short(begin),
            'to': short(end),
            'interval': [short(end - error), short(end + error)],
            'certainty': round(finding.certainty, 4),
            'percent': None if percent is None else round(percent, 2),
            'watts': round(self.watts(drive, change), 4),
            'could_be': [rival.hypothesis for rival in finding.rivals],
        }


def model_of(model: object, spec: str) -> EffectModel:
    """Return the model, with the file of its base by an absolute path, as workers need it.

    InputError where it has no effects that could change.
    """
    if not isinstance(model, EffectModel):
        raise InputError(f'--model {spec}: track needs a model of effects (model.yaml)')
    prefix, _, file = (model.base or '').rpartition(':')
    base = f'{prefix}:{Path(file).absolute()}' if prefix else model.base
    return replace(model, base=base, base_model=None)  # workers load their own


def track(
    paths: Sequence[Path],
    request: Request,
    index: RecordingIndex,
    engine: TaskEngine,
    show: Callable[[str], None] = lambda text: None,
) -> Tracked:
    """Fit a model to each recording and find what changes over time.

    Fits are taken from the index or kept in it; engine: runs them in processes; show: takes texts
    of progress. Recordings that are damaged, too short or too still are left out. Of the drives
    that changed most, recordings before and after are diagnosed; an effect that they name is
    tracked, too. InputError where no recording is left.
    """
    read = read_fits(paths, request, index, engine, show)
    if not read.fits:
        raise InputError(f'no recording says anything: {read.left_out[0]}')
    show('searching for changes')
    found = tracked(read.fits, request.model, request.catalogue, read.left_out)
    unmodelled: dict[str, Unmodelled] = {}
    seen: set[str] = set()
    while len(seen) < _MOST_EXPLAINED and (suspect := _suspect(found, seen)) is not None:
        drive, change, growth = suspect
        history = found.histories[drive]
        seen.add(history.drive)
        one = explain(history, change, growth, read.paths, request, show)
        if one is None:
            continue
        unmodelled[history.drive] = one
        if one.added:
            request = request.with_effects(one.added)
            read = read_fits(paths, request, index, engine, show)
            found = tracked(read.fits, request.model, request.catalogue, read.left_out)
    return replace(found, unmodelled=unmodelled, paths=read.paths)


def _suspect(found: Tracked, seen: Collection[str]) -> tuple[int, Change, Growth | None] | None:
    """Return the drive that the model may miss more of than before, since when, and the growth."""
    grown = growths(found.histories)
    changed = [f for f in found.result.findings if f.change.hypothesis != TIME_OFFSET]
    by_drive = {growth.drive: growth for growth in grown}
    every: list[Growth | CertainChange] = [*grown, *changed]
    for one in every:
        if found.histories[one.drive].drive not in seen:
            return one.drive, one.change, by_drive.get(one.drive)
    return None


def tracked(
    fits: Sequence[RecordingFit],
    model: EffectModel,
    catalogue: Catalogue,
    left_out: Sequence[str] = (),
) -> Tracked:
    """Find what changes in the fits of several recordings; left_out: recordings, with reasons."""
    own = histories(fits)
    result = search(own, catalogue)
    common = common_levels(result.models)
    return Tracked(
        model=model,
        catalogue=catalogue,
        histories=tuple(own),
        result=result,
        points=tuple(shrunk(one, common) for one in result.models),
        common=common,
        left_out=tuple(left_out),
    )


def _name(hypothesis: str) -> str:
    return hypothesis.replace('_', ' ')
