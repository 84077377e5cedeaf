"""Check of a recording against its motion: samples, losses, coverage."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class RecordingCheck:
    """Result of a check: rows of a table, and figures by name (None if unknown)."""

    rows: tuple[CheckRow, ...]
    figures: dict[str, float | None]

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
    try:
        recording = Recording.open(bag)
        supply, joints = recording.drive_supply(), recording.joint_states()
        place, meter = joints.names.index(drive), supply.names.index(drive)
    except (InputError, ValueError) as error:
        return RecordingCheck((CheckRow('recording', 'readable', 'no', str(error)),), {})
    rows, figures = _counts(recording, supply, joints)
    moving = _while_moving(recording, joints)
    more, reached = _coverage(motion, joints, place, moving, limits, complete)
    rows += more
    figures |= reached
    more, reached = _electrical(motion, supply, meter, complete)
    known = {
        name: value if math.isfinite(value) else None
        for name, value in (figures | reached).items()
    }
    return RecordingCheck(tuple(rows + more), known)


def _counts(
    recording: Recording, supply: DriveSamples, joints: JointSamples
) -> tuple[list[CheckRow], dict[str, float]]:
    apart = np.diff(joints.stamp_ns)
    usual = float(np.median(apart)) if len(apart) else math.inf
    missing = int(np.rint(apart / usual - 1.0).clip(min=0).sum()) if len(apart) else 0
    commands = len(recording.joint_commands()) if recording.has('joint_commands') else 0
    rows = [
        _loss('drive_supply', len(supply), supply.lost),
        _loss('joint_states', len(joints), missing),
        CheckRow('joint_commands', 'recorded', f'{commands}', '' if commands else 'none recorded'),
    ]
    rows += [CheckRow('bag', 'whole', 'as far as it goes', text) for text in recording.problems]
    return rows, {
        'supply_samples': len(supply),
        'supply_lost': supply.lost,
        'joint_samples': len(joints),
        'joint_lost': missing,
    }


def _loss(name: str, count: int, lost: int) -> CheckRow:
    return CheckRow(name, 'none lost', f'{count} samples', f'{lost} lost' if lost else '')


def _while_moving(recording: Recording, joints: JointSamples) -> slice:
    if not recording.has('joint_commands'):
        return slice(None)
    stamps = recording.joint_commands().stamp_ns
    first, last = np.searchsorted(joints.stamp_ns, (stamps[0], stamps[-1]))
    return slice(int(first), int(last) + 1)


def _coverage(
    motion: MotionFile,
    joints: JointSamples,
    place: int,
    moving: slice,
    limits: JointLimits,
    complete: bool,
) -> tuple[list[CheckRow], dict[str, float]]:
    position, speed, torque = (
        np.asarray(values[moving, place], np.float64)
        for values in (joints.position, joints.velocity, joints.effort)
    )
    read = np.isfinite(position) & np.isfinite(speed)
    unread = int(np.count_nonzero(~read))
    if np.count_nonzero(read) < 2 * _SMOOTH:
        return [CheckRow('motion', 'recorded', 'nothing', 'too few readings to tell')], {
            'unread': unread
        }
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
    rows = []
    if unread:
        text = f'{unread} without position or speed'
        rows.append(CheckRow('readings', 'all finite', text, text))
    for name, unit in (('speed', 'rad/s'), ('torque', 'N·m'), ('acceleration', 'rad/s²')):
        wanted, got = asked[name], reached[name]
        short = complete and not saturates and got < _FELL_SHORT * wanted < math.inf
        note = 'more than the drive can follow, as meant' if saturates and got < wanted else ''
        rows.append(
            CheckRow(
                name,
                f'{wanted:.3g} {unit}' if 0.0 < wanted < math.inf else '–',
                (f'{got:.3g} {unit}' if math.isfinite(got) else 'unknown')
                + (f' ({note})' if note else ''),
                f'only {100 * got / wanted:.0f} % of what was asked' if short else '',
            )
        )
    low, high = float(position[read].min()), float(position[read].max())
    beyond = max(limits.low - low, high - limits.high)
    rows.append(
        CheckRow(
            'position',
            f'{limits.low:.3g}..{limits.high:.3g} rad',
            f'{low:.3g}..{high:.3g} rad',
            f'{beyond:.2g} rad beyond' if beyond > 0.0 else '',
        )
    )
    known = np.isfinite(torque)
    at_limit = np.abs(torque[known]) >= _AT_LIMIT * limits.torque
    clipped = 100.0 * float(at_limit.mean()) if known.any() else math.nan
    fast = 100.0 * float(np.mean(np.abs(speed[read]) > limits.speed))
    rows.append(_share('torque at the limit', limits.torque, 'N·m', clipped, saturates))
    rows.append(_share('speed over the limit', limits.speed, 'rad/s', fast, saturates))
    figures = {f'{name}_reached': value for name, value in reached.items()}
    figures |= {'position_low': low, 'position_high': high, 'unread': unread}
    return rows, {**figures, 'torque_clipped_percent': clipped, 'speed_over_percent': fast}


def _share(name: str, limit: float, unit: str, percent: float, meant: bool) -> CheckRow:
    if math.isnan(percent):
        return CheckRow(name, f'never ({limit:g} {unit})', 'unknown')
    text = f'{percent:.1f} % of the time'
    return CheckRow(name, f'never ({limit:g} {unit})', text, text if percent and not meant else '')


def _electrical(
    motion: MotionFile, supply: DriveSamples, meter: int, complete: bool
) -> tuple[list[CheckRow], dict[str, float]]:
    measured = np.asarray(supply.power[:, meter], np.float64)
    sound = supply.status[:, meter] == 0
    good = sound & np.isfinite(measured)
    flagged, unread = (int(np.count_nonzero(each)) for each in (~sound, sound & ~good))
    told = f'{flagged} flagged' + (f', {unread} without a value' if unread else '')
    meter_row = CheckRow('meter', 'no flags', told, told if flagged or unread else '')
    figures = {'power_mean': math.nan, 'power_peak': math.nan}
    if good.any():
        power, voltage = measured[good], supply.voltage[good, meter]
        power_text = f'{power.mean():.1f} W, {power.min():.0f} to {power.max():.0f} W'
        rows = [
            CheckRow('power', '–', power_text, '' if power.any() else 'zero throughout'),
            CheckRow('voltage', '–', f'{voltage.min():.1f} to {voltage.max():.1f} V'),
            meter_row,
        ]
        figures = {'power_mean': float(power.mean()), 'power_peak': float(power.max())}
    else:
        rows = [CheckRow('power', '–', 'unknown', 'no good sample'), meter_row]
    warmth = supply.temperature[:, meter]
    known = warmth[np.isfinite(warmth)]
    if len(known):
        rise = float(known.max() - known[0])
        wanted = max(segment.until_warmer for segment in motion.segments)
        rows.append(
            CheckRow(
                'winding',
                f'{wanted:g} K warmer' if wanted else '–',
                f'{known[0]:.1f} to {known.max():.1f} °C, {known[-1]:.1f} °C at the end',
                f'only {rise:.1f} K' if complete and rise < _FELL_SHORT * wanted else '',
            )
        )
        figures |= {'winding_rise': rise, 'winding_end': float(known[-1])}
    return rows, {**figures, 'flagged': flagged, 'without_value': unread}


def _most(values: Floats) -> float:
    """Return the 99.9th percentile of the sizes without NaN; NaN if there are no others."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.percentile(known, _MOST)) if len(known) else math.nan


def _sharpest(segment: Segment) -> float:
    """Return the largest commanded acceleration of a sine or chirp, rad/s²; 0 for others."""
    turn = 2.0 * math.pi * segment.frequency
    if segment.shape == 'chirp' or segment.swings or segment.shape == 'sine':
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
    widths = [max(len(row[column]) for row in cells) for column in range(3)]
    lines = []
    for *row, note in cells:
        padded = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        lines.append('  '.join((*padded, note)).rstrip())
    return '\n'.join(lines)
