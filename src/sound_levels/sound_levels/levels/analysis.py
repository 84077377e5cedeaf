"""Sound files, recordings and a calibrator to levels by policy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from sound_levels.levels.alignment import Alignment, align_sound
from sound_levels.levels.comparison import (
    ENOUGH,
    Difference,
    Levels,
    Stretch,
    decibels,
    differences,
    levels,
)
from sound_levels.levels.events import Events, events_of
from sound_levels.levels.meter import SETTLED, TIMES, Sound, measure
from sound_levels.levels.sound_file import SoundFile
from sound_levels.levels.tone import Tone, read_tone
from sound_levels.levels.weighting import reach

Floats = NDArray[np.float64]

_LEAST = 2.0  # s that must be left to count
_PAUSE = 1.0  # s
_EXPECTED_REACH = 8000.0  # Hz


@dataclass(frozen=True)
class Settings:
    """
    How to measure: weighting A, C or Z, time fast or slow, channel from 1 (None: all).

    align: a method of `alignment`; clap_at: s after a recording's start. start, stop: what
    counts of each file, s, None for its ends. level, tone: of the calibrator, dB SPL and Hz.
    """

    weighting: str = 'A'
    time: str = 'fast'
    channel: int | None = None
    align: str = 'auto'
    clap_at: float | None = None
    start: float | None = None
    stop: float | None = None
    level: float = 94.0
    tone: float = 1000.0

    def __post_init__(self) -> None:
        for name, value, low, high, unit in (
            ('--level', self.level, 40.0, 160.0, 'dB'),
            ('--tone', self.tone, 60.0, 4000.0, 'Hz'),
            ('--clap-at', self.clap_at, 0.0, 86_400.0, 's'),
            ('--from', self.start, 0.0, 86_400.0, 's'),
            ('--to', self.stop, 0.0, 86_400.0, 's'),
        ):
            if value is not None and not low <= value <= high:
                raise InputError(f'{name} is {value:g}; it must lie in {low:g}..{high:g} {unit}')


@dataclass(frozen=True)
class Take:
    """One sound file, measured; counted [N] says which bins count."""

    path: Path
    policy: str
    sound: Sound
    warnings: tuple[str, ...]
    counted: NDArray[np.bool_]
    why: str
    alignment: Alignment | None = None
    events: Events | None = None
    recording: Path | None = None

    @property
    def mean_level(self) -> Floats:
        """Mean square over the second around each bin [N]."""
        width = min(max(1, round(1.0 / self.sound.step)), len(self.sound.energy))
        return np.convolve(self.sound.energy, np.ones(width) / width, mode='same')

    @property
    def stretch(self) -> Stretch:
        """What counts, for statistics."""
        sound, rows = self.sound, self.counted
        return Stretch.of(
            self.path.name,
            sound.step,
            sound.energy[rows],
            sound.detector[rows],
            sound.highest[rows],
        )


@dataclass(frozen=True)
class Analysis:
    """All takes, with the unit that their levels are in."""

    settings: Settings
    takes: tuple[Take, ...]
    tone: Tone | None
    warnings: tuple[str, ...] = field(default=())

    @property
    def unit(self) -> str:
        """Such as `dB(A) SPL`, or `dBFS(A)` where nothing was calibrated."""
        letter = self.settings.weighting
        return f'dB({letter}) SPL' if self.tone is not None else f'dBFS({letter})'

    @property
    def shift(self) -> float:
        """DB from a mean square in units of full scale to the unit."""
        return float(decibels(np.array(2.0)) if self.tone is None else self.tone.decibels(1.0))

    @property
    def policies(self) -> tuple[str, ...]:
        """Names in the order in which they were given."""
        return tuple(dict.fromkeys(take.policy for take in self.takes))

    def of(self, policy: str) -> list[Take]:
        """The takes of a policy."""
        return [take for take in self.takes if take.policy == policy]

    def levels(self, policy: str) -> Levels:
        """Levels of a policy in the unit."""
        return self._shifted(levels([take.stretch for take in self.of(policy)]))

    def take_levels(self, take: Take) -> Levels:
        """Levels of one take in the unit."""
        return self._shifted(levels([take.stretch]))

    def _shifted(self, found: Levels) -> Levels:
        shifted = {k: v + self.shift for k, v in asdict(found).items() if k != 'seconds'}
        return Levels(seconds=found.seconds, **shifted)

    def trace(self, take: Take) -> Floats:
        """The level over time, at the end of each bin, in the unit [N]."""
        return decibels(take.sound.detector) + self.shift

    def bands(self, policy: str) -> dict[float, float]:
        """Third-octave levels without weighting, in the unit (unweighted), by frequency in Hz."""
        takes = self.of(policy)
        common = set.intersection(*(set(take.sound.bands) for take in takes))
        weights = [take.sound.seconds for take in takes]
        return {
            band: float(
                decibels(np.average([t.sound.bands[band] for t in takes], weights=weights))
                + self.shift
            )
            for band in sorted(common)
        }

    def differences(self) -> dict[str, tuple[Mapping[str, Difference], float | None]]:
        """By how much each policy but the first is louder than the first."""
        first, *others = self.policies
        base = [take.stretch for take in self.of(first)]
        return {name: differences(base, [t.stretch for t in self.of(name)]) for name in others}


@dataclass(frozen=True)
class Entry:
    """A sound file to analyse, of a policy (empty: the recording's card, or the file's name)."""

    path: Path
    policy: str = ''
    recording: Path | None = None


def analyse(
    entries: Sequence[Entry],
    settings: Settings,
    calibration: Path | None = None,
    progress: Callable[[str], None] = lambda path: None,
) -> Analysis:
    """Measure files one after the other; InputError for what cannot be measured."""
    tone, warnings = None, []
    if calibration is not None:
        file = SoundFile(calibration, settings.channel)
        tone = read_tone(file, settings.level, settings.tone)
        warnings += [f'{calibration.name}: {text}' for text in file.warnings]
    takes = []
    for entry in entries:
        progress(entry.path.name)
        takes.append(_take(entry, settings, tone))
    return Analysis(settings, tuple(takes), tone, tuple(warnings))


def _take(entry: Entry, settings: Settings, tone: Tone | None) -> Take:
    file = SoundFile(entry.path, settings.channel)
    try:
        sound = measure(file.blocks(), file.rate, settings.weighting, settings.time)
    except InputError as error:
        named = str(error)
        raise InputError(
            named if named.startswith(str(entry.path)) else f'{entry.path}: {named}'
        ) from None
    warnings = list(file.warnings)
    good = reach(settings.weighting, file.rate)
    if good < _EXPECTED_REACH:
        warnings.append(
            f'{file.rate} Hz holds sound up to {good:g} Hz only; what lies above is missing '
            'from the levels: record at 22.05 kHz or more'
        )
    if tone is not None and tone.rate != file.rate:
        warnings.append(
            f'the calibrator was recorded at {tone.rate} Hz, this at {file.rate} Hz: levels are '
            'right only if the gain was the same'
        )
    policy, events, alignment = entry.policy, None, None
    if entry.recording is not None:
        recording = Recording.open(entry.recording)
        policy = policy or recording.card.controller
        events = events_of(recording)
        try:
            alignment = align_sound(sound, events, settings.align, settings.clap_at)
        except InputError as error:
            raise InputError(f'{entry.path} with {entry.recording}: {error}') from None
        if alignment is None and settings.align != 'none':
            warnings.append(f'could not be laid on {entry.recording}: the whole file counts')
        elif alignment is not None:
            warnings += alignment.notes
    counted, why = _counted(sound, settings, alignment, events)
    if counted.sum() * sound.step < _LEAST:
        raise InputError(
            f'{entry.path}: only {counted.sum() * sound.step:.1f} s count ({why}); '
            f'{_LEAST:g} s are needed'
        )
    return Take(
        path=entry.path,
        policy=policy or entry.path.stem,
        sound=sound,
        warnings=tuple(warnings),
        counted=counted,
        why=why,
        alignment=alignment,
        events=events,
        recording=entry.recording,
    )


def _counted(
    sound: Sound, settings: Settings, alignment: Alignment | None, events: Events | None
) -> tuple[NDArray[np.bool_], str]:
    time = sound.time
    settled = SETTLED * TIMES[settings.time]
    counted = time >= settled
    why = 'the whole file'
    if settings.start is not None:
        counted &= time >= settings.start
    if settings.stop is not None:
        counted &= time <= settings.stop
    if settings.start is not None or settings.stop is not None:
        return counted, 'as given by --from and --to'
    if alignment is not None and events is not None and len(events.landings) > 1:
        there = alignment.of(time)
        last = np.searchsorted(events.landings, there, side='right') - 1
        since = there - events.landings[np.maximum(last, 0)]
        walking = counted & (last >= 0) & (since <= _PAUSE)
        return walking, f'while feet land at least every {_PAUSE:g} s'
    return counted, why


def sentences(analysis: Analysis) -> list[str]:
    """By how much each policy is louder than the first, in words."""
    first, found = analysis.policies[0], []
    for name, (figures, _) in analysis.differences().items():
        leq = figures['leq']
        low, high = leq.interval
        sure = 'louder' if low > 0 else 'quieter' if high < 0 else ''
        span = f'95 % interval {low:+.1f} to {high:+.1f} dB'
        found.append(
            f'{name} is {abs(leq.value):.1f} dB {sure} than {first} (Leq, {span}).'
            if sure
            else f'{name} and {first} cannot be told apart: {leq.value:+.1f} dB (Leq, {span}).'
        )
        fewest = min(len(analysis.of(name)), len(analysis.of(first)))
        if fewest == 1:
            found[-1] += (
                ' With a single file of either, the interval knows nothing of what differs from '
                f'file to file: record at least {ENOUGH} of each.'
            )
        elif fewest < ENOUGH:
            found[-1] += (
                f' {fewest} files tell little of how files differ, and the interval is wide for '
                f'it: record at least {ENOUGH} of each.'
            )
    return found


def summary(analysis: Analysis) -> dict[str, Any]:
    """The analysis as plain values for JSON."""
    settings, tone = analysis.settings, analysis.tone
    return {
        'unit': analysis.unit,
        'weighting': settings.weighting,
        'time_weighting': settings.time,
        'calibration': None if tone is None else asdict(tone),
        'files': [
            {
                'path': str(take.path),
                'policy': take.policy,
                'rate_hz': take.sound.rate,
                'seconds': take.sound.seconds,
                'counted': take.why,
                **_levels(analysis.take_levels(take)),
                'recording': None if take.recording is None else str(take.recording),
                'alignment': _alignment(take.alignment),
                'warnings': list(take.warnings),
            }
            for take in analysis.takes
        ],
        'policies': [
            {
                'name': name,
                'files': [str(take.path) for take in analysis.of(name)],
                **_levels(analysis.levels(name)),
                'third_octaves': {f'{k:g}': round(v, 2) for k, v in analysis.bands(name).items()},
            }
            for name in analysis.policies
        ],
        'differences': [
            {
                'name': name,
                'against': analysis.policies[0],
                'interval_by': 'blocks' if block is not None else 'files',
                'block_s': block,
                **{
                    key: {
                        'value': round(d.value, 3),
                        'interval': [round(x, 3) for x in d.interval],
                    }
                    for key, d in found.items()
                },
            }
            for name, (found, block) in analysis.differences().items()
        ],
        'warnings': list(analysis.warnings),
    }


def _levels(found: Levels) -> dict[str, Any]:
    named = {k: round(v, 3) for k, v in asdict(found).items() if k != 'seconds'}
    return {'counted_s': round(found.seconds, 3), **named}


def _alignment(found: Alignment | None) -> dict[str, Any] | None:
    if found is None:
        return None
    values = asdict(found)
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in values.items()
    }
