"""Findings of a check, and the meaning of slopes that wrong units make."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from power_recordings.card import Card
from power_recordings.quality import causes
from power_recordings.quality.causes import Cause, cause_of
from power_recordings.quality.physics import DriveSlopes, ShaftBalance
from power_recordings.quality.streams import SampleLoss, Timing
from power_recordings.reading.reader import Recording

Severity = Literal['error', 'warning']


@dataclass(frozen=True)
class Finding:
    """A fault in a recording, of one drive ('' for the whole), described by `text`.

    code: for programs. `severity`: `error` makes the recording useless for a power model as it is,
    `warning` does not. mend: the line of an import map that would mend it, '' where none would.
    """

    code: str
    severity: Severity
    drive: str
    text: str
    mend: str = ''

    def __str__(self) -> str:
        who = f'{self.drive}: ' if self.drive else ''
        return f'{who}{self.text}' + (f'; in the map: {self.mend}' if self.mend else '')


OF_TIME: Final = ('clipped', 'frozen', 'jitter', 'gaps', 'lost', 'clock_step', 'slow_power')
"""Codes of findings on timing, which do not apply to operating points."""
_FED: Final = -0.1  # of the power (rms), losses below which no offset of a meter explains
_TORQUE: Final = 0.75  # of what a sensor or a torque constant says, at least
_USUAL: Final = (0.6, 1.6)  # of the slope of power, with friction of the gear in it or out of it
_DECIDED: Final = 0.3  # of the variance, from which the slope stands for itself
_HINTED: Final = 0.02  # the same, from which a slope of the wrong sign is told
_BEYOND: Final = 100.0  # W per W of torque × speed: another unit, or a drive that hardly turns,
_RUBBED: Final = 0.05  # in which the heat that friction adds changes the slope by more than this
_LARGE: Final = 3.0  # times the power, that torque × speed is of units that are likely wrong,
_SMALL: Final = 0.1  # if power grows by less W with each W of it
_LEAST_EXPLAINED: Final = 0.2  # of the power, by torque and speed
_AS_WELL: Final = 1.05  # times the variance, that a slope of 1 leaves: no worse than another
_GEARED: Final = 4.0  # gear ratio, from which a slope tells it from losses
_SHARP: Final = 0.25  # of a slope, that its margin may be to be one of a gear
_RPM: Final = 2 * np.pi / 60
# Slopes of power that are nearer to 1 than to rpm or turns per second: losses, or a torque scale.
_SCALES: Final = (np.sqrt(_RPM), np.sqrt(60 * _RPM))


def velocity_finding(drive: str, slope: float, card: Card) -> Finding:
    """Return the error, with a likely cause, that velocity is `slope` × rate of position."""
    text = f'velocity is {slope:.3g} times the rate of the position'
    cause = cause_of(abs(slope), causes.OF_VELOCITY, card, drive)
    mend = cause.mend
    if slope < 0:
        text += ': its sign is wrong' + (f', and {cause}' if cause else '')
        mend = card.scaled(drive, 'velocity', 1 / slope)
    elif cause:
        text += f': {cause}'
    else:
        text += ': a gear between the two? Then gear_ratio, and at: motor for what is at the motor'
    return Finding('velocity_units', 'error', drive, text, mend)


def power_finding(
    drive: str, balance: ShaftBalance | None, card: Card, agree: bool = False
) -> Finding | None:
    """Return the fault in units, sign or size of a drive's power, None if none is found.

    agree: speed is the rate of the position.
    """
    if balance is None:
        return None
    slope, margin = balance.slope, 2 * balance.error
    decided = balance.share > _DECIDED and balance.r2 > _LEAST_EXPLAINED
    meaning = cause_of(slope, causes.OF_POWER[card.metered(drive)], card, drive)
    meaning = meaning.with_position(card, drive) if agree else meaning
    mend = meaning.mend
    if mend and not drive and {'current', 'power'} & set(meaning.units):
        mend = f'supply: {{{mend}}}'
    usual = _USUAL[0] - margin < slope < _USUAL[1] + margin
    sprung = _USUAL[0] < balance.sprung < _USUAL[1] and balance.share > _HINTED
    if sprung and not usual and not balance.impossible:
        text = (
            f'power grows by {slope:.3g} W with each W of torque × speed, beside torque × its '
            f'rate by {balance.sprung:.3g} W: a series spring?'
        )
        return Finding('power_slope', 'warning', drive, text)
    if (geared := _gear_finding(drive, balance, card, agree, meaning)) is not None:
        return geared
    told = balance.share > 1 - balance.r2
    least, most = _USUAL[0] + margin, _USUAL[1] - margin
    # With a delay between torque and power, heat alone may make a slope below 0.
    mirrored = least < -slope < most and least < -balance.delayed < most
    turned = mirrored and (told or balance.losses < _FED * balance.power)
    if (decided and slope < -margin) or turned:
        text = f'power falls by {-slope:.3g} W with each W of torque × speed'
        whose, mend = 'a', card.scaled(drive, 'torque', -1)
        if balance.losses < _FED * balance.power:
            text += f', and the losses would be {balance.losses:.3g} W'
            whose, mend = "the meter's", card.turned_meter(drive)
        return Finding('power_units', 'error', drive, f'{text}: {whose} sign is wrong', mend)
    certain = decided and meaning
    if balance.impossible and not certain:
        shown = balance.share > _HINTED and bool(meaning)
        cause = str(meaning) if shown else _of_meter(drive, balance, card)
        text = f'torque × speed is {balance.shaft:.3g} W (rms) where {balance.power:.3g} W were'
        return Finding(
            'power_units', 'error', drive, f'{text} metered: {cause}?', mend if shown else ''
        )
    mirrored &= balance.rubbed < -_USUAL[0]
    if mirrored or (slope < -2 * margin and balance.share > _HINTED):
        text = f'power falls with torque × speed, {balance}: is a sign wrong?'
        return Finding('power_slope', 'warning', drive, text)
    large = balance.shaft > _LARGE * balance.power and abs(slope) + margin < _SMALL
    if large and not (balance.impossible and certain):
        text = (
            f'torque × speed is {balance.shaft:.3g} W (rms) where {balance.power:.3g} W were '
            f'metered, which grow by {slope:.2g} W with each W of it: another unit of torque or '
            'speed (N·cm, mN·m?), or a spring that works beside the motor?'
        )
        mend = '' if meaning.others else cause_of(slope, causes.OF_TORQUE, card, drive).mend
        return Finding('power_slope', 'warning', drive, text, mend)
    beyond = slope > _BEYOND and abs(balance.rubbed / slope - 1) < _RUBBED
    decided |= bool(meaning) and told and balance.share > _HINTED and beyond
    hinted = (told or slope > _BEYOND) and balance.share > _HINTED and slope > _SCALES[1] + margin
    if not (decided or hinted) or usual:
        return _gain_finding(drive, balance, usual)
    text = f'power grows by {slope:.3g} W with each W of torque × speed'
    rubs = slope > _SCALES[1] and _USUAL[0] < balance.rubbed < _USUAL[1]
    if decided and meaning and not rubs:
        return Finding('power_units', 'error', drive, f'{text}: {meaning}?', mend)
    of_all = f'{text}, which stands for {balance.share:.0%} of its variance'
    if rubs or balance.worn < _AS_WELL or _SCALES[0] < slope < _SCALES[1]:
        text = f'{of_all}: losses that grow with load and speed, or a torque that is scaled'
        return Finding('power_slope', 'warning', drive, text)
    if not decided:
        text = f"{of_all}, not by about 1: another unit, or torque of the motor's shaft?"
        mend = '' if card.gear_ratio else 'torque: {scale: GEAR RATIO}'
        return Finding('power_slope', 'warning', drive, text, mend)
    text += ', not by about 1: a gear between, or two units at once? Check those of torque, speed'
    return Finding('power_units', 'error', drive, f'{text}, voltage and current.')


def _of_meter(drive: str, balance: ShaftBalance, card: Card) -> str:
    """Return what may be wrong where power does not follow torque × speed: its size alone."""
    ratio = balance.power / balance.shaft
    cause = cause_of(ratio, causes.OF_METER[card.metered(drive)], card, drive)
    return (f'{cause}, or ' if cause else '') + 'units of torque and speed'


def _gain_finding(drive: str, balance: ShaftBalance, usual: bool) -> Finding | None:
    """Return a warning where a shaft gives more than its drive draws, in the mean."""
    least = balance.made * (_TORQUE if balance.made > 0.0 else 1 / _TORQUE)
    if balance.drawn >= least + _FED * balance.power:
        return None
    known = usual and balance.error < _SHARP * balance.slope
    wrong = 'are the signs of both torque and power' if known else 'is a sign, a gear or a unit'
    text = f'{balance.drawn:.3g} W are drawn in the mean and the shaft gives {balance.made:.3g} W'
    return Finding('power_slope', 'warning', drive, f'{text}: {wrong} wrong?')


def drive_findings(names: Sequence[str], found: DriveSlopes, card: Card) -> list[Finding]:
    """Return the drives on a common meter whose own slope shows a sign or unit to be wrong."""
    result: list[Finding] = []
    if not found.losses > 0:
        return result
    for drive, slope in zip(names, found.slopes, strict=True):
        cause = cause_of(slope, causes.OF_TORQUE, card, drive)
        meaning, mend = str(cause), cause.mend
        if slope < -_SCALES[0]:
            meaning, mend = 'a sign is wrong', card.scaled(drive, 'torque', -1)
        if meaning:
            goes = 'falls' if slope < 0 else 'grows'
            text = (
                f"the robot's power {goes} by {abs(slope):.3g} W with each W of its torque × speed"
            )
            result.append(Finding('power_units', 'error', drive, f'{text}: {meaning}', mend))
    return result


def _gear_finding(
    drive: str, balance: ShaftBalance, card: Card, agree: bool, meaning: Cause
) -> Finding | None:
    """Return what is amiss where power grows by the gear ratio with torque × speed."""
    slope = balance.slope
    ratios = {ratio for name, ratio in card.gear_ratio.items() if drive in ('', name)}
    ratio = ratios.pop() if len(ratios) == 1 else 1.0
    size = max(ratio, 1 / ratio)
    if not (size > _GEARED and balance.share > _HINTED and 2 * balance.error < _SHARP * slope):
        return None
    text = f'power grows by {slope:.3g} W with each W of torque × speed, near '
    other = f', or {meaning}' if meaning else ''
    if _USUAL[0] < slope / ratio < _USUAL[1]:
        text += (
            f"gear_ratio {ratio:g}: torque of the motor's shaft, which is not multiplied by it"
            f'{other}, or position and speed of the joint, said to be at: motor? Multiply the '
            'torque, beside its unit'
        )
        return Finding('power_units', 'error', drive, text, card.scaled(drive, 'torque', ratio))
    # Units that make the slope come before a gear ratio that only losses bring near it.
    near = not meaning or abs(np.log(slope * ratio)) < np.log(1 + causes.TOLERANCE)
    if (agree or not meaning) and near and _USUAL[0] < slope * ratio < _USUAL[1]:
        cause, mend = 'torque of the joint and speed of the motor?', 'velocity: {at: motor}'
        if agree:
            cause = 'torque multiplied by it? Or position and speed, which agree, both at: motor?'
            cause += f' Or {meaning}?' if meaning else ''
            mend = '' if meaning else card.scaled(drive, 'torque', 1 / ratio)
        text += f'1 / gear_ratio {ratio:g}: {cause}'
        return Finding('power_units', 'error', drive, text, mend)
    return None


def computed_findings(card: Card) -> list[Finding]:
    """Return a warning for each drive whose power was computed by firmware, not metered."""
    found = []
    for drive in (drive for drive, kind in card.power.items() if kind == 'computed'):
        formula = f', {card.formula(drive)}' if card.formula(drive) else ''
        text = f'power computed by the firmware{formula}: its losses are not in it'
        found.append(Finding('computed_power', 'warning', drive, text))
    return found


def computed_torque(drive: str, factor: float, whose: str) -> Finding:
    """Return the warning that a torque is `factor` N·m for each A of a current."""
    text = (
        f'torque is {factor:.4g} N·m for each A of the {whose} current throughout: computed from '
        'it, and no measurement beside it, so that torque and copper loss share one sensor'
    )
    mend = 'torque: {at: motor}' if whose == "motor's" else ''
    text += '' if mend else "; is this current the motor's, and no meter's?"
    return Finding('computed_torque', 'warning', drive, text, mend)


def constant_voltage(drive: str, voltage: NDArray[np.floating]) -> Finding | None:
    """Return a warning if a drive's voltage [N] never changes, else None."""
    known = voltage[np.isfinite(voltage)]
    if not len(known) or known.min() < known.max():
        return None
    text = f'its voltage is {known[0]:.4g} V throughout: its power is a constant times its current'
    text += ', how the supply sags is not in it'
    return Finding('constant_voltage', 'warning', drive, text)


_GAPS: Final = 0.05  # share of the recording
_COVERED: Final = 0.9  # share of the recording, with the gaps
_JITTER: Final = 0.5  # of a period
_MEETING: Final = 0.5  # share of the shorter topic
_RECORD_WITH: Final = (
    'record with power_daq record, or ros2 bag record by docs/rosbag2_qos.yaml and zstd_fast'
)


def timing_findings(
    recording: Recording, topics: Mapping[str, Timing], losses: Mapping[str, SampleLoss]
) -> list[Finding]:
    """Return findings on gaps, jitter, clock steps and lost samples of topics, by their names."""
    found = []
    gappy = [n for n, t in topics.items() if t.gap_seconds > _GAPS * recording.duration]
    if gappy:
        longest = max(topics[name].gap_seconds for name in gappy)
        text = f'{longest:.3g} s of {recording.duration:.3g} s are gaps ({", ".join(gappy)})'
        found.append(Finding('gaps', 'warning', '', text))
    for name in ('joint_states', 'drive_supply'):
        if (timing := topics.get(name)) is None or not timing.rate > 0:
            continue
        stamps = getattr(recording, name)().stamp_ns
        covered = float(stamps[-1] - stamps[0]) / 1e9
        if covered < _COVERED * recording.duration:
            text = f'{name} covers {covered:.3g} s of {recording.duration:.3g} s: begun late?'
            found.append(Finding('coverage', 'warning', '', text))
    for name, timing in topics.items():
        steps = len(recording.breaks(name))
        if steps:
            places = 'once' if steps == 1 else f'{steps} times'
            text = f'{name}: the clock was set back {places}; what it repeats was cut out'
            found.append(Finding('clock_step', 'warning', '', text))
        if timing.jitter > _JITTER:
            text = (
                f'{name}: stamps jitter by ±{timing.jitter:.0%} of a period: times of arrival, or '
                'of a coarse clock?'
            )
            found.append(Finding('jitter', 'warning', '', text))
    power = 'drive_supply' if recording.has('drive_supply') else 'supply'
    if recording.has('joint_states') and recording.has(power):
        found += _apart(recording, power)
    for name, loss in losses.items():
        if loss.samples:
            many = f'{loss.samples} of {topics[name].samples + loss.samples} samples'
            text = f'{name}: {many} are missing in {loss.gaps} gaps of sequence; {_RECORD_WITH}'
            found.append(Finding('lost', 'warning', '', text))
    return found


def _apart(recording: Recording, power: str) -> list[Finding]:
    joints, electric = (getattr(recording, n)().stamp_ns for n in ('joint_states', power))
    shorter = min(int(s[-1] - s[0]) for s in (joints, electric))
    both = int(min(joints[-1], electric[-1])) - int(max(joints[0], electric[0]))
    if shorter <= 0 or both > _MEETING * shorter:
        return []
    text = (
        f'joint_states and {power} share {max(both, 0) / 1e9:.3g} s of {shorter / 1e9:.3g} s: '
        'stamps of two clocks?'
    )
    return [Finding('two_clocks', 'error', '', text, 'time: {stamp: log}')]
