"""Watch for drives that draw other than the reference, while the robot runs."""

import json
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import write_whole
from wattwalk_core.schema import CheckedFields, Quantity, read, schema
from wattwalk_core.yaml_file import dump_yaml

CLIP = 3.0
"""Standard deviations of an innovation that a block counts as at most: a fall says no more."""
BETS = (0.1, 0.2, 0.4, 0.8)
"""Sizes of shift that are bet on, in standard deviations of the innovations."""
_SURE = 3.0  # standard errors of the reference's mean within which a shift is none
_LARGER_VARIANCE = 2.33  # standard errors of the reference's variance that it may be larger by
_MOST_CORRELATED = 0.95
_LEAST_SIGMA = 1e-3  # W


@schema
class ReferenceNoise:
    """Statistics of block means of a drive's measured − estimated power in W, without a fault.

    A block mean is mean + slopes·(features − centre) plus an autoregressive process of first
    order. Features [F] outside [low, high] were not seen.
    """

    mean: float
    slopes: tuple[float, ...]
    centre: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    correlation: float  # of successive blocks
    sigma: float  # W, of the innovations
    bias: float  # of clipped innovations, in sigmas
    variance: float  # of clipped innovations, in sigmas²; an upper bound
    tolerance: float  # shift of the innovations, in sigmas, that the reference cannot exclude

    @classmethod
    def of(cls, blocks: Floats, features: Floats, follows: Bools) -> Self:
        """Estimate the statistics from n block means W [n] with features [n, F].

        follows [n]: whether the block before in the array is the one before in time.
        """
        centre = features.mean(axis=0)
        spread = np.maximum(features.std(axis=0), 1e-9)
        x = (features - centre) / spread
        # A ridge of one block: features that hardly vary, or all alike, get no slope.
        gram = x.T @ x + np.eye(x.shape[1])
        mean = float(blocks.mean())
        slopes = np.linalg.solve(gram, x.T @ (blocks - mean)) / spread
        left = blocks - mean - (features - centre) @ slopes
        now, before = left[1:][follows[1:]], left[:-1][follows[1:]]
        square = float(before @ before)
        found = float(now @ before) / square if square > 0 else 0.0
        correlation = float(np.clip(found, 0.0, _MOST_CORRELATED))
        first = np.sqrt(1.0 - correlation**2)  # of a block that follows none
        innovations = np.where(follows[1:], left[1:] - correlation * left[:-1], first * left[1:])
        sigma = max(float(innovations.std()), _LEAST_SIGMA)
        clipped = np.clip(innovations / sigma, -CLIP, CLIP)
        count = len(blocks)
        larger = 1.0 + _LARGER_VARIANCE * np.sqrt(2.0 / count)
        margin = 0.1 * (features.max(axis=0) - features.min(axis=0))
        return cls(
            mean=mean,
            slopes=tuple(slopes.tolist()),
            centre=tuple(centre.tolist()),
            low=tuple((features.min(axis=0) - margin).tolist()),
            high=tuple((features.max(axis=0) + margin).tolist()),
            correlation=correlation,
            sigma=sigma,
            bias=float(clipped.mean()),
            variance=float(clipped.var()) * larger,
            # The mean of n blocks is known to sigma/((1 − correlation)·√n): the innovations' to
            # sigma/√n.
            tolerance=float(_SURE / np.sqrt(count)),
        )

    def seen(self, features: Floats) -> bool:
        """Return whether features [F] lie within the range of the reference."""
        return bool((features >= self.low).all() and (features <= self.high).all())

    def left(self, block: float, features: Floats) -> float:
        """Return a block mean minus what the reference predicts for features [F], W."""
        return block - self.mean - float((features - self.centre) @ np.array(self.slopes))


class ShiftDetector:
    """Shiryaev–Roberts e-detectors of a shift of any of D drives, up or down.

    Each block multiplies a bet by an e-value, whose mean given the past is at most 1 while the
    innovations are those of the reference: exp(λ·y − v·(exp(λ·c) − 1 − λ·c)/c²), by Bennett's
    inequality for y ≤ c of variance v. The mean of M ← (M + 1)·e over drives, signs and bets
    passes A on average no sooner than after A blocks, whatever the dependence between drives.
    """

    def __init__(self, noise: Sequence[ReferenceNoise], blocks_between_alarms: float) -> None:
        """noise: of each drive; blocks_between_alarms: A, the least mean while nothing changed."""
        self.noise = noise
        self.limit = blocks_between_alarms
        self._last: list[float | None] = [None] * len(noise)
        self._log = np.full((len(noise), 2, len(BETS)), -np.inf)
        self._sum = np.zeros((len(noise), 2))  # of log e-values since they were last negative
        self.since = np.zeros((len(noise), 2), int)  # blocks of that sum

    def add(self, left: list[float | None]) -> tuple[int, int] | None:
        """Take one block: `ReferenceNoise.left` of each drive, W; None for a drive without one.

        Returns the drive and the sign (1 or −1) of a shift when it is found, else None; the
        evidence then begins anew.
        """
        for drive, (own, noise) in enumerate(zip(left, self.noise, strict=True)):
            before, self._last[drive] = self._last[drive], own
            if own is None:
                continue
            rho = noise.correlation
            innovation = np.sqrt(1.0 - rho**2) * own if before is None else own - rho * before
            y = float(np.clip(innovation / noise.sigma, -CLIP, CLIP)) - noise.bias
            gains = np.stack([log_e_values(one - noise.tolerance, noise) for one in (y, -y)])
            self._log[drive] = np.logaddexp(self._log[drive], 0.0) + gains
            self._sum[drive] = np.maximum(self._sum[drive] + gains.mean(axis=1), 0.0)
            self.since[drive] = np.where(self._sum[drive] > 0.0, self.since[drive] + 1, 0)
        largest = float(self._log.max())
        if not np.isfinite(largest):
            return None
        mean = largest + np.log(np.exp(self._log - largest).mean())
        if mean < np.log(self.limit):
            return None
        best = self._log.max(axis=2)
        drive, side = divmod(int(best.argmax()), best.shape[1])
        self._log[:] = -np.inf
        return drive, 1 if side == 0 else -1

    def pause(self) -> None:
        """Treat the next block as one that does not follow the last."""
        self._last = [None] * len(self.noise)


def log_e_values(y: float, noise: ReferenceNoise) -> Floats:
    """Return the log e-value [bets] of each bet for a clipped innovation y, in sigmas."""
    bets, most = np.array(BETS), CLIP + abs(noise.bias)
    cost = noise.variance * (np.expm1(bets * most) - bets * most) / most**2
    return np.asarray(bets * y - cost)


@schema
class WatchReference:
    """Content of a reference file: statistics by drive about a model, in blocks of `block` s."""

    format: Literal['watch_reference/1']
    model: str
    block: int
    drives: Mapping[str, ReferenceNoise]

    @classmethod
    def load(cls, path: Path, model: str, block: int) -> 'WatchReference | None':
        """Read a file, None if absent; InputError for another model or block length (s)."""
        if not path.exists():
            return None
        found = read(cls, path, 'reference')
        if (found.model, found.block) != (model, block):
            raise InputError(
                f'reference {path} is of the model {quoted(found.model)} in blocks of '
                f'{found.block} s, not of {quoted(model)} in {block} s: name another file'
            )
        return found

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        plain = json.loads(json.dumps(asdict(self)))  # lists for tuples
        write_whole(path, dump_yaml(plain))


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
class WatchConfig(CheckedFields):
    """Length of blocks and of the reference, and the false alarms that are allowed."""

    false_alarms_per_month: Annotated[float, Quantity(1e-3, 1e3, '', 'of motion')] = 1.0
    reference_minutes: Annotated[float, Quantity(5.0, 600.0, 'min', 'of motion')] = 30.0
    block: Annotated[int, Quantity(3, 60, 's')] = 10

    @property
    def blocks_between_alarms(self) -> float:
        """Least mean number of blocks between false alarms."""
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
        """Alarm in words."""
        more = 'more' if self.watts > 0 else 'less'
        return (
            f'{self.drive} draws {abs(self.watts):.2f} W {more} than the reference, for '
            f'{self.seconds} s of motion; like {" or ".join(self.like)}'
        )


class ChangeWatch:
    """Test for drives that draw other than their reference, from means over seconds.

    A block is the median of its seconds, so that a push or a stumble of less than half a block has
    no weight. The reference is learned from the first blocks unless it is given. A drive's blocks
    in which it moves as the reference never did are left out.
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
        # Blocks [D, 6], and whether the block before is that before in time.
        self._learned: list[tuple[Floats, bool]] = []
        self._unbroken = False
        self._recent: deque[Floats] = deque(maxlen=_SECONDS_KEPT)  # [D, 6] each
        self._index: int | None = None
        self._detector: ShiftDetector | None = None
        if reference is not None and all(name in reference for name in drives):
            self._begin([reference[name] for name in drives])

    @property
    def reference(self) -> dict[str, ReferenceNoise] | None:
        """Statistics by drive; None while they are learned."""
        if self._detector is None:
            return None
        return dict(zip(self.drives, self._detector.noise, strict=True))

    def report(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether nothing changed, a sentence, and figures as text by name."""
        learned = 1.0 if self._detector else len(self._learned) / self._needed
        figures = {
            'alarms': str(len(self.alarms)),
            'false alarms allowed': f'{self.config.false_alarms_per_month:g} a month of motion',
            'reference': f'{100 * learned:.0f} % learned',
            'blocks outside the reference': str(self.left_out),
        }
        if self.alarms:
            last = self.alarms[-1]
            figures |= {'drive': last.drive, 'effect': ' or '.join(last.like)}
            figures['difference'] = f'{last.watts:+.2f} W'
            return False, last.sentence, figures
        if self._detector is None:
            return True, 'learning the reference', figures
        return True, 'as the reference', figures

    @property
    def _needed(self) -> int:
        return round(self.config.reference_minutes * 60 / self.config.block)

    def second(self, index: int, difference: Floats, regressors: Floats) -> Shift | None:
        """Take the means over one second, and return a shift when it is found, else None.

        index: number of the second. difference: measured − estimated, W [D]. regressors [D, 5]: 1,
        |ω|, ω², τ² and estimated power. NaN for drives without a value.
        """
        if self._index is not None and index != self._index + 1:
            self._seconds.clear()
            self._unbroken = False
            if self._detector is not None:
                self._detector.pause()
        self._index = index
        row = np.column_stack([difference, regressors])
        self._seconds.append(row)
        self._recent.append(row)
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
        blocks = int(since[drive, 0 if sign > 0 else 1]) + 1
        self.alarms.append(self._told(drive, blocks * self.config.block))
        return self.alarms[-1]

    def _learn(self, block: Floats) -> None:
        whole = bool(np.isfinite(block).all())
        if whole:
            self._learned.append((block, self._unbroken))
        self._unbroken = whole
        if len(self._learned) < self._needed:
            return
        blocks = np.stack([block for block, _ in self._learned], axis=1)  # [D, n, 6]
        follows = np.array([follows for _, follows in self._learned])
        self._learned.clear()
        self._begin([ReferenceNoise.of(own[:, 0], own[:, 2:], follows) for own in blocks])

    def _begin(self, noise: Sequence[ReferenceNoise]) -> None:
        self._detector = ShiftDetector(noise, self.config.blocks_between_alarms)

    def _told(self, drive: int, seconds: int) -> Shift:
        """Size and likely causes by the seconds since the shift began."""
        assert self._detector is not None
        noise = self._detector.noise[drive]
        rows = np.array([row[drive] for row in list(self._recent)[-seconds:]])
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
