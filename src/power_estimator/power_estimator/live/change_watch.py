"""Watch for drives that draw other than the reference, while the robot runs."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.schema import Quantity, check_quantities

from power_estimator.live.sequential_test import ReferenceNoise, ShiftDetector

LIKE: Final[Mapping[str, int]] = {
    'idle or current_offset': 0,
    'coulomb_friction': 1,
    'viscous_friction': 2,
    'copper_loss': 3,
    'power_gain': 4,
}
"""Causes by the column of their regressor: 1, |ω|, ω², τ², estimated power."""
_MONTH: Final = 30 * 86_400.0  # s
_SECONDS_KEPT: Final = 900
_ALIKE: Final = 1.1  # times the smallest squared error, of causes that cannot be told apart
_WHOLE: Final = 0.8  # of a second's or a block's samples that must be there


@dataclass(frozen=True)
class WatchConfig:
    """Length of blocks and of the reference, and the false alarms that are allowed."""

    false_alarms_per_month: Annotated[float, Quantity(1e-3, 1e3, '', 'of motion')] = 1.0
    reference_minutes: Annotated[float, Quantity(5.0, 600.0, 'min', 'of motion')] = 30.0
    block: Annotated[int, Quantity(3, 60, 's')] = 10

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def blocks_between_alarms(self) -> float:
        """Mean number of blocks between false alarms, at least."""
        return _MONTH / self.block / self.false_alarms_per_month


@dataclass(frozen=True)
class Shift:
    """A drive that draws more or less than the reference says."""

    drive: str
    watts: float  # mean since it began
    seconds: int  # of motion since it began
    like: tuple[str, ...]  # causes, the likeliest first; others are as likely

    @property
    def sentence(self) -> str:
        """The alarm in words."""
        more = 'more' if self.watts > 0 else 'less'
        return (
            f'{self.drive} draws {abs(self.watts):.2f} W {more} than the reference, for '
            f'{self.seconds} s of motion; like {" or ".join(self.like)}'
        )


class ChangeWatch:
    """Seconds of measured and estimated power of D drives, tested block by block.

    A block is the median of its seconds, so that a push or a stumble of less than half a block
    says nothing. The reference is learned from the first blocks unless it is given. Blocks in
    which a drive moves as the reference never did are left out for it.
    """

    def __init__(
        self,
        drives: Sequence[str],
        config: WatchConfig | None = None,
        reference: Mapping[str, ReferenceNoise] | None = None,
    ) -> None:
        self.config = config or WatchConfig()
        self.drives = tuple(drives)
        self.alarms: list[Shift] = []
        self.left_out = 0  # blocks of a drive
        self._seconds: list[Floats] = []  # [D, 6] each
        self._learned: list[Floats] = []  # [D, 6]
        self._follows: list[bool] = []  # whether the block before is that before in time
        self._unbroken = False
        self._recent: deque[tuple[int, Floats]] = deque(maxlen=_SECONDS_KEPT)
        self._index: int | None = None
        self._detector: ShiftDetector | None = None
        if reference is not None and all(name in reference for name in drives):
            self._begin(tuple(reference[name] for name in drives))

    @property
    def reference(self) -> dict[str, ReferenceNoise] | None:
        """The reference by drive; None while it is learned."""
        if self._detector is None:
            return None
        return dict(zip(self.drives, self._detector.noise, strict=True))

    @property
    def learned(self) -> float:
        """Share of the reference that is learned."""
        return 1.0 if self._detector else len(self._learned) / self._needed

    def report(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether nothing changed, a sentence, and figures."""
        figures = {
            'alarms': str(len(self.alarms)),
            'false alarms allowed': f'{self.config.false_alarms_per_month:g} a month of motion',
            'reference': f'{100 * self.learned:.0f} % learned',
            'blocks outside the reference': str(self.left_out),
        }
        if self.alarms:
            last = self.alarms[-1]
            figures |= {'drive': last.drive, 'effect': ' or '.join(last.like)}
            figures['difference'] = f'{last.watts:+.2f} W'
            return False, last.sentence, figures
        if self.reference is None:
            return True, 'learning the reference', figures
        return True, 'as the reference', figures

    @property
    def _needed(self) -> int:
        return round(self.config.reference_minutes * 60 / self.config.block)

    def second(self, index: int, difference: Floats, regressors: Floats) -> Shift | None:
        """Take one second's mean of measured − estimated, W [D], and of 1, |ω|, ω², τ², P [D, 5].

        index: of the second; NaN for drives without a value. Return a shift when it is found.
        """
        if self._index is not None and index != self._index + 1:
            self._pause()
        self._index = index
        row = np.concatenate([difference[:, None], regressors], axis=1)
        self._seconds.append(row)
        self._recent.append((index, row))
        if len(self._seconds) < self.config.block:
            return None
        seconds, self._seconds = np.stack(self._seconds), []
        known: Bools = np.asarray(np.isfinite(seconds).all(axis=2))  # [S, D]
        middle = np.full(seconds.shape[1:], np.nan)
        for drive, own in enumerate(known.T):
            if own.sum() >= _WHOLE * self.config.block:
                middle[drive] = np.median(seconds[own, drive], axis=0)
        return self._block(middle)

    def _block(self, block: Floats) -> Shift | None:
        if self._detector is None:
            self._learn(block)
            return None
        left: list[float | None] = []
        for row, noise in zip(block, self._detector.noise, strict=True):
            usable = np.isfinite(row).all() and noise.seen(row[2:])
            self.left_out += not usable
            left.append(noise.left(float(row[0]), row[2:]) if usable else None)
        since = self._detector.since.copy()
        found = self._detector.add(left)
        if found is None:
            return None
        drive, sign = found
        blocks = max(int(since[drive, 0 if sign > 0 else 1]) + 1, 1)
        shift = self._told(drive, blocks * self.config.block)
        self.alarms.append(shift)
        return shift

    def _pause(self) -> None:
        self._seconds.clear()
        self._unbroken = False
        if self._detector is not None:
            self._detector.pause()

    def _learn(self, block: Floats) -> None:
        whole = bool(np.isfinite(block).all())
        if whole:
            self._learned.append(block)
            self._follows.append(self._unbroken)
        self._unbroken = whole
        if len(self._learned) < self._needed:
            return
        blocks = np.stack(self._learned)
        follows = np.array(self._follows)
        noise = [
            ReferenceNoise.of(blocks[:, d, 0], blocks[:, d, 2:], follows)
            for d in range(len(self.drives))
        ]
        self._learned.clear()
        self._follows.clear()
        self._begin(tuple(noise))

    def _begin(self, noise: tuple[ReferenceNoise, ...]) -> None:
        self._detector = ShiftDetector(noise, self.config.blocks_between_alarms)

    def _told(self, drive: int, seconds: int) -> Shift:
        """Size and likely causes by the seconds since the shift began."""
        assert self._detector is not None
        noise = self._detector.noise[drive]
        rows = np.array([row[drive] for _, row in list(self._recent)[-seconds:]])
        rows = rows[np.isfinite(rows).all(axis=1)]
        more = np.array([noise.left(float(row[0]), row[2:]) for row in rows])
        errors = {}
        for name, column in LIKE.items():
            x = rows[:, 1 + column]
            square = float(x @ x)
            size = float(x @ more) / square if square > 0 else 0.0
            errors[name] = float(np.square(more - size * x).sum())
        least = max(min(errors.values()), 1e-12)
        order = sorted(errors, key=lambda name: errors[name])
        like = tuple(name for name in order if errors[name] <= _ALIKE * least)
        return Shift(self.drives[drive], float(np.median(more)), len(rows), like)
