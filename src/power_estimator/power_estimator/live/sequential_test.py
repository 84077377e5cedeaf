"""Sequential test of block means against a reference, with a bound on its false alarms."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Literal, Self

import numpy as np
from wattwalk_core.arrays import Bools, Floats
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.files import write_whole
from wattwalk_core.schema import read, schema
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
    """Block means of a drive's measured − estimated power in W, as they were when all was well.

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
        """Learn from n blocks [n] with features [n, F].

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
        """Return whether features [F] lie where the reference has been."""
        return bool((features >= self.low).all() and (features <= self.high).all())

    def left(self, block: float, features: Floats) -> float:
        """Return what a block mean, W, has more than the reference."""
        return block - self.mean - float((features - self.centre) @ np.array(self.slopes))


class ShiftDetector:
    """Shiryaev–Roberts e-detectors of a shift of any of D drives, up or down.

    Each block multiplies a bet by an e-value, whose mean given the past is at most 1 while the
    innovations are those of the reference: exp(λ·y − v·(exp(λ·c) − 1 − λ·c)/c²), by Bennett's
    inequality for y ≤ c of variance v. The mean of M ← (M + 1)·e over drives, signs and bets
    passes A on average no sooner than after A blocks, whatever the dependence between drives.
    """

    def __init__(self, noise: tuple[ReferenceNoise, ...], blocks_between_alarms: float) -> None:
        """blocks_between_alarms: A, on average at least, while nothing changed."""
        self.noise = noise
        self.limit = blocks_between_alarms
        self._last: list[float | None] = [None] * len(noise)
        self._log = np.full((len(noise), 2, len(BETS)), -np.inf)
        self._sum = np.zeros((len(noise), 2))  # of log e-values since they were last negative
        self.since = np.zeros((len(noise), 2), int)  # blocks of that sum

    def add(self, left: list[float | None]) -> tuple[int, int] | None:
        """Take what each drive's block has more than the reference, W; None for no block.

        Return the drive and the sign (1 or −1) of a shift when it is found; the evidence then
        begins anew.
        """
        for drive, (own, noise) in enumerate(zip(left, self.noise, strict=True)):
            before, self._last[drive] = self._last[drive], own
            if own is not None:
                rho = noise.correlation
                alone = np.sqrt(1.0 - rho**2) * own
                self._bet(drive, alone if before is None else own - rho * before)
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
        """Take the next block as one that does not follow the last."""
        self._last = [None] * len(self.noise)

    def _bet(self, drive: int, innovation: float) -> None:
        noise = self.noise[drive]
        y = float(np.clip(innovation / noise.sigma, -CLIP, CLIP)) - noise.bias
        for side, sign in enumerate((1.0, -1.0)):
            gain = log_e_values(sign * y - noise.tolerance, noise)
            self._log[drive, side] = np.logaddexp(self._log[drive, side], 0.0) + gain
            total = max(self._sum[drive, side] + float(gain.mean()), 0.0)
            self._sum[drive, side] = total
            self.since[drive, side] = 0 if total == 0.0 else self.since[drive, side] + 1


def log_e_values(y: float, noise: ReferenceNoise) -> Floats:
    """Return the logarithms of the e-values of a clipped innovation, in sigmas, for all bets."""
    bets, most = np.array(BETS), CLIP + abs(noise.bias)
    cost = noise.variance * (np.expm1(bets * most) - bets * most) / most**2
    return np.asarray(bets * y - cost)


@schema
class WatchReference:
    """Noise of each drive about a model, in blocks of so many seconds."""

    format: Literal['watch_reference/1']
    model: str
    block: int
    drives: Mapping[str, ReferenceNoise]

    @classmethod
    def load(cls, path: Path, model: str, block: int) -> 'WatchReference | None':
        """Read a file, None where there is none; InputError for one of another model."""
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
        drives = {
            name: {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(own).items()}
            for name, own in self.drives.items()
        }
        content = {'format': self.format, 'model': self.model, 'block': self.block}
        write_whole(path, dump_yaml({**content, 'drives': drives}))
