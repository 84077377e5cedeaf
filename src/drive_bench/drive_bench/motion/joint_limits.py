"""Limits of joints: angle, speed and torque (`format: joint_limits/1`)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Final, Literal

from wattwalk_core.anymal import JOINT_NAMES, LIMITS, TORQUE_LIMIT
from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, read, schema

_SPEED: Final = 8.0  # rad/s, just above that of ANYmal's drives

_Angle = Annotated[float, Quantity(-1e3, 1e3, 'rad')]

ROUNDING: Final = 1e-9
"""Tolerance of a motion fitted to a limit: rad, or share of a speed or torque."""


@dataclass(frozen=True)
class JointLimits:
    """Lowest and highest angle, rad; largest speed, rad/s, and torque, N·m, of either sign."""

    low: float = -math.inf
    high: float = math.inf
    speed: float = _SPEED
    torque: float = TORQUE_LIMIT


@schema
class _LimitsEntry:
    """Limits of the joints that a pattern names."""

    position: tuple[_Angle, _Angle]
    speed: Annotated[float, Quantity(1e-3, 1e3, 'rad/s')]
    torque: Annotated[float, Quantity(1e-3, 1e4, 'N·m')]

    def __post_init__(self) -> None:
        if not self.position[0] < self.position[1]:
            raise InputError('position: the lowest angle must be below the highest')


@schema
class _LimitsFile:
    """Content of a file of joint limits: entries by name or pattern of a joint."""

    format: Literal['joint_limits/1']
    joints: dict[str, _LimitsEntry]


def limits_of(joints: Sequence[str], path: Path | None = None) -> dict[str, JointLimits]:
    """Return limits by joint, from a file or else those of ANYmal C.

    Joints without limits are left out. The file's names may be patterns such as '*_KFE'; the
    first that fits counts. InputError for a file that does not fit its format.
    """
    if path is None:
        known = {
            name: JointLimits(float(low), float(high))
            for name, (low, high) in zip(JOINT_NAMES, LIMITS, strict=True)
        }
        return {joint: known[joint] for joint in joints if joint in known}
    patterns = read(_LimitsFile, path, 'joint limits').joints
    found = {}
    for joint in joints:
        entry = next((e for name, e in patterns.items() if fnmatchcase(joint, name)), None)
        if entry is not None:
            found[joint] = JointLimits(*entry.position, entry.speed, entry.torque)
    return found
