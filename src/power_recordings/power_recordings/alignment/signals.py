"""Signals of one recording, checked and cut at their gaps."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_recordings.alignment.positions import is_rate, stands_still, unwrapped
from power_recordings.alignment.stream import Stream, held
from power_recordings.messages.samples import DriveSamples, FootForceSamples, Samples
from power_recordings.reading.ordering import longest_step
from power_recordings.reading.reader import Recording

_FEET = ('LF_FOOT', 'RF_FOOT', 'LH_FOOT', 'RH_FOOT')
_QUANTITIES = {'position': 'position', 'velocity': 'velocity', 'effort': 'torque'}
_MOSTLY = 0.5
_OFTEN = 0.2
_MOST_RADIANS = 4 * np.pi
_MOST_ELECTRIC = 1000.0  # V and A


class RecordedSignals:
    """The checked signals of D drives of a recording, of which M were measured.

    Streams hold their signals side by side: joints position | velocity | torque [N, 3 D],
    electrics power | voltage | current | temperature [N, 4 M]. Times are s after `start_ns`.
    commands and cmd_vel are times [N] and values [N, K]; `others` are streams by topic, and
    `facts` sets of drives, of the card. Arguments and errors are as in `align`.
    """

    def __init__(
        self, recording: Recording, drives: Sequence[str] | None, need_power: bool
    ) -> None:
        self._recording, self._card = recording, recording.card
        self.path = recording.path
        self.notes = list(recording.problems)
        self._joints = recording.joint_states()
        self._check_count('joint_states', self._joints)
        self.names = self._chosen(drives)
        self.start_ns = int(self._joints.stamp_ns[0])
        self.measured: tuple[str, ...] = ()
        self.electrics: Stream | None = None
        if need_power or recording.has('drive_supply'):
            self.electrics, self.measured = self._electrics(recording.drive_supply())
        self.joints = self._joint_stream()
        self._must_overlap()
        self.commands = self._commands()
        self.cmd_vel: tuple[Floats, Singles] | None = None
        if recording.has('cmd_vel'):
            samples = recording.cmd_vel()
            self.cmd_vel = self._seconds(samples), samples.velocity
        self.others = self._others()
        self.facts: dict[str, Any] = {
            fact: frozenset(name for name in self.names if of.get(name) == value)
            for fact, of, value in (
                ('motor_torque', self._card.torque, 'motor'),
                ('current_as_torque', self._card.torque_unit, 'A'),
                ('computed_power', self._card.power, 'computed'),
            )
        }
        del self._recording, self._joints  # their samples need as much memory as the streams

    def sample(
        self, grid: Floats, values: Callable[[Stream, Floats], Singles] = Stream.sample
    ) -> dict[str, Singles]:
        """Return signals at the times of a grid [T], by name: [T, D], or [T, K] of other topics.

        values: the method that samples a stream. Commands are held (zero-order).
        """
        count, there = len(self.names), len(self.measured)
        joints = values(self.joints, grid).reshape(len(grid), 3, count)
        result = {name: joints[:, i] for i, name in enumerate(('position', 'velocity', 'torque'))}
        electric = np.full((len(grid), 4, count), np.nan, np.float32)
        if self.electrics is not None:
            columns = [self.names.index(name) for name in self.measured]
            electric[:, :, columns] = values(self.electrics, grid).reshape(len(grid), 4, there)
        for i, name in enumerate(('power', 'voltage', 'current', 'temperature')):
            result[name] = electric[:, i]
        nothing = np.full((len(grid), count), np.nan, np.float32)
        result['command'] = nothing if self.commands is None else held(*self.commands, grid)
        result['supply'] = np.full((len(grid), 1), np.nan, np.float32)
        others = {name: values(stream, grid) for name, stream in self.others.items()}
        for name in result.keys() & others.keys():  # of drives that have no meter
            own = result[name]
            others[name] = np.where(np.isnan(own), others[name], own)
        return {**result, **others}

    def _check_count(self, topic: str, samples: Samples) -> None:
        if len(samples) < 4:
            because = ''.join(f'; {p}' for p in self._recording.problems if topic in p)
            raise InputError(
                f'{self.path}: {topic} has only {len(samples)} samples of use{because}'
            )

    def _chosen(self, drives: Sequence[str] | None) -> tuple[str, ...]:
        there = self._joints.names
        chosen = tuple(drives) if drives is not None else there
        if missing := [name for name in chosen if name not in there]:
            raise InputError(
                f'{self.path}: no joint {missing[0]!r} in joint_states; it has {", ".join(there)}'
            )
        if not chosen or len(set(chosen)) != len(chosen):
            raise InputError(f'drives are {", ".join(chosen)!r}; name each drive once')
        if drives is None and self._recording.has('drive_supply'):
            supply = self._recording.drive_supply().names
            if unknown := [name for name in supply if name not in there]:
                raise InputError(
                    f'{self.path}: drive_supply measures {", ".join(unknown)}, which '
                    f'joint_states does not have ({", ".join(there)}): name the drives to take'
                )
        return chosen

    def _seconds(self, samples: Samples) -> Floats:
        return (samples.stamp_ns - self.start_ns) / 1e9

    def _joint_stream(self) -> Stream:
        joints, path = self._joints, self.path
        columns = [joints.names.index(name) for name in self.names]
        position, velocity, torque = (getattr(joints, name)[:, columns] for name in _QUANTITIES)
        all_values = (position, velocity, torque)
        bad = np.zeros(len(joints), np.bool_)
        for (name, quantity), values in zip(_QUANTITIES.items(), all_values, strict=True):
            nan = ~np.isfinite(values)
            unknown = nan.all(axis=0) if name == 'position' else np.zeros(len(columns), np.bool_)
            for drive, share in zip(self.names, nan.mean(axis=0) * ~unknown, strict=True):
                if share == 1.0 and self._card.lacks(drive, quantity):
                    raise InputError(
                        f'{path}: the map that it was imported by gives no {quantity} of {drive}'
                    )
                if share > _MOSTLY:
                    raise InputError(
                        f'{path}: joint_states.{name} of {drive}'
                        f'{self._card.column(drive, quantity)} is NaN or missing in '
                        f'{share:.0%} of the messages; expected numbers'
                    )
            bad |= (nan & ~unknown).any(axis=1)
        seconds = self._seconds(joints)
        turns = [unwrapped(seconds, *both) for both in zip(position.T, velocity.T, strict=True)]
        for drive, angle, speed in zip(self.names, turns, velocity.T, strict=True):
            often = (np.abs(angle) > _MOST_RADIANS).mean() > _OFTEN
            if often and not stands_still(angle) and not is_rate(seconds, angle, speed):
                raise InputError(
                    f'{path}: joint_states.position of {drive}'
                    f'{self._card.column(drive, "position")} reaches '
                    f'{np.nanmax(np.abs(angle)):.4g}, mostly beyond 4π: '
                    'degrees? expected rad (a drive that turns on is taken where its velocity is '
                    'the rate of its position)'
                )
        self._note(bad, 'joint_states: {} samples with NaN cut out')
        apart = np.isin(joints.stamp_ns, self._recording.breaks('joint_states'))
        values = np.concatenate([np.stack(turns, axis=1), velocity, torque], axis=1)
        stream = Stream.of(seconds, values, bad, apart)
        self._note_gaps('joint_states', stream)
        return stream

    def _electrics(self, supply: DriveSamples) -> tuple[Stream | None, tuple[str, ...]]:
        self._check_count('drive_supply', supply)
        wanted = [name for name in self.names if name in supply.names]
        columns = [supply.names.index(name) for name in wanted]
        voltage, current = supply.voltage[:, columns], supply.current[:, columns]
        for name, values, unit in (('voltage', voltage, 'V'), ('current', current, 'A')):
            for drive, column in zip(wanted, values.T, strict=True):
                if (np.abs(column) > _MOST_ELECTRIC).mean() > _OFTEN:
                    raise InputError(
                        f'{self.path}: drive_supply.{name} of {drive}'
                        f'{self._card.column(drive, name)} reaches '
                        f'{np.nanmax(np.abs(column)):.4g}: m{unit}? expected {unit}'
                    )
        flagged, bad = supply.status[:, columns] != 0, ~supply.good[:, columns]
        share = bad.mean(axis=0)
        keep = np.flatnonzero(share <= _MOSTLY).tolist()
        for i in np.flatnonzero(share > _MOSTLY).tolist():
            self.notes.append(
                f'drive_supply: {share[i]:.0%} of the samples of {wanted[i]} are bad; '
                'it counts as not measured'
            )
        if not keep:
            if wanted:
                raise InputError(
                    f'{self.path}: drive_supply has a bad status or NaN in most samples of all '
                    f'drives ({", ".join(wanted)})'
                )
            return None, ()
        self._note(flagged[:, keep].any(axis=1), 'drive_supply: {} samples of bad status cut out')
        nan = bad & ~flagged
        self._note(nan[:, keep].any(axis=1), 'drive_supply: {} samples with NaN cut out')
        lost = supply.after_gap
        if lost.any():
            self.notes.append(
                f'drive_supply: {supply.lost} samples missing in {lost.sum()} places'
            )
        apart = lost | np.isin(supply.stamp_ns, self._recording.breaks('drive_supply'))
        read = np.isfinite(voltage * current)
        apart |= (flagged & read)[:, keep].any(axis=1)  # wrong, as the meter itself says
        volts, amps = voltage[:, keep], current[:, keep]
        celsius = supply.temperature[:, columns][:, keep]
        signals = np.concatenate([volts * amps, volts, amps, celsius], axis=1)
        marked = np.asarray(bad[:, keep].any(axis=1), np.bool_)
        stream = Stream.of(self._seconds(supply), signals, marked, apart)
        self._note_gaps('drive_supply', stream)
        return stream, tuple(wanted[i] for i in keep)

    def _note(self, which: Bools, text: str) -> None:
        if which.any():
            self.notes.append(text.format(int(which.sum())))

    def _note_gaps(self, topic: str, stream: Stream) -> None:
        steps = np.diff(stream.time)
        gaps = steps[steps > longest_step(steps)]
        if len(gaps):
            self.notes.append(
                f'{topic}: {len(gaps)} gaps, {gaps.sum():.3f} s in all, the longest '
                f'{gaps.max():.3f} s'
            )

    def _must_overlap(self) -> None:
        joints, electrics = self.joints, self.electrics
        for topic, stream in (('joint_states', joints), ('drive_supply', electrics)):
            if stream is not None and not len(stream.time):
                raise InputError(
                    f'{self.path}: {topic} has no sample that is good of all drives '
                    f'({", ".join(self.names)}); take one of them with --drives'
                )
        if electrics is None:
            return
        if electrics.time[0] >= joints.time[-1] or joints.time[0] >= electrics.time[-1]:
            raise InputError(
                f'{self.path}: the stamps of joint_states and drive_supply do not overlap '
                f'(drive_supply starts {electrics.time[0]:.3f} s after joint_states): '
                'do both carry measurement times of one clock?'
            )

    def _commands(self) -> tuple[Floats, Singles] | None:
        if not self._recording.has('joint_commands'):
            return None
        commands = self._recording.joint_commands()
        values = self._by_drive(commands.names, commands.position)
        some = np.isfinite(values).any(axis=1)
        return (self._seconds(commands)[some], values[some]) if some.any() else None

    def _others(self) -> dict[str, Stream]:
        r = self._recording
        wanted: dict[str, tuple[str, Callable[[Any], Singles]]] = {
            'supply': ('supply', lambda samples: samples.power[:, None]),
            'motor_current': ('motor_current', lambda s: self._by_drive(s.names, s.current)),
            'temperature': (
                'motor_temperature',
                lambda s: self._by_drive(s.names, s.temperature),
            ),
            'foot_force': ('foot_force', _force_by_foot),
            'orientation': ('imu', lambda samples: _continuous(samples.orientation)),
            'angular_velocity': ('imu', attrgetter('angular_velocity')),
            'linear_acceleration': ('imu', attrgetter('linear_acceleration')),
            'base_velocity': ('odom', attrgetter('linear_velocity')),
            'base_position': ('odom', attrgetter('position')),
        }
        streams: dict[str, Stream] = {}
        for name, (topic, values) in wanted.items():
            if not r.has(topic):
                continue
            samples = getattr(r, topic)()
            if len(samples) < 4:
                self.notes.append(f'{topic}: only {len(samples)} samples of use, left out')
                continue
            apart = np.isin(samples.stamp_ns, r.breaks(topic))
            streams[name] = Stream.of(self._seconds(samples), values(samples), apart=apart)
        return streams

    def _by_drive(self, names: Sequence[str], values: Singles) -> Singles:
        """Return values [N, len(names)] in the order of the drives; NaN for those not named."""
        result = np.full((len(values), len(self.names)), np.nan, np.float32)
        for i, name in enumerate(self.names):
            if name in names:
                result[:, i] = values[:, names.index(name)]
        return result


def _force_by_foot(samples: FootForceSamples) -> Singles:
    if set(samples.names) != set(_FEET):
        return samples.force
    return samples.force[:, [samples.names.index(name) for name in _FEET]]


def _continuous(orientation: Singles) -> Singles:
    """Return quaternions with signs that do not jump (q and −q are the same rotation)."""
    flips = np.where((orientation[1:] * orientation[:-1]).sum(axis=1) < 0, -1, 1)
    signs = np.concatenate([[1], np.cumprod(flips)]).astype(np.float32)
    return orientation * signs[:, None]
