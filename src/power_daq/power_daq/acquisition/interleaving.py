"""Samples from frames without counter or device clock, by the times of their receipt."""

import numpy as np

from power_daq.acquisition.assembly import Assembled
from power_daq.acquisition.stream_merger import CYCLIC, MergedRow, StreamMerger
from power_daq.bus.frame_group import FrameGroup
from power_daq.bus.signal_layout import Floats

_STATUS = 2
_HOLD = 0.5  # periods; replies to one round of queries belong together, also where rounds are late


class Interleaver:
    """
    Puts the frames of one group on the times of its first frame that is not silent.

    Values are interpolated between the frames on both sides. Those of a silent frame are NaN. It
    has the counts of an Assembler; lost samples are known by the gaps of the frames.
    """

    counter_jumps = 0

    def __init__(self, group: FrameGroup) -> None:
        self._group = group
        empty = bytes(max(frame.size for frame in group.frames))
        self._empty = [empty[: frame.size] for frame in group.frames]
        self.merger: StreamMerger[bytes] = StreamMerger(
            len(group.frames), 1e9 / group.rate, b'', CYCLIC, _HOLD
        )
        self._mapped = group.slots >= 0
        self._slots = np.maximum(group.slots, 0)
        self.received = 0

    @property
    def lost(self) -> int:
        """Number of samples that did not come, by the gaps of the frames they are timed by."""
        return self.merger.lost

    @property
    def missing(self) -> list[int]:
        """Number of frames of each slot that did not come, by their gaps."""
        return self.merger.missing

    @property
    def duplicates(self) -> int:
        """Number of frames that were received before the one before them."""
        return self.merger.out_of_order

    def add(self, slot: int, arrival: int, payload: bytes) -> list[Assembled]:
        """Take the frame of a slot that arrived at a steady time in ns; return full samples."""
        rows = self.merger.add(slot, arrival, payload)
        self.received += len(rows)
        return [self._assembled(row) for row in rows]

    def _assembled(self, row: MergedRow[bytes]) -> Assembled:
        weight = np.where(self._mapped, np.array(row.weight)[self._slots], 1.0)
        right = self._decode(row.right)
        if (weight == 1.0).all():
            return Assembled(row.number, row.time, right)
        left = self._decode(row.left)
        with np.errstate(invalid='ignore'):
            values = np.where(weight == 1.0, right, left + weight * (right - left))
        if 'status' in self._group.quantities:
            values[_STATUS] = right[_STATUS]  # flags are not interpolated
        return Assembled(row.number, row.time, values, np.isnan(weight))

    def _decode(self, payloads: list[bytes]) -> Floats:
        return self._group.decode(
            [payload or empty for payload, empty in zip(payloads, self._empty, strict=True)]
        )
