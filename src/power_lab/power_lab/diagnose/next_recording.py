"""Motion that would settle a diagnosis, as a file that a bench or a robot can execute."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from drive_bench.motion.file import FORMAT, MotionFile
from drive_bench.motion.fitting import fitted
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.segment_path import Mounting
from power_estimator.effects import Catalogue, Excitation
from power_estimator.effects.signals.scale import DriveScale
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

_LONGEST = 1800.0  # s
LEAST_OF_EACH = 60.0
"""
s that the motion of each effect lasts: twelve blocks of five seconds, which are drawn together.

Two effects that differ alike in n of such blocks, and nowhere else, differ by √n standard errors,
however long the rest of the recording is; half of a motion may show nothing.
"""
_RANGE = 6.0  # rad, that a joint turns one way
_MOST_PASSES = 40  # more than a joint of a leg ever needs
SPARE = 1.15  # a pendulum pulls this much more than the largest load


@dataclass(frozen=True)
class Motion:
    """Segments to execute one after the other, with the reason for them."""

    reason: str
    drives: tuple[str, ...]
    segments: tuple[Mapping[str, Any], ...]
    supply: tuple[float, ...] = ()  # V of the bus, to repeat the motion at

    @property
    def seconds(self) -> float:
        """Duration of all segments, s."""
        return _seconds(self.segments)

    def content(self) -> dict[str, Any]:
        """Content of the motion file; units are SI."""
        content: dict[str, Any] = {
            'format': FORMAT,
            'reason': self.reason,
            'drives': list(self.drives),
            'seconds': round(self.seconds, 1),
            'segments': [dict(segment) for segment in self.segments],
        }
        if self.supply:
            content['repeat_at_supply_voltage'] = list(self.supply)
        return content

    def within(self, limits: Mapping[str, JointLimits]) -> 'Motion':
        """Motion fitted to the joint limits of its drives, from where a pendulum hangs.

        That is at 0 rad, or in the middle of a range without 0. InputError for a drive without
        limits.
        """
        motion, changes = MotionFile.of(self.content(), 'motion', 'next'), []
        for drive in self.drives:
            if drive not in limits:
                raise InputError(f'--limits has nothing for {drive}; add it, or a pattern for it')
            own = limits[drive]
            hanging = 0.0 if own.low < 0.0 < own.high else 0.5 * (own.low + own.high)
            pull = SPARE * max(motion.strongest, 1.0)
            motion, notes = fitted(motion, hanging, Mounting(pull, hanging), own)
            changes += [f'{drive}: {note}' for note in notes]
        segments = tuple(segment.content() for segment in motion.segments)
        fit = f'; fitted to the joint: {"; ".join(changes)}' if changes else ''
        return replace(self, segments=segments, reason=self.reason + fit)

    def save(self, path: Path) -> None:
        """Write the motion to a YAML file."""
        text = yaml.safe_dump(self.content(), sort_keys=False, allow_unicode=True, width=98)
        write_whole(path, text)


def separating_motion(
    effects: Sequence[str],
    catalogue: Catalogue,
    drives: Sequence[str],
    reason: str,
    scale: DriveScale | None = None,
) -> Motion:
    """Motion that tells effects apart, each shown for long enough, slow segments before fast.

    reason: sentence that the motion begins with; scale: sizes of the drives, to the smallest of
    which the catalogue's speeds and loads, those of a reference drive, are scaled.
    """
    segments: list[Mapping[str, Any]] = [{'mode': 'rest', 'seconds': 10.0}]
    supply: set[float] = set()
    texts = []
    for name in effects:
        excitation = _scaled(catalogue[name].excitation, scale)
        texts.append(f'{name}: {excitation.told(len(drives))}')
        supply.update(excitation.supply)
        new = _segments(excitation)
        seconds = _seconds(new)
        if seconds:  # too short a time would not be told from chance
            new = new * max(1, math.ceil(LEAST_OF_EACH / seconds))
        if not all(segment in segments for segment in new):
            segments += new
    total = _seconds(segments)
    if total > _LONGEST:  # all are shortened alike
        segments = [
            {**segment, 'seconds': round(float(segment['seconds']) * _LONGEST / total, 1)}
            for segment in segments
        ]
    whole = reason + '; ' + '; '.join(dict.fromkeys(texts)) if texts else reason
    return Motion(whole, tuple(drives), tuple(segments), tuple(sorted(supply)))


def _seconds(segments: Iterable[Mapping[str, Any]]) -> float:
    return sum(float(segment['seconds']) for segment in segments)


def _scaled(excitation: Excitation, scale: DriveScale | None) -> Excitation:
    if scale is None:
        return excitation
    torque, speed, volts = (
        float(values.min()) for values in (scale.torque, scale.speed, scale.voltage)
    )
    return replace(
        excitation,
        speeds=tuple(_short(value * speed) for value in excitation.speeds),
        loads=tuple(_short(value * torque) for value in excitation.loads),
        amplitude=_short(excitation.amplitude * speed),
        supply=tuple(_short(value * volts) for value in excitation.supply),
    )


def _short(value: float) -> float:
    return float(f'{value:.4g}')


def _segments(excitation: Excitation) -> list[Mapping[str, Any]]:
    mode, loads, seconds = excitation.mode, excitation.loads, excitation.seconds
    if excitation.frequency and mode == 'position':
        wave = {'frequency': excitation.frequency, 'amplitude': excitation.amplitude}
        return [{'mode': mode, **wave, 'load': load, 'seconds': seconds} for load in loads]
    if excitation.frequency:
        wave = {'low': min(loads), 'high': max(loads), 'frequency': excitation.frequency}
        return [{'mode': 'torque', **wave, 'seconds': seconds}]
    if mode == 'torque':
        return [
            {'mode': mode, 'torque': load, 'speed': speed, 'seconds': seconds}
            for speed, load in itertools.product(excitation.speeds, loads)
        ]
    sizes = sorted({abs(speed) for speed in excitation.speeds})
    each = (_passes(size, load, seconds) for load, size in itertools.product(loads, sizes))
    return [*itertools.chain.from_iterable(each)]


def _passes(speed: float, load: float, seconds: float) -> list[dict[str, Any]]:
    """There and back at one speed, as often as the joint's range asks for."""
    if speed == 0.0:
        return [{'mode': 'velocity', 'speed': 0.0, 'load': load, 'seconds': seconds}]
    count = min(_MOST_PASSES, max(1, math.ceil(seconds * speed / _RANGE)))
    each = round(seconds / count, 2)
    there = {'mode': 'velocity', 'speed': speed, 'load': load, 'seconds': each}
    back = {**there, 'speed': -speed}
    return [dict(part) for _ in range(count) for part in (there, back)]
