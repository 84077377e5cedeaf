"""Levels by policy from sound files, recordings and a calibrator."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError

from sound_levels.levels import statistics
from sound_levels.levels.alignment import Alignment, Events, align_sound, events_of
from sound_levels.levels.meter import SETTLED, Sound, measure, reach
from sound_levels.levels.settings import TIMES, Entry, Settings
from sound_levels.levels.sound_file import SoundFile
from sound_levels.levels.statistics import Difference, Levels, Stretch, decibels

_WINDOW = 0.5  # s
_LONGEST = 120.0  # s, searched for a tone
_STEADY = 0.5  # dB around the median level
_NEEDED = 2.0  # s
_PURE = 0.9  # least share of the tone in the power above 200 Hz
_LOWEST = 200.0  # Hz
_ALIKE = 3.0  # dB between the channels


@dataclass(frozen=True)
class CalibratorTone:
    """Recorded tone of a calibrator.

    frequency: Hz. mean_square: of the tone alone, in units of full scale. spread: standard
    deviation of its level over half seconds, dB. seconds: steady duration.
    """

    rate: int
    frequency: float
    mean_square: float
    spread: float
    seconds: float
    level: float  # dB SPL that the calibrator makes


def read_tone(file: SoundFile, level: float, frequency: float = 1000.0) -> CalibratorTone:
    """Find the steady tone in a recording of a calibrator; level: its level in dB SPL.

    InputError if there is none within 10 % of `frequency`, Hz, for 2 s, or if it is clipped. Also
    if channels differ by more than 3 dB (only one was in the calibrator).
    """
    length, longest = round(_WINDOW * file.rate), round(_LONGEST * file.rate)
    kept = [block for block in file.blocks() if file.frames - len(block) < longest]
    if file.clipped:
        raise InputError(f'{file.path}: the calibrator is clipped; record it again with less gain')
    if min(file.frames, longest) < length:
        raise InputError(f'{file.path} is too short: record the calibrator for 10 s')
    samples = np.concatenate(kept)[:longest]
    windows = samples[: len(samples) // length * length].reshape(-1, length, samples.shape[1])
    found = [_tone_in(window, file.rate, frequency) for window in windows]
    by_channel, shares, pitches = (np.array(values) for values in zip(*found, strict=True))
    total = by_channel.mean(axis=1)
    pure = (shares >= _PURE) & (total > 0)
    if pure.sum() * _WINDOW < _NEEDED:
        raise InputError(
            f'{file.path} holds no pure tone of {frequency:g} Hz for {_NEEDED:g} s '
            f'({pure.sum() * _WINDOW:g} s found); is the calibrator on the microphone?'
        )
    levels = np.full(len(total), -np.inf)
    levels[pure] = 10.0 * np.log10(total[pure])
    steady = np.abs(levels - np.median(levels[pure])) <= _STEADY
    if steady.sum() * _WINDOW < _NEEDED:
        raise InputError(
            f'{file.path}: the tone is not steady to {_STEADY:g} dB for {_NEEDED:g} s'
        )
    means = 10.0 * np.log10(np.maximum(by_channel[steady].mean(axis=0), 1e-30))
    if np.ptp(means) > _ALIKE:
        best = int(np.argmax(means)) + 1
        raise InputError(
            f'{file.path}: the tone is {np.ptp(means):.0f} dB louder on channel {best}; '
            f'choose it with --channel {best}'
        )
    return CalibratorTone(
        rate=file.rate,
        frequency=float(np.median(pitches[steady])),
        mean_square=float(total[steady].mean()),
        spread=float(levels[steady].std()),
        seconds=float(steady.sum() * _WINDOW),
        level=level,
    )


def _tone_in(part: Floats, rate: int, frequency: float) -> tuple[Floats, float, float]:
    """Return the tone's mean square by channel, its share of power above 200 Hz, and frequency."""
    window = np.hanning(len(part))
    spectrum = np.abs(np.fft.rfft((part - part.mean(axis=0)) * window[:, None], axis=0)) ** 2
    spectrum *= 2.0 / (np.square(window).sum() * len(part))
    pitch = np.fft.rfftfreq(len(part), 1.0 / rate)
    near = np.abs(pitch - frequency) <= 0.1 * frequency
    summed = spectrum.sum(axis=1)
    peak = int(np.argmax(np.where(near, summed, -1.0)))
    tone = slice(max(0, peak - 8), peak + 9)
    audible = float(summed[pitch >= min(_LOWEST, 0.5 * frequency)].sum())
    share = float(summed[tone].sum()) / audible if audible > 0 else 0.0
    return spectrum[tone].sum(axis=0), share, float(pitch[peak])


_LEAST = 2.0  # s that must be evaluated
_PAUSE = 1.0  # s between landings of one walk
_EXPECTED_REACH = 8000.0  # Hz


@dataclass(frozen=True)
class Take:
    """Measurement of one sound file; counted: mask [N] of evaluated bins, `why` says why."""

    path: Path
    policy: str
    sound: Sound
    warnings: tuple[str, ...]
    counted: Bools
    why: str
    alignment: Alignment | None = None
    events: Events | None = None
    recording: Path | None = None

    @property
    def stretch(self) -> Stretch:
        """Evaluated part of the sound, in the form that `statistics` takes."""
        return Stretch.of(self.sound, self.counted)


@dataclass(frozen=True)
class Analysis:
    """Measurements of all files, with the calibrator's tone, if any."""

    settings: Settings
    takes: tuple[Take, ...]
    tone: CalibratorTone | None
    warnings: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """The unit, such as `dB(A) SPL`, or `dBFS(A)` without a calibrator."""
        letter = self.settings.weighting
        return f'dB({letter}) SPL' if self.tone is not None else f'dBFS({letter})'

    @property
    def shift(self) -> float:
        """Offset in dB to add to levels re full scale squared, to get them in `unit`."""
        if self.tone is None:
            return float(decibels(2.0))
        return self.tone.level - float(decibels(self.tone.mean_square))

    @property
    def policies(self) -> tuple[str, ...]:
        """Names of the policies, in the order of the files."""
        return tuple(dict.fromkeys(take.policy for take in self.takes))

    def of(self, policy: str) -> list[Take]:
        """Return the takes of a policy."""
        return [take for take in self.takes if take.policy == policy]

    def levels(self, takes: Sequence[Take]) -> Levels:
        """Return the level statistics of several takes together, in `unit`."""
        return statistics.levels([take.stretch for take in takes], self.shift)

    def bands(self, policy: str) -> dict[float, float]:
        """Return the unweighted third-octave levels in the unit, by frequency in Hz."""
        sounds = [take.sound for take in self.of(policy)]
        weights = [sound.seconds for sound in sounds]
        found = {}
        for band in sorted(set.intersection(*(set(sound.bands) for sound in sounds))):
            mean = np.average([sound.bands[band] for sound in sounds], weights=weights)
            found[band] = float(decibels(mean) + self.shift)
        return found

    def differences(self) -> dict[str, tuple[Mapping[str, Difference], float | None]]:
        """Return differences of the levels of each other policy from the first, dB, by policy."""
        first, *others = self.policies
        base = [take.stretch for take in self.of(first)]
        return {
            name: statistics.differences(base, [take.stretch for take in self.of(name)])
            for name in others
        }


def analyse(
    entries: Sequence[Entry],
    settings: Settings,
    calibration: Path | None = None,
    progress: Callable[[str], None] = lambda path: None,
) -> Analysis:
    """Measure sound files; InputError for one that cannot be measured.

    calibration: recording of a calibrator; levels are relative to full scale without it.
    """
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


def _take(entry: Entry, settings: Settings, tone: CalibratorTone | None) -> Take:
    file = SoundFile(entry.path, settings.channel)
    try:
        sound = measure(file.blocks(), file.rate, settings.weighting, settings.time)
    except InputError as error:
        text = str(error)
        prefix = '' if text.startswith(str(entry.path)) else f'{entry.path}: '
        raise InputError(prefix + text) from None
    warnings = list(file.warnings)
    good = reach(file.rate)
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
            warnings.append(f'could not be aligned with {entry.recording}: the whole file counts')
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
) -> tuple[Bools, str]:
    time = sound.time
    counted = time >= SETTLED * TIMES[settings.time]
    if settings.start is not None or settings.stop is not None:
        start = settings.start or 0.0
        stop = np.inf if settings.stop is None else settings.stop
        return counted & (time >= start) & (time <= stop), 'as given by --from and --to'
    if alignment is not None and events is not None and len(events.landings) > 1:
        there = alignment.of(time)
        last = np.searchsorted(events.landings, there, side='right') - 1
        since = there - events.landings[np.maximum(last, 0)]
        walking = counted & (last >= 0) & (since <= _PAUSE)
        return walking, f'while feet land at least every {_PAUSE:g} s'
    return counted, 'the whole file'
