"""Alignment of recordings on one time grid, for all that uses measured signals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError

from power_recordings.alignment.dataset import DRIVE_SIGNALS, AlignedDataset
from power_recordings.alignment.filters import antialias, centred, smoothing
from power_recordings.alignment.signals import RecordedSignals
from power_recordings.alignment.stream import Stream, held
from power_recordings.reading.reader import Recording

_FEWEST = 4


def operating_points(source: RecordedSignals, rate: float) -> AlignedDataset:
    """Return the rows of joint_states with torque, velocity and (if metered) power, unfiltered.

    Each row is a segment; `rate` [Hz] only labels the result. InputError for fewer than 4 rows.
    """
    time = source.joints.time
    found = source.sample(time, Stream.recorded)
    known = np.isfinite(found['velocity']).all(axis=1) & np.isfinite(found['torque']).all(axis=1)
    if source.measured:
        columns = [source.names.index(name) for name in source.measured]
        known &= np.isfinite(found['power'][:, columns]).all(axis=1)
    rows = np.flatnonzero(known)
    if len(rows) < _FEWEST:
        raise InputError(
            f'{source.path}: {len(rows)} of {len(time)} operating points have torque, speed and '
            'power'
        )
    notes = [*source.notes]
    if left_out := len(time) - len(rows):
        notes.append(f'{left_out} operating points with NaN left out')
    kept = {name: values[rows] for name, values in found.items()}
    whole = _dataset(source, rate, [{'time': np.arange(len(rows)) / rate, **kept}], notes)
    return replace(whole, segment=np.arange(len(rows), dtype=np.int32), steady=True)


GRID = 400.0  # Hz
RATES = (400.0, 200.0, 100.0, 50.0)


def align(
    recording: Recording,
    *,
    rate: float = 200.0,
    smooth: bool = True,
    drives: Sequence[str] | None = None,
    need_power: bool = True,
) -> AlignedDataset:
    """Align one recording on one time grid.

    Samples are placed by their stamps. Power is voltage × current of each 1 kHz sample; it is
    low-passed (`filters.antialias`) and evaluated on a 400 Hz grid in step with the joint states,
    to which all other signals are interpolated; commands are held. With `smooth` all signals but
    `cmd_vel` pass the same Savitzky-Golay filter of 12.5 Hz (paper, Section II-A), else, for rates
    under 400 Hz, all but the held ones pass the anti-alias filter; then every n-th sample is
    taken. No filter shifts a signal in time.

    Segments end at gaps, and nothing is carried across: more than 2.5 periods without joint states
    or electrical samples, missing sequence numbers, samples with a bad status or NaN of a measured
    drive, and the time before the first command. Each segment also loses half the length of its
    filters at both ends; `notes` of the result lists what was left out.

    A recording whose card says `steady` is taken as it is (`operating_points`).

    `drives`: the joints wanted, in that order (default: all of joint_states); the power of those
    that were not measured, or whose samples are mostly bad, is NaN. `need_power=False` admits
    recordings without drive_supply.

    Raises InputError, which names recording and field, if a topic is missing, if joint_states
    lacks a drive of drive_supply and `drives` does not leave it out, for values that are mostly
    NaN or in other units, and if no segment is long enough.
    """
    if rate not in RATES:
        raise InputError(f'rate is {rate:g} Hz; it is one of {", ".join(f"{r:g}" for r in RATES)}')
    source = RecordedSignals(recording.whole(), drives, need_power)
    if recording.card.steady:
        return operating_points(source, rate)
    taps = smoothing(GRID) if smooth else antialias(GRID, rate)
    every = round(GRID / rate)
    grids = [_grid(source.joints, *span) for span in _spans(source)]
    long = [grid for grid in grids if len(grid) >= len(taps) + every]
    electrics = source.electrics
    lost = 0.0 if electrics is None else 2 * electrics.half(GRID) * electrics.period
    shortest = lost + (len(taps) + every) / GRID  # s
    if not long:
        raise InputError(
            f'{recording.path}: nothing is left of {recording.duration:.2f} s: no stretch without '
            f'gaps is longer than the {shortest:.2f} s that the filters need'
            + ''.join(f'; {note}' for note in source.notes)
        )
    pieces = [_piece(source, grid, taps, every, hold=not smooth) for grid in long]
    whole = float(source.joints.time[-1] - source.joints.time[0])
    kept = sum(float(np.ptp(piece['time'])) for piece in pieces)
    notes = [*source.notes]
    if short := len(grids) - len(long):
        notes.append(f'{short} stretches under {shortest:.2f} s left out')
    if len(pieces) > 1 or whole - kept > 1.0:
        notes.append(f'{kept:.2f} s of {whole:.2f} s kept, in {len(pieces)} segments')
    return _dataset(source, rate, pieces, notes)


def load_aligned(
    recordings: Sequence[Path | Recording],
    *,
    rate: float = 200.0,
    smooth: bool = True,
    drives: Sequence[str] | None = None,
    need_power: bool = True,
) -> AlignedDataset:
    """Align several recordings as by `align` and join them.

    Raises InputError as `align` does, and for recordings of different joints unless `drives` gives
    those to take.
    """
    if not recordings:
        raise InputError('no recording given')
    read = (one if isinstance(one, Recording) else Recording.open(Path(one)) for one in recordings)
    parts = [
        align(one, rate=rate, smooth=smooth, drives=drives, need_power=need_power) for one in read
    ]
    return merge(parts)


def merge(parts: Sequence[AlignedDataset]) -> AlignedDataset:
    """Join aligned recordings, with the joints in the order of the first.

    InputError for different joints or rates, for torques of which only one is computed from a
    motor's current, and for `steady` operating points beside others.
    """
    first, *others = parts
    ordered = [first]
    for part in others:
        if set(part.names) != set(first.names):
            raise InputError(
                f'{first.recordings[0]} has the joints {", ".join(first.names)}, but '
                f'{part.recordings[0]} has {", ".join(part.names)}: name those to take'
            )
        ordered.append(part.drives(first.names))
        _require_same_kind(first, ordered[-1])
    return join(ordered)


def _require_same_kind(first: AlignedDataset, other: AlignedDataset) -> None:
    both = f'{first.recordings[0]} and {other.recordings[0]}'
    if first.rate != other.rate:
        raise InputError(
            f'{both}: aligned at {first.rate:g} Hz and {other.rate:g} Hz; align them at one rate'
        )
    for name in ('motor_torque', 'current_as_torque'):
        if differ := getattr(first, name) ^ getattr(other, name):
            raise InputError(
                f'{both}: the card of only one says that the torque of {min(differ)} is computed '
                'from the current; judge them apart'
            )
    if first.steady != other.steady:
        raise InputError(f'{both}: only one holds steady operating points; judge them apart')


def join(parts: Sequence[AlignedDataset]) -> AlignedDataset:
    """Concatenate datasets of the same drives, drive order and rate, which are not checked."""
    if len(parts) == 1:
        return parts[0]
    sizes = [len(part.time) for part in parts]

    def before(counts: Sequence[int]) -> NDArray[np.int32]:
        """Return the sum of the counts of the parts before its own for each row, [T]."""
        return np.repeat(np.cumsum([0, *counts[:-1]]), sizes).astype(np.int32)

    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ('time', 'segment', 'recording', *_PARTS)
    }
    arrays['segment'] += before([part.segment.max(initial=-1) + 1 for part in parts])
    arrays['recording'] += before([len(part.recordings) for part in parts])
    others = dict.fromkeys(name for part in parts for name in part.extras)
    return replace(
        parts[0],
        recordings=tuple(name for part in parts for name in part.recordings),
        extras={
            name: _joined(parts, [part.extras.get(name) for part in parts]) for name in others
        },
        notes=tuple(note for part in parts for note in part.notes),
        motor_current=_joined(parts, [part.motor_current for part in parts]),
        computed_power=frozenset().union(*(part.computed_power for part in parts)),
        **arrays,
    )


def _joined(parts: Sequence[AlignedDataset], arrays: Sequence[Singles | None]) -> Any:
    """Concatenate arrays [T, …], one a part: NaN for parts without one, None if all are."""
    known = next((array for array in arrays if array is not None), None)
    if known is None:
        return None
    return np.concatenate(
        [
            np.full((len(part.time), *known.shape[1:]), np.nan, np.float32) if own is None else own
            for part, own in zip(parts, arrays, strict=True)
        ]
    )


_PARTS = (*DRIVE_SIGNALS, 'supply')
_Piece = Mapping[str, NDArray[Any]]  # signals of a segment, and `time` in s after the start


def _spans(source: RecordedSignals) -> list[tuple[float, float]]:
    """Return start and end [s] of the intervals in which all needed signals are known."""
    found = source.joints.spans(GRID)
    if source.electrics is not None:
        found = _common(found, source.electrics.spans(GRID))
    begin = -np.inf if source.commands is None else float(source.commands[0][0])
    return [(max(a, begin), b) for a, b in found.tolist() if b > max(a, begin)]


def _piece(
    source: RecordedSignals, grid: Floats, taps: Floats, every: int, hold: bool
) -> dict[str, NDArray[Any]]:
    """Return the segment of a grid: every n-th sample of its signals, filtered by the taps.

    hold: take the command as it is held, unfiltered.
    """
    inner = slice(len(taps) // 2, len(grid) - len(taps) // 2, every)
    result: dict[str, NDArray[Any]] = {'time': grid[inner]}
    if source.cmd_vel is not None:
        result['cmd_vel'] = held(*source.cmd_vel, grid)[inner]
    for name, values in source.sample(grid).items():
        is_held = name == 'command' and hold
        result[name] = values[inner] if is_held else centred(values, taps)[::every]
    if 'orientation' in result:
        norm = np.linalg.norm(result['orientation'], axis=1, keepdims=True)
        result['orientation'] = result['orientation'] / np.maximum(norm, 1e-9)
    return result


def _grid(joints: Stream, start: float, end: float) -> Floats:
    """Return times at 400 Hz from start to end, in step with joint states of about that rate."""
    low, high = np.searchsorted(joints.time, [start - 1e-7, end + 1e-7]).tolist()
    times = joints.time[low:high]
    period = 1 / GRID
    if len(times) > 1 and abs(joints.period * GRID - 1) < 0.02:
        steps = np.rint(np.diff(times) / joints.period).sum()
        period = float((times[-1] - times[0]) / steps)
        start = float(times[0])
    count = int(np.floor((end - start) / period + 1e-6)) + 1
    return start + period * np.arange(max(count, 0), dtype=np.float64)


def _common(a: Floats, b: Floats) -> Floats:
    """Return the overlaps of two ascending lists of disjoint intervals [R, 2]."""
    edges = np.unique(np.concatenate([a, b], axis=None))
    middle = (edges[1:] + edges[:-1]) / 2
    inside = [np.searchsorted(x[:, 0], middle) > np.searchsorted(x[:, 1], middle) for x in (a, b)]
    return np.stack([edges[:-1], edges[1:]], axis=1)[inside[0] & inside[1]]


def _dataset(
    source: RecordedSignals, rate: float, pieces: Sequence[_Piece], notes: Sequence[str]
) -> AlignedDataset:
    sizes = [len(piece['time']) for piece in pieces]
    arrays: dict[str, Any] = {
        key: np.concatenate([piece[key] for piece in pieces]) for key in pieces[0]
    }
    arrays['supply'] = arrays['supply'][:, 0]
    time = arrays.pop('time') + source.start_ns / 1e9
    return AlignedDataset(
        rate=rate,
        names=source.names,
        time=time,
        segment=np.repeat(np.arange(len(pieces), dtype=np.int32), sizes),
        recordings=(str(source.path),),
        recording=np.zeros(len(time), np.int32),
        motor_current=arrays.pop('motor_current', None),
        extras={key: array for key, array in arrays.items() if key not in _PARTS},
        notes=tuple(f'{source.path}: {note}' for note in notes),
        **source.facts,
        **{key: arrays[key] for key in _PARTS},
    )
