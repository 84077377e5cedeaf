"""Live estimator on a recording, faster than real time."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from power_recordings.messages.cdr import POWER_ESTIMATE, encode_block, in_a_list
from power_recordings.messages.samples import DriveSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_estimator.live.estimator import Estimate, LiveEstimator
from power_estimator.live.session import topics_of
from power_estimator.model import PowerModel


def estimates(
    recording: Recording, model: PowerModel
) -> tuple[tuple[str, ...], Iterator[Estimate]]:
    """Return the drives and, as an iterator, what the live node would estimate for them.

    The drives of a model that needs targets are the joints with a command; InputError if there is
    none. A command holds from its stamp on, as if it had arrived in time.
    """
    topics = topics_of((*model.needs.inputs, *model.needs.improved_by))
    drives = _drives_of(recording, 'joint_commands' in topics)
    return drives, _estimates(recording, LiveEstimator(model, drives), topics)


def messages(estimates: list[Estimate], drives: tuple[str, ...], model: str) -> list[bytes]:
    """Return estimates as PowerEstimate messages, each serialised to CDR bytes."""
    return in_a_list(
        encode_block(
            POWER_ESTIMATE,
            np.array([e.stamp for e in estimates], np.int64),
            {
                'power': np.array([e.power for e in estimates], np.float32),
                'total': np.array([e.total for e in estimates], np.float32),
                'status': np.array([e.status for e in estimates], np.uint8),
            },
            model=model,
            name=list(drives),
            power=np.zeros(len(drives)),
        )
    )


def _drives_of(recording: Recording, targets: bool) -> tuple[str, ...]:
    """Joints of a recording, those with a command for a model that needs targets."""
    names = recording.joint_states().names
    if not targets:
        return tuple(names)
    commanded = recording.joint_commands().names
    drives = tuple(name for name in names if name in commanded)
    if not drives:
        raise InputError(
            f'{recording.path}: joint_states names {", ".join(names)} and joint_commands '
            f'names {", ".join(commanded)}; no joint is in both'
        )
    return drives


def _estimates(recording: Recording, live: LiveEstimator, topics: set[str]) -> Iterator[Estimate]:
    states, drives = recording.joint_states(), live.drives
    signals = np.stack([states.position, states.velocity, states.effort], axis=1)
    rows = signals[:, :, [states.names.index(name) for name in drives]].astype(float)
    following: list[tuple[int, Floats]] = []
    if 'joint_commands' in topics:
        commands = recording.joint_commands()
        there = [commands.names.index(name) for name in drives]
        targets = commands.position[:, there].astype(float)
        following = list(zip(commands.stamp_ns.tolist(), targets, strict=True))[::-1]
    supply = None
    if 'drive_supply' in topics and recording.has('drive_supply'):
        supply = _held(recording.drive_supply(), drives, states.stamp_ns)
    for row, stamp in enumerate(states.stamp_ns.tolist()):
        while following and following[-1][0] <= stamp:
            live.command(*following.pop())
        if supply is not None:
            live.supply(*supply[:, row])
        estimate = live.joint_state(stamp, *rows[row])
        if estimate is not None:
            yield estimate


def _held(samples: DriveSamples, drives: Sequence[str], stamps: NDArray[np.int64]) -> Floats:
    """Voltage and temperature of the drives at these stamps, from the last sample [2, T, D]."""
    rows = np.searchsorted(samples.stamp_ns, stamps, side='right') - 1
    held = np.full((2, len(stamps), len(drives)), np.nan)
    for column, name in enumerate(drives):
        if name in samples.names:
            own = samples.names.index(name)
            for place, values in enumerate((samples.voltage, samples.temperature)):
                held[place, :, column] = np.where(rows >= 0, values[rows, own], np.nan)
    return held
