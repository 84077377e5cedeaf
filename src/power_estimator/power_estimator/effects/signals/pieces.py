"""Parts of recordings to judge on: evenly spread pieces of long ones, and one row in a few."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from power_estimator.effects.signals.prepared import Prepared, SignalPart

_PIECE = 12.0  # s, many times what filters and blocks lose at the ends of each
_GOLDEN = 0.6180339887  # its multiples spread most evenly over 0 to 1
_LEAST = 40.0  # s of each recording, that its delay and gain can be told


def pieces(prepared: Prepared, most: float) -> Prepared:
    """Return the signals cut to `most` s, in pieces of 12 s spread evenly over each recording.

    Recordings share the seconds: short ones stay whole, and none has less than 40 s for others.
    What remembers (a winding's temperature) still follows all samples. Slow meters and operating
    points are not cut. Where power was measured part of the time, seconds are those.
    """
    reducer = prepared.reducer
    total = sum(part.stop - part.start for part in reducer.slices)
    known = prepared.measured.mean(axis=0)
    most /= float(known[known > 0].min()) if known.any() else 1.0
    if reducer.window or reducer.steady or total <= most * reducer.rate:
        return prepared
    recordings = prepared.signals.recording
    parts: dict[int, list[tuple[slice, int]]] = {}
    for piece, stretch in zip(reducer.slices, reducer.stretches(), strict=True):
        parts.setdefault(int(recordings[piece.start]), []).append((piece, stretch.start))
    lengths = [sum(part.stop - part.start for part, _ in own) for own in parts.values()]
    shares = np.maximum(_shares(lengths, most * reducer.rate), _LEAST * reducer.rate)
    length = round(_PIECE * reducer.rate / reducer.factor) * reducer.factor
    least = 2 * reducer.margin + reducer.factor
    starts, sizes, reduced = [], [], []
    for own, whole, share in zip(parts.values(), lengths, shares.tolist(), strict=True):
        period = whole / max(1, int(share / length)) if whole > share else 0.0
        done = 0
        for part, row in own:
            size = part.stop - part.start
            for begin, end in _within(done, size, length, period, reducer.factor):
                if end - begin > least:
                    starts.append(part.start + begin)
                    sizes.append(end - begin)
                    reduced.append(row + begin // reducer.factor)
            done += size
    ends = np.cumsum(sizes).tolist()
    shorter = replace(
        reducer,
        slices=tuple(slice(end - size, end) for size, end in zip(sizes, ends, strict=True)),
    )
    counts = [part.stop - part.start for part in shorter.stretches()]
    rows, kept = _joined(starts, sizes), _joined(reduced, counts)
    segment = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    places = SignalPart(rows, kept, len(prepared.time))
    return prepared.at_rows(kept, shorter, prepared.signals.rows(rows, segment), places)


def _shares(lengths: Sequence[int], budget: float) -> Floats:
    """Samples of each recording: what the shorter ones do not need goes to the longer ones."""
    shares = np.zeros(len(lengths))
    left = budget
    order = np.argsort(lengths)
    for place, index in enumerate(order):
        shares[index] = min(lengths[index], left / (len(order) - place))
        left -= shares[index]
    return shares


def _within(
    done: int, size: int, length: int, period: float, factor: int
) -> Iterator[tuple[int, int]]:
    """Begin and end of each piece within a stretch of a size, after done samples of its recording.

    A period of 0 leaves the stretch whole. Pieces begin at a multiple of factor, each at another
    place of its period, so that a motion that repeats is seen in all of its phases.
    """
    if not period:
        yield 0, size
        return
    for number in range(max(0, int(done / period) - 1), int((done + size) / period) + 1):
        later = (number * _GOLDEN) % 1.0 * (period - length)
        offset = round((number * period + later - done) / factor) * factor
        yield max(0, offset), min(size, offset + length)


def _joined(starts: Sequence[int], sizes: Sequence[int]) -> NDArray[np.intp]:
    return np.concatenate(
        [start + np.arange(size) for start, size in zip(starts, sizes, strict=True)]
    )


def sparse(prepared: Prepared) -> Prepared:
    """Return the rows that the low-pass leaves nearly independent: these say as much."""
    reducer = prepared.reducer.sparse()
    stretches = prepared.reducer.stretches()
    rows = np.concatenate([np.arange(s.start, s.stop, reducer.every) for s in stretches])
    return prepared.at_rows(rows, reducer, prepared.signals, None)
