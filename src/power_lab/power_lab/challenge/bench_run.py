"""A proposed motion on the simulated bench: shortened where that is wanted, with its time."""

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drive_bench.motion.joint_limits import limits_of

from power_lab.diagnose.next_recording import Motion

_TRIED = 4.0  # s of motion, from which the time for all of it is told
_LEAST = 1.0  # s of a segment


def shortened(motion: Motion, seconds: float) -> Motion:
    """The motion with all segments cut by one factor; waves keep a period, the others 1 s."""
    whole = sum(float(segment['seconds']) for segment in motion.segments)
    factor = min(seconds / max(whole, 1e-9), 1.0)

    def cut(segment: Mapping[str, Any]) -> dict[str, Any]:
        before = float(segment['seconds'])
        least = max(_LEAST, 1.0 / float(segment.get('frequency') or _LEAST))
        return {**segment, 'seconds': min(before, max(round(factor * before, 1), least))}

    return replace(motion, segments=tuple(cut(segment) for segment in motion.segments))


def record_on_bench(
    proposed: Motion,
    drive: str,
    file: Path,
    output: Path,
    riddle: Path | None,
    tell: Callable[[str], None],
) -> None:
    """Save a motion fitted to its drive's limits, and record it; tell how long that will take."""
    from sim_bridge.plant.parameters import Plant  # slow to import: the simulator

    from power_lab.challenge.bench_recording import record_motion  # imports the simulator

    motion = proposed.within(limits_of(proposed.drives, None))
    motion.save(file)
    plant = Plant.load('anymal_c')
    with tempfile.TemporaryDirectory() as scratch:
        trial = Path(scratch) / 'trial.yaml'
        first = replace(motion, segments=motion.segments[:1])
        shortened(first, _TRIED).save(trial)
        began = time.monotonic()
        how: dict[str, Any] = {'drive': drive, 'challenge': riddle}
        _, seconds = record_motion(trial, Path(scratch) / 'trial', plant, **how)
        needed = (time.monotonic() - began) / seconds * motion.seconds
    tell(
        f'recording {motion.seconds:.0f} s of {drive} on the simulated bench, which takes about '
        f'{_in_words(needed)}'
    )
    record_motion(file, output, plant, **how)


def _in_words(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 90 else f'{seconds / 60:.0f} min'
