"""Tasks: walking at constant speed, as in Figure 5 of the paper."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from policy_runner.policies.velocity_commands import COMMAND_RATE_LIMIT, parse_velocity
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

SETTLE: Final = 1.0  # s of standing first
AXES: Final = ('vx', 'vy', 'yaw')
"""Names of the parts of a velocity command."""


@dataclass(frozen=True)
class Task:
    """Constant velocity command, reached by a ramp after a second of standing."""

    name: str
    command: tuple[float, float, float]  # vx, vy in m/s, yaw rate in rad/s

    def __post_init__(self) -> None:
        if not np.isfinite(self.command).all() or np.abs(self.command).max() > 3.0:
            raise InputError(
                f'task {self.name} commands {list(self.command)}; '
                'give vx, vy (m/s) and yaw rate (rad/s) within ±3'
            )

    def __call__(self, time: float) -> Floats:
        """Return the command at a time, s since the start [3]."""
        most = np.array(COMMAND_RATE_LIMIT) * max(time - SETTLE, 0.0)
        return np.clip(self.command, -most, most)


TASKS: Final = (
    Task('forward', (0.6, 0.0, 0.0)),
    Task('fast', (1.0, 0.0, 0.0)),
    Task('turn', (0.0, 0.0, 0.8)),
    Task('sideways', (0.0, 0.4, 0.0)),
)
"""Forward walking and turning on the spot are the paper's."""


def parse_tasks(texts: Sequence[str]) -> tuple[Task, ...]:
    """Parse `forward` or `NAME=VX,VY,YAW`; InputError for anything else."""
    known = {task.name: task for task in TASKS}
    tasks = []
    for text in texts:
        name, equals, numbers = text.partition('=')
        if not equals and name in known:
            tasks.append(known[name])
            continue
        try:
            command = parse_velocity(numbers)
        except InputError:
            raise InputError(
                f'task {text!r} is neither one of {", ".join(known)} nor NAME=VX,VY,YAW'
            ) from None
        tasks.append(Task(name, command))
    return tuple(tasks)
