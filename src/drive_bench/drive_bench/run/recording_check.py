"""Check of a recording against its motion: samples, losses, coverage."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from power_recordings.messages.samples import DriveSamples, JointSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.segments import Segment

_FELL_SHORT = 0.8  # of what was asked
_AT_LIMIT = 0.98
_MOST = 99.9  # percentile that counts as reached: single noisy samples do not
_SMOOTH = 5  # samples of speed over which acceleration is taken


@dataclass(frozen=True)
class CheckRow:
    """One line of the check: requested and reached value; amiss: the deficiency, '' if none."""

    name: str
    asked: str
    reached: str
    amiss: str = ''


@dataclass
class RecordingCheck:
    """Result of a check: rows of a table, and figures by name (None if unknown)."""

    rows: list[CheckRow] = field(default_factory=list)
    figures: dict[str, float | None] = field(default_factory=dict)

    def add(self, name: str, asked: str, reached: str, amiss: str = '') -> None:
        """Add a row, with the fields of `CheckRow`."""
        self.rows.append(CheckRow(name, asked, reached, amiss))

    def note(self, **figures: float) -> None:
        """Add figures by name; those that are not finite are unknown."""
        for name, value in figures.items():
            self.figures[name] = value if math.isfinite(value) else None

    @property
    def usable(self) -> bool:
        """True if there are valid samples of power and samples of joints."""
        known = self.figures.get('power_mean') is not None
        return known and bool(self.figures.get('joint_samples'))

    @property
    def amiss(self) -> tuple[str, ...]:
        """Deficiencies as text, with the names of their rows."""
        return tuple(f'{row.name}: {row.amiss}' for row in self.rows if row.amiss)


def check(
    bag: Path, motion: MotionFile, drive: str, limits: JointLimits, complete: bool = True
) -> RecordingCheck:
    """Read a bag back and compare one drive's recording with its motion.

    complete: whether the motion reached its end; else no shortfall is reported. An unreadable bag
    is a row of the result, not an error.
    """
    found = RecordingCheck()
    try:
        recording = Recording.open(bag)
        supply, joints = recording.drive_supply(), recording.joint_states()
        place, meter = joints.names.index(drive), supply.names.index(drive)
    except (InputError, ValueError) as error:
        found.add('recording', 'readable', 'no', str(error))
        return found
    _count(found, recording, supply, joints)
    moving = _while_moving(recording, joints)
    _compare(found, motion, joints, place, moving, limits, complete)
    _read_meter(found, motion, supply, meter, complete)
    return found


def _count(
    found: RecordingCheck, recording: Recording, supply: DriveSamples, joints: JointSamples
) -> None:
    apart = np.diff(joints.stamp_ns)
    usual = float(np.median(apart)) if len(apart) else math.inf
    missing = int(np.rint(apart / usual - 1.0).clip(min=0).sum()) if len(apart) else 0
    commands = len(recording.joint_commands()) if recording.has('joint_commands') else 0
    for name, count, lost in (
        ('drive_supply', len(supply), supply.lost),
        ('joint_states', len(joints), missing),
    ):
        found.add(name, 'none lost', f'{count} samples', f'{lost} lost' if lost else '')
    found.add('joint_commands', 'recorded', f'{commands}', '' if commands else 'none recorded')
    for text in recording.problems:
        found.add('bag', 'whole', 'as far as it goes', text)
    found.note(supply_samples=len(supply), supply_lost=supply.lost)
    found.note(joint_samples=len(joints), joint_lost=missing)


def _while_moving(recording: Recording, joints: JointSamples) -> slice:
    if not recording.has('joint_commands'):
        return slice(None)
    stamps = recording.joint_commands().stamp_ns
    first, last = np.searchsorted(joints.stamp_ns, (stamps[0], stamps[-1]))
    return slice(int(first), int(last) + 1)


def _compare(
    found: RecordingCheck,
    motion: MotionFile,
    joints: JointSamples,
    place: int,
    moving: slice,
    limits: JointLimits,
    complete: bool,
) -> None:
    position, speed, torque = (
        np.asarray(values[moving, place], np.float64)
        for values in (joints.position, joints.velocity, joints.effort)
    )
    read = np.isfinite(position) & np.isfinite(speed)
    unread = int(np.count_nonzero(~read))
    if np.count_nonzero(read) < 2 * _SMOOTH:
        found.add('motion', 'recorded', 'nothing', 'too few readings to tell')
        found.note(unread=unread)
        return
    seconds = np.median(np.diff(joints.stamp_ns[moving])) * 1e-9
    smooth = np.convolve(speed, np.full(_SMOOTH, 1.0 / _SMOOTH), 'valid')
    reached = {
        'speed': _most(speed),
        'torque': _most(torque),
        'acceleration': _most(np.gradient(smooth, seconds)),
    }
    saturates = any(segment.saturate for segment in motion.segments)
    asked = {
        'speed': max(segment.fastest for segment in motion.segments),
        'torque': motion.strongest,
        'acceleration': max(map(_sharpest, motion.segments)),
    }
    if unread:
        text = f'{unread} without position or speed'
        found.add('readings', 'all finite', text, text)
    for name, unit in (('speed', 'rad/s'), ('torque', 'N·m'), ('acceleration', 'rad/s²')):
        wanted, got = asked[name], reached[name]
        short = complete and not saturates and got < _FELL_SHORT * wanted < math.inf
        aim = f'{wanted:.3g} {unit}' if 0.0 < wanted < math.inf else '–'
        seen = f'{got:.3g} {unit}' if math.isfinite(got) else 'unknown'
        note = ' (more than the drive can follow, as meant)' if saturates and got < wanted else ''
        amiss = f'only {100 * got / wanted:.0f} % of what was asked' if short else ''
        found.add(name, aim, seen + note, amiss)
        found.note(**{f'{name}_reached': got})
    low, high = float(position[read].min()), float(position[read].max())
    beyond = max(limits.low - low, high - limits.high)
    found.add(
        'position',
        asked=f'{limits.low:.3g}..{limits.high:.3g} rad',
        reached=f'{low:.3g}..{high:.3g} rad',
        amiss=f'{beyond:.2g} rad beyond' if beyond > 0.0 else '',
    )
    known = np.isfinite(torque)
    at_limit = np.abs(torque[known]) >= _AT_LIMIT * limits.torque
    clipped = 100.0 * float(at_limit.mean()) if known.any() else math.nan
    fast = 100.0 * float(np.mean(np.abs(speed[read]) > limits.speed))
    for name, limit, percent in (
        ('torque at the limit', f'{limits.torque:g} N·m', clipped),
        ('speed over the limit', f'{limits.speed:g} rad/s', fast),
    ):
        text = 'unknown' if math.isnan(percent) else f'{percent:.1f} % of the time'
        amiss = text if percent > 0.0 and not saturates else ''
        found.add(name, f'never ({limit})', text, amiss)
    found.note(position_low=low, position_high=high, unread=unread)
    found.note(torque_clipped_percent=clipped, speed_over_percent=fast)


def _read_meter(
    found: RecordingCheck, motion: MotionFile, supply: DriveSamples, meter: int, complete: bool
) -> None:
    measured = np.asarray(supply.power[:, meter], np.float64)
    sound = supply.status[:, meter] == 0
    good = sound & np.isfinite(measured)
    flagged, unread = (int(np.count_nonzero(each)) for each in (~sound, sound & ~good))
    if good.any():
        power, voltage = measured[good], supply.voltage[good, meter]
        text = f'{power.mean():.1f} W, {power.min():.0f} to {power.max():.0f} W'
        found.add('power', '–', text, '' if power.any() else 'zero throughout')
        found.add('voltage', '–', f'{voltage.min():.1f} to {voltage.max():.1f} V')
        found.note(power_mean=float(power.mean()), power_peak=float(power.max()))
    else:
        found.add('power', '–', 'unknown', 'no good sample')
        found.note(power_mean=math.nan, power_peak=math.nan)
    told = f'{flagged} flagged' + (f', {unread} without a value' if unread else '')
    found.add('meter', 'no flags', told, told if flagged or unread else '')
    warmth = supply.temperature[:, meter]
    known = warmth[np.isfinite(warmth)]
    if len(known):
        rise = float(known.max() - known[0])
        wanted = max(segment.until_warmer for segment in motion.segments)
        found.add(
            'winding',
            asked=f'{wanted:g} K warmer' if wanted else '–',
            reached=f'{known[0]:.1f} to {known.max():.1f} °C, {known[-1]:.1f} °C at the end',
            amiss=f'only {rise:.1f} K' if complete and rise < _FELL_SHORT * wanted else '',
        )
        found.note(winding_rise=rise, winding_end=float(known[-1]))
    found.note(flagged=flagged, without_value=unread)


def _most(values: Floats) -> float:
    """Return the 99.9th percentile of the sizes without NaN; NaN if there are no others."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.percentile(known, _MOST)) if len(known) else math.nan


def _sharpest(segment: Segment) -> float:
    """Return the largest commanded acceleration of a sine or chirp, rad/s²; 0 for others."""
    turn = 2.0 * math.pi * segment.frequency
    if segment.swings or segment.shape in ('chirp', 'sine'):
        if segment.mode == 'position':
            return turn * turn * abs(segment.amplitude)
        if segment.mode == 'velocity':
            return turn * abs(segment.amplitude)
    return 0.0


def check_table(rows: Sequence[CheckRow]) -> str:
    """Return the rows as aligned text."""
    cells = [('', 'asked', 'reached', '')]
    cells += [
        (row.name, row.asked, row.reached, '! ' + row.amiss if row.amiss else 'ok') for row in rows
    ]
    widths = [max(len(row[column]) for row in cells) for column in range(4)]
    lines = []
    for row in cells:
        padded = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        lines.append('  '.join(padded).rstrip())
    return '\n'.join(lines)
