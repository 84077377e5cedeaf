"""Live estimator on a recording, faster than real time."""

from collections.abc import Iterator

import numpy as np
from power_recordings.messages.cdr import POWER_ESTIMATE, encode
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_estimator.live.estimator import Estimate, LiveConfig, LiveEstimator
from power_estimator.model import PowerModel


def estimates(
    recording: Recording, model: PowerModel, config: LiveConfig | None = None
) -> tuple[tuple[str, ...], Iterator[Estimate]]:
    """
    Return the drives (joints with a command) and the estimates of the live node for them.

    A command holds from its stamp on, as if it had arrived in time.
    """
    states, commands = recording.joint_states(), recording.joint_commands()
    drives = tuple(name for name in states.names if name in commands.names)
    if not drives:
        raise InputError(
            f'{recording.path}: joint_states names {", ".join(states.names)} and joint_commands '
            f'names {", ".join(commands.names)}; no joint is in both'
        )
    live = LiveEstimator(model, drives, config)
    here = [states.names.index(name) for name in drives]
    there = [commands.names.index(name) for name in drives]

    def run() -> Iterator[Estimate]:
        signals = np.stack([states.position, states.velocity, states.effort], axis=1)
        rows = signals[:, :, here].astype(float)
        targets = commands.position[:, there].astype(float)
        command_stamps, following = commands.stamp_ns.tolist(), 0
        for stamp, (position, velocity, torque) in zip(
            states.stamp_ns.tolist(), rows, strict=True
        ):
            while following < len(command_stamps) and command_stamps[following] <= stamp:
                live.command(command_stamps[following], targets[following])
                following += 1
            estimate = live.joint_state(stamp, position, velocity, torque)
            if estimate is not None:
                yield estimate

    return drives, run()


def messages(estimates: list[Estimate], drives: tuple[str, ...], model: str) -> list[bytes]:
    """Encode PowerEstimate messages as CDR bytes."""
    return encode(
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
