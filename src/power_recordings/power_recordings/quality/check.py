"""Quality of a recording: a table by drive, and findings with the line of the map to mend."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np
from wattwalk_core.arrays import Floats, Singles, Stamps

from power_recordings.alignment.positions import stands_still
from power_recordings.messages.samples import UNKNOWN_VOLTAGE, SupplySamples
from power_recordings.quality import findings, physics, streams
from power_recordings.quality.findings import Finding, Severity
from power_recordings.quality.streams import LEAST_UPDATES, SampleLoss, Timing
from power_recordings.reading.reader import Recording

_FEWEST = 20  # samples
_CLIPPED = 0.01
_FROZEN = 1.0  # s
_MOST = {'voltage': 1000.0, 'current': 1000.0}
_SLOPE = (0.8, 1.25)
_LEAST_CORRELATION = 0.7
_STILL = 0.2  # rad from where a drive stands
_PLAIN_CORRELATION = 0.97
_GENERATES = 0.5  # of the power that flows out, by the joints: then nothing is wrong with its sign
_VARIES = 0.2  # of the mean speed: at one speed the supply's current goes with the torque
_TURNS = 0.05  # rad/s, above the noise of a speed at rest
_LEAST_DRAWN = 0.1  # of the power, by the torque


@dataclass(frozen=True)
class DriveQuality:
    """Figures of one drive; NaN for what was not recorded.

    updates_hz: changes of power per second. power_slope: W per W of torque × speed.
    velocity_slope: of velocity on the rate of the position. quadrants: share visited.
    """

    updates_hz: float
    power_slope: float
    power_share: float  # of the variance of power, what only torque × speed explains
    velocity_slope: float
    torque_range: tuple[float, float]  # N·m, 1st and 99th percentile
    velocity_range: tuple[float, float]  # rad/s
    power_range: tuple[float, float]  # W
    cells: float  # share of torque–speed space
    quadrants: float


@dataclass(frozen=True)
class SupplyQuality:
    """Figures of the robot's supply, and its power's line over the sum of its drives' powers.

    updates_hz, ranges (1st and 99th percentile, W, V and A): by `power`, `voltage` and `current`,
    drawn. slope, offset, r2: of the line, NaN without meters of all drives.
    """

    updates_hz: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    slope: float
    offset: float  # W
    r2: float


@dataclass(frozen=True)
class Quality:
    """Timing by topic, figures by drive, and findings; seconds: length of the recording."""

    seconds: float
    topics: Mapping[str, Timing]
    drives: Mapping[str, DriveQuality]
    torque_at: Mapping[str, str]
    findings: tuple[Finding, ...]
    supply: SupplyQuality | None = None
    robot: physics.ShaftBalance | None = None  # where it alone was metered
    lost: Mapping[str, SampleLoss] = field(default_factory=dict)  # of topics with a sequence


@np.errstate(all='ignore')
def check_recording(recording: Recording) -> Quality:
    """Check a recording; InputError where a topic is there but cannot be read."""
    recording = recording.whole()
    topics, lost = {}, {}
    for name in ('joint_states', 'joint_commands', 'drive_supply', 'supply'):
        if recording.has(name):
            topics[name] = streams.timing(getattr(recording, name)().stamp_ns)
    if 'drive_supply' in topics:
        electric = recording.drive_supply()
        gaps = int((np.diff(electric.sequence.astype(np.int64)) > 1).sum())
        lost['drive_supply'] = SampleLoss(electric.lost, gaps)
    checker = _Checker(recording)
    drives = {name: checker.drive(name) for name in checker.names}
    supply, robot = checker.supply(), checker.robot(drives)
    card = recording.card
    told = (
        *findings.timing_findings(recording, topics, lost),
        *checker.findings,
        *findings.computed_findings(card),
    )
    found = tuple(f for f in told if not card.steady or f.code not in findings.OF_TIME)
    torque_at = dict(card.torque)
    return Quality(recording.duration, topics, drives, torque_at, found, supply, robot, lost)


class _Checker:
    def __init__(self, recording: Recording) -> None:
        self._recording, self._card = recording, recording.card
        self.findings: list[Finding] = []
        self._joints = recording.joint_states() if recording.has('joint_states') else None
        self._electric = recording.drive_supply() if recording.has('drive_supply') else None
        supply = recording.supply() if recording.has('supply') else None
        self._supply = supply if supply is not None and len(supply) >= _FEWEST else None
        if self._joints is None:
            self._find('no_joints', 'error', '', 'no joint_states: nothing says how drives moved')
        if self._electric is None and supply is None:
            self._find('no_power', 'error', '', 'neither drive_supply nor supply: no power')
        named = [part.names for part in (self._joints, self._electric) if part is not None]
        self.names = tuple(dict.fromkeys(chain(*named)))

    def _find(self, code: str, severity: Severity, drive: str, text: str, mend: str = '') -> None:
        self.findings.append(Finding(code, severity, drive, text, mend))

    def drive(self, name: str) -> DriveQuality:
        """Return the figures of a drive, adding what is amiss to the findings."""
        time, position, velocity, torque = self._motion(name)
        rate, power = self._electrics(name, time, velocity)
        slope = self._velocity(name, time, position, velocity)
        balance = None
        if len(time) and rate >= LEAST_UPDATES:
            agree = slope == slope or name in self._card.derived_velocity
            balance = self._power(name, power, (time, torque, velocity), agree)
        self._torque_of_current(name, torque, velocity)
        cells, quadrants = physics.coverage(torque, velocity)
        if np.isfinite(torque).any() and np.isfinite(velocity).any() and cells < 0.15:
            text = f'visits {cells:.0%} of its torque–speed range only'
            self._find('coverage', 'warning', name, text)
        return DriveQuality(
            updates_hz=rate,
            power_slope=np.nan if balance is None else balance.slope,
            power_share=np.nan if balance is None else balance.share,
            velocity_slope=slope,
            torque_range=_range(torque),
            velocity_range=_range(velocity),
            power_range=_range(power),
            cells=cells,
            quadrants=quadrants,
        )

    def _torque_of_current(self, name: str, torque: Floats, velocity: Floats) -> None:
        """Find a torque that was computed from a current, though the map has it as another's."""
        joints, electric, card = self._joints, self._electric, self._card
        if joints is None or not len(torque) or card.torque_unit.get(name) == 'A':
            return
        known = dict[str, tuple[Stamps, Singles]]()
        if self._recording.has('motor_current') and card.torque.get(name) == 'joint':
            motor = self._recording.motor_current()
            if name in motor.names:
                known["motor's"] = motor.stamp_ns, motor.current[:, motor.names.index(name)]
        speed = np.abs(velocity[np.isfinite(velocity)])
        varies = len(speed) and speed.std() > max(_VARIES * speed.mean(), _TURNS)
        apart = card.column(name, 'current') != card.column(name, 'torque')
        if electric is not None and name in electric.names and varies and apart:
            amps = electric.current[:, electric.names.index(name)]
            known["supply's"] = electric.stamp_ns, amps
        for whose, (stamps, amps) in known.items():
            factor = physics.factor_of(torque, streams.values_at(stamps, amps, joints.stamp_ns))
            if factor is not None:
                self.findings.append(findings.computed_torque(name, factor, whose))

    def _motion(self, name: str) -> tuple[Floats, ...]:
        joints = self._joints
        if joints is None or name not in joints.names or len(joints) < _FEWEST:
            return (np.zeros(0),) * 4
        column = joints.names.index(name)
        time = (joints.stamp_ns - joints.stamp_ns[0]) / 1e9
        position, velocity, torque = (
            getattr(joints, f)[:, column].astype(float) for f in ('position', 'velocity', 'effort')
        )
        for quantity, values in (('velocity', velocity), ('torque', torque)):
            share = streams.clipped(values.astype(np.float32))
            if share > _CLIPPED:
                text = f'{quantity} stands at an extreme value in {share:.0%} of samples: clipped?'
                self._find('clipped', 'warning', name, text)
        speed = np.nan_to_num(np.abs(velocity))
        moving = speed > max(0.2 * float(np.percentile(speed, 95)), 1e-6)
        for quantity, values in (('position', position), ('torque', torque)):
            stuck = streams.frozen(joints.stamp_ns, values.astype(np.float32), moving)
            if stuck > _FROZEN and np.nanmax(values) > np.nanmin(values):
                text = f'{quantity} is constant for {stuck:.1f} s in motion'
                self._find('frozen', 'warning', name, text)
        return time, position, velocity, torque

    def _electrics(self, name: str, time: Floats, velocity: Floats) -> tuple[float, Floats]:
        """Rate of updates, and power at the times of the joint states."""
        electric = self._electric
        if electric is None or name not in electric.names or len(electric) < _FEWEST:
            return np.nan, np.full(len(time), np.nan)
        column = electric.names.index(name)
        power = electric.power[:, column]
        metered = self._card.metered(name) or 'power'
        for quantity, most in _MOST.items():
            values = getattr(electric, quantity)[:, column]
            largest = float(np.nanmax(np.abs(values), initial=0.0))
            if largest > most:
                if (quantity, metered) == ('current', 'power'):
                    quantity, largest = metered, float(np.nanmax(np.abs(power)))
                unit = {'voltage': 'V', 'current': 'A', 'power': 'W'}[quantity]
                given = self._card.unit_of(name, quantity) == f'm{unit}'
                text = f'{quantity} reaches {largest:.4g} {unit}: ' + ('µ' if given else 'm')
                mend = '' if given else f'{quantity}: {{unit: m{unit}}}'
                self._find('units', 'error', name, f'{text}{unit}?', mend)
        volts = findings.constant_voltage(name, electric.voltage[:, column])
        if volts is not None and not self._card.lacks(name, 'current'):
            self.findings.append(volts)
        rate = float(streams.updates(electric.stamp_ns, power[:, None])[0])
        self._slow(rate, name, 'its', ' of a joint')
        share = streams.clipped(electric.current[:, column])
        if share > _CLIPPED:
            self._find(
                'clipped', 'warning', name, f'{metered} is clipped in {share:.0%} of samples'
            )
        if len(velocity) and self._joints is not None:
            stamps = electric.stamp_ns - self._joints.stamp_ns[0]
            speed = np.interp(stamps / 1e9, time, np.nan_to_num(np.abs(velocity)))
            moving = speed > 0.2 * np.percentile(speed, 95)
            stuck = streams.frozen(electric.stamp_ns, power, moving & (speed > 0))
            if stuck > _FROZEN and rate >= LEAST_UPDATES:
                text = f'its power is constant for {stuck:.1f} s in motion'
                self._find('frozen', 'warning', name, text)
            return rate, streams.values_at(electric.stamp_ns, power, self._joints.stamp_ns)
        return rate, np.full(len(time), np.nan)

    def _slow(self, rate: float, drive: str, whose: str, of: str) -> None:
        """Add an error of `drive` if the rate of its power's updates is too low."""
        if rate < LEAST_UPDATES:
            text = (
                f'{whose} power changes {rate:.3g} times a second; a model{of} needs '
                f'{LEAST_UPDATES:.0f} (with --slow-meter, energy over windows is judged)'
            )
            self._find('slow_power', 'error', drive, text)

    def _velocity(self, name: str, time: Floats, position: Floats, velocity: Floats) -> float:
        if not len(time) or self._card.steady or name in self._card.derived_velocity:
            return np.nan  # between operating points no position moves
        if stands_still(position) and np.nanmax(np.abs(position), initial=0.0) > 0.0:
            within = np.abs(position - np.nanmedian(position)) < _STILL
            position = np.where(within, position, np.nan)  # but for how it came there
        found = physics.velocity_slope(time, position, velocity)
        least = _PLAIN_CORRELATION if stands_still(position) else _LEAST_CORRELATION
        if found is None or abs(found.correlation) < least:
            return np.nan
        if not _SLOPE[0] < found.slope < _SLOPE[1]:
            self.findings.append(findings.velocity_finding(name, found.slope, self._card))
        return found.slope

    def _power(
        self, name: str, power: Floats, motion: Sequence[Floats], agree: bool
    ) -> physics.ShaftBalance | None:
        time, torque, velocity = motion
        share = physics.explained(power, torque, velocity)
        if share is not None and share < _LEAST_DRAWN:
            text = (
                f'torque × speed and torque² explain {max(share, 0.0):.0%} of its power: this is '
                'not the torque that draws it (the effort of a spring at the output, say), or '
                "the drive bears no load; take the motor's or the winding's current, if the log "
                'has it'
            )
            mend = 'torque: {from: …, unit: A, at: motor}'
            self._find('torque_unrelated', 'warning', name, text, mend)
        balance = physics.power_balance(power, torque, velocity, physics.rate_of(time, torque))
        if self._card.torque_unit.get(name) != 'A':
            self._add([findings.power_finding(name, balance, self._card, agree)])
        return balance

    def _add(self, found: Sequence[Finding | None]) -> None:
        """Add findings on power of drives, and of all ('') drives, whose velocity is right."""
        bad = {f.drive for f in self.findings if f.code == 'velocity_units'}
        self.findings += [f for f in found if f and f.drive not in bad and (f.drive or not bad)]

    def supply(self) -> SupplyQuality | None:
        """Check the supply of the whole robot, and set it against the drives."""
        if (supply := self._supply) is None:
            return None
        mean, worked = float(np.nanmean(supply.power)), 0.0
        if (joints := self._joints) is not None:
            worked = float(np.nansum(np.nanmean(joints.effort * joints.velocity, axis=0)))
        if mean < 0 and worked > _GENERATES * mean:
            text = f'the robot gives {-mean:.3g} W to its supply in the mean: sign of its current'
            self._find('supply_sign', 'error', '', text, self._card.turned_meter(''))
        signals = {'power': supply.power, 'voltage': supply.voltage, 'current': -supply.current}
        if (supply.voltage == UNKNOWN_VOLTAGE).all():
            signals = {'power': supply.power}
        found = streams.updates(supply.stamp_ns, np.stack([*signals.values()], axis=1)).tolist()
        rates = dict(zip(signals, found, strict=True))
        if self._electric is None:
            self._slow(rates['power'], '', "the robot's", '')
        ranges = {name: _range(values) for name, values in signals.items()}
        return SupplyQuality(rates, ranges, *self._line(supply))

    def robot(self, drives: dict[str, DriveQuality]) -> physics.ShaftBalance | None:
        """Set the power of a robot whose drives have no meter against their motion.

        Puts the slopes of `drives` that are sure into their figures.
        """
        joints, supply = self._joints, self._supply
        if self._electric is not None or joints is None or supply is None:
            return None
        if len(joints) < _FEWEST or 'A' in self._card.torque_unit.values():
            return None
        power = streams.values_at(supply.stamp_ns, supply.power, joints.stamp_ns)
        motion = (joints.effort.astype(float), joints.velocity.astype(float))
        rate = physics.rate_of((joints.stamp_ns - joints.stamp_ns[0]) / 1e9, motion[0])
        balance = physics.power_balance(power, *motion, rate)
        known = {f.code for f in self.findings if not f.drive}
        if apart := None if 'slow_power' in known else physics.drive_slopes(power, *motion):
            for name, slope, share in zip(joints.names, apart.figures, apart.shares, strict=True):
                drives[name] = replace(drives[name], power_slope=slope, power_share=share)
        if 'supply_sign' not in known:
            agree = all(drive.velocity_slope == drive.velocity_slope for drive in drives.values())
            own = findings.drive_findings(joints.names, apart, self._card) if apart else []
            self._add(own or [findings.power_finding('', balance, self._card, agree)])
        return balance

    def _line(self, supply: SupplySamples) -> tuple[float, float, float]:
        if self._electric is None or len(self._electric.names) < len(self.names):
            return (np.nan,) * 3
        drawn = streams.values_at(
            self._electric.stamp_ns, self._electric.power.sum(axis=1), supply.stamp_ns
        )
        good = np.isfinite(drawn) & np.isfinite(supply.power)
        if good.sum() < _FEWEST or np.var(drawn[good]) == 0 or np.var(supply.power[good]) == 0:
            return (np.nan,) * 3
        slope, offset = np.polyfit(drawn[good], supply.power[good].astype(np.float64), 1)
        r2 = np.corrcoef(drawn[good], supply.power[good])[0, 1] ** 2
        return float(slope), float(offset), float(r2)


def _range(values: Floats | Singles) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return (np.nan, np.nan)
    low, high = np.percentile(finite, [1, 99])
    return float(low), float(high)
