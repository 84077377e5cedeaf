"""Blocks of a second, and the normal equations of each."""

import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController
from wattwalk_core.arrays import Bools, Floats, Singles

from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import REDUCED_RATE

_TURN = 1e-3  # s that a thread keeps the interpreter's lock; for the usual 5 ms numpy waits
Item = TypeVar('Item')
Result = TypeVar('Result')


class _Threads:
    """Threads of matrix products, which several callers may limit to one at the same time."""

    def __init__(self) -> None:
        self._lock, self._inside = threading.Lock(), threading.local()
        self._depth, self._before = 0, 1
        self._limit = ExitStack()

    def to_share(self) -> int:
        """Threads that items may share; one in a thread that shares some already."""
        if getattr(self._inside, 'shared', False):
            return 1
        with self._lock:
            return self._before if self._depth else _allowed()

    def mark_shared(self) -> None:
        """Mark a thread that works on shared items."""
        self._inside.shared = True

    @contextmanager
    def limited(self) -> Iterator[None]:
        """Limit each matrix product within `with` to one thread; `for_each` keeps its threads.

        Products of a few hundred columns gain nothing from a second thread, and wait for it thirty
        times as long as they take where another process has the core. The last caller that is done
        lifts the limit.
        """
        with self._lock:
            if not self._depth:
                self._before = _allowed()
                self._limit.enter_context(_controller().limit(limits=1, user_api='blas'))
                turn = sys.getswitchinterval()
                self._limit.callback(sys.setswitchinterval, turn)
                sys.setswitchinterval(min(_TURN, turn))
            self._depth += 1
        try:
            yield
        finally:
            with self._lock:
                self._depth -= 1
                if not self._depth:
                    self._limit.close()


_THREADS = _Threads()
one_thread_a_product = _THREADS.limited


def for_each(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Return the function's results in the order of the items, worked out by several threads.

    Threads are as many as a matrix product may use, and each product has one of them meanwhile:
    whoever limits those limits these. The results do not depend on the number of threads; the
    function must not change what it shares.
    """
    threads = min(_THREADS.to_share(), len(items))
    if threads < 2:
        return [function(item) for item in items]
    with _THREADS.limited(), ThreadPoolExecutor(threads, initializer=_THREADS.mark_shared) as pool:
        return list(pool.map(function, items))


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg.blas  # noqa: F401  its library counts, too

    return ThreadpoolController()


def _allowed() -> int:
    own = [one for one in _controller().info() if one['user_api'] == 'blas']
    counts = [int(one['num_threads']) for one in own]
    return min(counts, default=1)


@dataclass(frozen=True)
class Blocks:
    """Blocks of a second of reduced rows (50 Hz), shorter in a short recording.

    Errors and weights are by block. Each operating point of a steady recording is a block.
    """

    starts: NDArray[np.intp]  # [B] first row of each
    length: int
    recording: NDArray[np.int32]  # [B]
    time: Floats  # s [B], of the first row
    valid: Bools  # [B, D] where the power of the drive was measured throughout
    use: Bools  # [B, length, D] rows whose signals are resolved

    @classmethod
    def of(cls, prepared: Prepared, settings: FitSettings | None = None) -> 'Blocks':
        """Cut prepared signals into blocks that cross no gap; the longest that enough fit in."""
        settings = settings or FitSettings()
        window = prepared.reducer.window
        lengths = [round(s * REDUCED_RATE) for s in settings.block_seconds]
        if window or prepared.steady:
            lengths = [1 if prepared.steady else round(window * REDUCED_RATE)]
        for length in lengths:
            starts = [
                start
                for part in prepared.reducer.stretches()
                for start in range(part.start, part.stop - length + 1, length)
            ]
            if len(starts) >= settings.fewest_blocks:
                break
        first = np.array(starts, dtype=np.intp)
        rows = first[:, None] + np.arange(length)
        use = prepared.resolved[rows]
        enough = use.mean(axis=1) >= settings.least_used
        return cls(
            starts=first,
            length=length,
            recording=prepared.recording[first],
            time=prepared.time[first],
            valid=prepared.measured[rows].all(axis=1) & enough,
            use=use,
        )

    @property
    def independent(self) -> bool:
        """True if blocks are operating points, whose order means nothing."""
        return self.length == 1

    @property
    def rows(self) -> NDArray[np.intp]:
        """Row indices [B, length]."""
        return self.starts[:, None] + np.arange(self.length)

    @property
    def counts(self) -> NDArray[np.intp]:
        """Number of rows that count in each block, 1 or more, [B, D]."""
        return np.maximum(self.use.sum(axis=1), 1)

    @property
    def mask(self) -> Bools:
        """Mask of the rows that count [B, length, D]."""
        return self.use & self.valid[:, None, :]


@dataclass(frozen=True)
class Normal:
    """Normal equations of each block and drive; zero where the power was not measured."""

    gram: Floats  # [B, D, m, m]
    moment: Floats  # [B, D, m]
    square: Floats  # W² [B, D], sum of squared targets
    valid: Bools  # [B, D]

    @classmethod
    def of(cls, columns: Floats, target: Floats, blocks: Blocks) -> 'Normal':
        """Make normal equations from columns [N, D, m] and target W [N, D]."""
        zero = np.zeros_like(target)
        return DelayedNormal.of(columns, target[None], zero, blocks).at(0.0)

    def errors(self, coefficients: Floats) -> Floats:
        """Return summed squared residuals, W² [B, D], at coefficients [D, m] or [B, D, m]."""
        product = (self.gram @ coefficients[..., None])[..., 0]
        linear = (coefficients * (product - 2.0 * self.moment)).sum(axis=2)
        return np.maximum(self.square + linear, 0.0)


@dataclass(frozen=True)
class DelayedNormal:
    """Normal equations of each block and drive at S neighbouring delays of the power.

    Between two delays the power is interpolated linearly, so that its square needs the product
    with the power at the next delay.
    """

    gram: Floats  # [B, D, m, m]
    moment: Floats  # [S, B, D, m]
    square: Floats  # W² [S, B, D]
    next_: Floats  # W² [S, B, D]
    valid: Bools  # [B, D]

    @classmethod
    def of(
        cls, columns: Floats, power: Floats | Singles, constant: Floats, blocks: Blocks
    ) -> 'DelayedNormal':
        """Make normal equations from columns [N, D, m], power W [S, N, D] − constant [N, D]."""
        rows = blocks.rows
        count, drives, m, shifts = len(rows), columns.shape[1], columns.shape[2], len(power)
        gram = np.empty((count, drives, m, m))
        moment = np.empty((shifts, count, drives, m))
        square, next_ = np.empty((shifts, count, drives)), np.zeros((shifts, count, drives))
        masks = blocks.mask

        def fill(drive: int) -> None:
            mask = masks[..., drive]
            x = columns[rows, drive] * mask[..., None]  # [B, L, m]
            y = power[:, rows, drive] - constant[rows, drive]
            y = np.where(mask, np.nan_to_num(y), 0.0)  # [S, B, L]
            gram[:, drive] = x.transpose(0, 2, 1) @ x
            moment[:, :, drive] = (y.transpose(1, 0, 2) @ x).transpose(1, 0, 2)
            square[..., drive] = np.einsum('sbl,sbl->sb', y, y)
            next_[:-1, :, drive] = np.einsum('sbl,sbl->sb', y[:-1], y[1:])

        for_each(fill, range(drives))
        return cls(gram, moment, square, next_, blocks.valid)

    def at(self, place: float) -> Normal:
        """Return the equations at a place of the delay from 0 to S − 1, a fraction allowed."""
        here = int(place)
        if place == here:  # also of one delay alone, which has no neighbour; no copies
            return Normal(self.gram, self.moment[here], self.square[here], self.valid)
        (moment,), (square,) = between(np.array([place]), self.moment, self.square, self.next_)
        return Normal(self.gram, moment, square, self.valid)

    def summed(self, weights: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return sums over blocks with weights [B, D].

        They are gram [D, m, m], moment [S, D, m], square [S, D] and next_ [S, D].
        """
        count = len(weights)
        gram = np.empty(self.gram.shape[1:])
        moment = np.empty((len(self.moment), *self.moment.shape[2:]))
        for drive in range(len(gram)):
            own = weights[:, drive]
            gram[drive] = (own @ self.gram[:, drive].reshape(count, -1)).reshape(gram[drive].shape)
            moment[:, drive] = own @ self.moment[:, :, drive]
        square = np.einsum('sbd,bd->sd', self.square, weights)
        return gram, moment, square, np.einsum('sbd,bd->sd', self.next_, weights)


def modelled(columns: Floats, coefficients: Floats) -> Floats:
    """Return columns [N, D, m] times coefficients [D, m], summed to [N, D]."""
    out = np.empty(columns.shape[:2])
    for drive, own in enumerate(coefficients):
        out[:, drive] = columns[:, drive] @ own
    return out


def neighbours(places: Floats, delays: int) -> tuple[NDArray[np.intp], Floats]:
    """Return the last of some delays before each place among them, and the weight of the next."""
    left = np.minimum(places.astype(np.intp), delays - 2)
    return left, places - left


def between(
    places: Floats, moment: Floats, square: Floats, next_: Floats
) -> tuple[Floats, Floats]:
    """Return moment [P…, …, m] and squared target [P…, …] at places [P…] between S delays.

    They come from moment [S, …, m] and square [S, …]; the target is interpolated linearly. next_
    [S, …] is its product with that at the next delay.
    """
    left, share = neighbours(places, len(moment))
    w = share.reshape(*places.shape, *[1] * (square.ndim - 1))
    moments = (1 - w)[..., None] * moment[left] + w[..., None] * moment[left + 1]
    squares = (1 - w) ** 2 * square[left] + w**2 * square[left + 1] + 2 * w * (1 - w) * next_[left]
    return moments, squares


def drawn_blocks(count: int, repetitions: int, together: int, seed: int) -> Floats:
    """Return how often each of `count` blocks is drawn in moving-block bootstraps [R, count].

    repetitions: R; together: successive blocks that are drawn at once.
    """
    random = np.random.default_rng(seed)
    size = min(together, count)
    drawn = np.zeros((repetitions, count))
    for row in drawn:
        starts = random.integers(0, count - size + 1, -(-count // size))
        np.add.at(row, (starts[:, None] + np.arange(size)).ravel(), 1.0)
    return drawn
