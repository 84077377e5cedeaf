"""Pieces of long recordings, evenly spread, to judge on instead of all of them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.signals.prepared import Prepared, SignalPart

_PIECE = 12.0  # s, many times what filters and blocks lose at the ends of each


def pieces(prepared: Prepared, most: float) -> Prepared:
    """
    Return most seconds of the signals at most, in pieces of 12 s spread evenly over all stretches.

    What remembers (a winding's temperature) still follows all samples. Meters that are slow keep
    all of theirs.
    """
    reducer = prepared.reducer
    total = sum(part.stop - part.start for part in reducer.slices)
    if reducer.window or total <= most * reducer.rate:
        return prepared
    length = round(_PIECE * reducer.rate / reducer.factor) * reducer.factor
    period = total / max(1, int(most * reducer.rate / length))
    starts, stops, reduced = [], [], []
    done, row = 0, 0
    for part, stretch in zip(reducer.slices, reducer.stretches(), strict=True):
        size = part.stop - part.start
        first = int(np.ceil((done - length) / period))
        for number in range(max(first, 0), int((done + size) / period) + 1):
            offset = round((number * period - done) / reducer.factor) * reducer.factor
            begin, end = max(0, offset), min(size, offset + length)
            if end - begin > 2 * reducer.margin + reducer.factor:
                starts.append(part.start + begin)
                stops.append(part.start + end)
                reduced.append(row + begin // reducer.factor)
        done, row = done + size, row + stretch.stop - stretch.start
    sizes = [stop - start for start, stop in zip(starts, stops, strict=True)]
    ends = np.cumsum(sizes).tolist()
    own = replace(
        reducer,
        slices=tuple(slice(end - size, end) for size, end in zip(sizes, ends, strict=True)),
    )
    counts = [part.stop - part.start for part in own.stretches()]
    rows, kept = _joined(starts, sizes), _joined(reduced, counts)
    segment = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    return replace(
        prepared,
        signals=prepared.signals.rows(rows, segment),
        reducer=own,
        power=prepared.power[:, kept],
        time=prepared.time[kept],
        recording=prepared.recording[kept],
        part=SignalPart(rows, kept, len(prepared.time)),
    )


def _joined(starts: list[int], sizes: list[int]) -> NDArray[np.intp]:
    return np.concatenate(
        [start + np.arange(size) for start, size in zip(starts, sizes, strict=True)]
    )
