"""Motion as a policy of the supervisor: some drives move, the others hold."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from policy_runner.policies.inputs import Inputs
from policy_runner.supervisor.safety import Fault, FaultKind
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.plan import SegmentPlayer
from drive_bench.motion.segment_path import Mounting, Ramps

STALE_AFTER: Final = 2.0  # s


class WindingTemperature:
    """Latest winding temperature of each drive, °C, with its time of arrival, s."""

    def __init__(self) -> None:
        self._read: dict[str, tuple[float, float]] = {}

    def on_supply(self, names: Sequence[str], celsius: Sequence[float], now: float) -> None:
        """Store temperatures, °C, that came at `now`, s: one per name, or none if unknown."""
        for place, name in enumerate(names):
            if len(celsius) == len(names):
                self._read[name] = float(celsius[place]), now
            else:
                self._read.pop(name, None)

    def at(self, drive: str, now: float) -> float:
        """Return a drive's temperature, °C; NaN where it is missing or older than STALE_AFTER."""
        return math.nan if self.fault(drive, now) else self._read[drive][0]

    def fault(self, drive: str, now: float) -> Fault | None:
        """Return the fault of a drive's temperature (missing, NaN, stale); None if it is sound."""
        if drive not in self._read:
            return Fault(FaultKind.STALE, f'drive_supply has no winding temperature of {drive}')
        celsius, came = self._read[drive]
        if not math.isfinite(celsius):
            return Fault(FaultKind.NOT_FINITE, f'winding temperature of {drive}: {celsius} °C')
        if now - came > STALE_AFTER:
            return Fault(
                FaultKind.STALE,
                f'the winding temperature of {drive} is {now - came:.1f} s old, limit '
                f'{STALE_AFTER:g} s',
            )
        return None


_LONGEST_STEP = 0.03  # s; after a stall the motion takes longer instead of jumping


class MotionPolicy:
    """Policy that puts some drives through a motion while the others hold their initial positions.

    `prepare` is called first and plans from the measured pose. `velocity` and `effort` are feed
    forward, rad/s and N·m [D], or commands where `mode` says so. windings: temperatures as far
    as known. blocked: the reason why the motion cannot continue, or ''.
    """

    rate = 200.0
    ramp = 0.0

    def __init__(
        self,
        motion: MotionFile,
        joints: Sequence[str],
        drives: Sequence[str],
        mounting: Mounting,
        limits: Mapping[str, JointLimits],
    ) -> None:
        self.motion = motion
        self.velocity, self.effort = np.zeros(len(joints)), np.zeros(len(joints))
        self.targets = np.zeros(len(joints))
        self._drives = {list(joints).index(drive): drive for drive in drives}
        self._mounting, self._limits = mounting, limits
        self._players: dict[int, SegmentPlayer] = {}
        self._last: float | None = None
        self.windings = WindingTemperature()
        self.mode, self.blocked = 'position', ''

    def prepare(self, position: Floats) -> None:
        """Plan from a pose, rad [D]; InputError for a motion that leaves the limits."""
        if self.motion.free and len(self._drives) > 1:
            raise InputError(
                f'{self.motion.name} leaves position mode, which is for one drive at a time; give '
                'one --drive'
            )
        players = {
            place: SegmentPlayer(self.motion, float(position[place]), self._mounting, Ramps())
            for place in self._drives
        }
        for place, player in players.items():
            player.plan.check(self._drives[place], self._limits[self._drives[place]])
        self._players = players
        self.reset()
        self.targets = np.array(position, dtype=np.float64)

    def reset(self) -> None:
        """Begin from the first segment; after `prepare` only."""
        self._last = None
        self.mode, self.blocked = 'position', ''

    def take_over(self) -> float:
        """Begin from the first segment; return the motion's duration, s, without commands."""
        self.reset()
        return self.motion.seconds

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Return joint targets, rad [D], at a time, s; command and base_velocity are ignored."""
        since = 0.0 if self._last is None else min(max(time - self._last, 0.0), _LONGEST_STEP)
        self._last = time
        for place, player in self._players.items():
            temperature = self.windings.at(self._drives[place], time)
            measured = float(inputs.position[place])
            before = player.place
            target = player.step(since, measured, temperature)
            if player.place != before and self.mode != 'position':
                self._check_plan(place)
            self.mode = target.mode
            self.targets[place] = target.position if target.mode == 'position' else measured
            self.velocity[place], self.effort[place] = target.velocity, target.effort
        return self.targets.copy()

    def _check_plan(self, place: int) -> None:
        drive = self._drives[place]
        try:
            self._players[place].plan.check(drive, self._limits[drive])
        except InputError as error:
            self.blocked = str(error)

    @property
    def active(self) -> bool:
        """True while drives are commanded."""
        return self._last is not None

    @property
    def needing_temperature(self) -> tuple[str, ...]:
        """Drives that must not begin or continue without a winding temperature."""
        if not self.active:
            return tuple(self._drives.values()) if self.motion.warms else ()
        return tuple(
            self._drives[place] for place, one in self._players.items() if one.needs_temperature
        )

    @property
    def left(self) -> float:
        """Remaining time of the motion, s."""
        return max((player.left for player in self._players.values()), default=0.0)

    @property
    def segment(self) -> int:
        """Index of the present segment."""
        return next(iter(self._players.values())).place

    @property
    def slack(self) -> float:
        """Additional position error that is allowed where a segment saturates, rad."""
        segment = next(iter(self._players.values())).segment
        return 2.0 * abs(segment.amplitude) if segment.saturate else 0.0

    def moving(self) -> Iterator[tuple[int, JointLimits]]:
        """Yield the indices of the moving drives with their limits."""
        for place, drive in self._drives.items():
            yield place, self._limits[drive]
