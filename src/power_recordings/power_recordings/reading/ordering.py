"""Selection of samples with ascending stamps."""

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats, Stamps

_MOST_RUNS = 2000
_JUMP = 50.0  # usual steps

GAP = 2.5  # periods; a longer step is a gap
_UNEVEN = 1.5  # ratio of the 90th to the 10th percentile of the steps of a loop that waits
_RESOLVED = 0.04  # s, half a cycle of the 12.5 Hz that all signals are smoothed to
_JUDGED = 20_000  # steps


def longest_step(steps: Floats) -> float:
    """Return the duration [s] above which one of a stream's steps [N] counts as a gap.

    2.5 median steps; of a loop without a fixed rate (9 to 28 ms, say) 40 ms at least, over which
    the smoothed signals are still resolved. Infinite without steps.
    """
    if not len(steps):
        return np.inf
    low, middle, high = np.percentile(steps[:_JUDGED], [10, 50, 90]).tolist()
    limit = GAP * float(np.median(steps))
    return max(limit, _RESOLVED) if high > _UNEVEN * low and middle < _RESOLVED else limit


def ascending(stamps: Stamps) -> Bools:
    """Return a mask [N] that keeps as many samples as possible with strictly ascending stamps.

    Runs in which time moves forwards are kept: of a single stamp far ahead and all that follow,
    the single one is dropped; after a clock was set back, samples are dropped until time goes on.
    """
    keep = np.ones(len(stamps), np.bool_)
    keep[1:] = np.diff(stamps) != 0
    kept = np.flatnonzero(keep)
    times = stamps[kept]
    steps = np.diff(times)
    if (steps > 0).all():
        return keep
    odd = (steps < 0) | (steps > _JUMP * np.median(np.abs(steps)))
    edges = np.concatenate([[0], np.flatnonzero(odd) + 1, [len(times)]])
    if len(edges) > _MOST_RUNS:
        keep[kept[1:]] = times[1:] > np.maximum.accumulate(times)[:-1]
        return keep
    keep[:] = False
    for start, stop in _chain(times, edges):
        keep[kept[start:stop]] = True
    return keep


def _chain(times: Stamps, edges: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return the runs with most samples, each cut to begin after the one before."""
    starts, stops = edges[:-1], edges[1:]
    ends = times[stops - 1]
    best = stops - starts
    previous = np.full(len(starts), -1)
    first = starts.copy()
    for i in range(1, len(starts)):
        run = times[starts[i] : stops[i]]
        after = np.searchsorted(run, ends[:i], side='right')
        total = np.where(after < len(run), best[:i] + len(run) - after, 0)
        winner = int(np.argmax(total))
        if total[winner] > best[i]:
            best[i], previous[i] = total[winner], winner
            first[i] = starts[i] + after[winner]
    chain = []
    i = int(np.argmax(best))
    while i >= 0:
        chain.append((int(first[i]), int(stops[i])))
        i = int(previous[i])
    return chain[::-1]
