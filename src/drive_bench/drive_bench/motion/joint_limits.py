"""How far, how fast and how strongly each joint may be moved."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from policy_runner.policies.kinematics import JOINT_NAMES, LIMITS
from wattwalk_core.errors import InputError

from drive_bench.motion.file import read_yaml

FORMAT: Final = 'joint_limits/1'
_SPEED, _TORQUE = 8.0, 80.0  # rad/s and N·m, of ANYmal's drives

ROUNDING: Final = 1e-9
"""By which a motion fitted to a limit may exceed it: rad, or share of a speed or torque."""


@dataclass(frozen=True)
class JointLimits:
    """Lowest and highest angle, rad, largest speed, rad/s, and torque, N·m, either way."""

    low: float = -math.inf
    high: float = math.inf
    speed: float = _SPEED
    torque: float = _TORQUE


def limits_of(joints: Sequence[str], path: Path | None = None) -> dict[str, JointLimits]:
    """
    Limits by joint, from a file or else those of ANYmal C.

    Joints that neither knows are left out. The file's names may be patterns such as '*_KFE'; the
    first that fits counts. InputError for a file that says something else.
    """
    if path is None:
        known = {
            name: JointLimits(float(low), float(high))
            for name, (low, high) in zip(JOINT_NAMES, LIMITS, strict=True)
        }
        return {joint: known[joint] for joint in joints if joint in known}
    patterns = _patterns(path)
    found = {}
    for joint in joints:
        fits = [limits for name, limits in patterns.items() if fnmatchcase(joint, name)]
        if fits:
            found[joint] = fits[0]
    return found


def _patterns(path: Path) -> dict[str, JointLimits]:
    content = read_yaml(path)
    joints = content.get('joints') if isinstance(content, Mapping) else None
    if not isinstance(content, Mapping) or content.get('format') != FORMAT:
        raise InputError(f'{path}: no joint limits; it must say format: {FORMAT}')
    if not isinstance(joints, Mapping) or not joints:
        raise InputError(
            f"{path}: joints is {joints!r}; give such as '*_KFE': "
            '{position: [-2.0, 2.0], speed: 4.0, torque: 40.0}'
        )
    return {str(name): _limits(entry, f'{path}: {name}') for name, entry in joints.items()}


def _limits(entry: object, where: str) -> JointLimits:
    keys = {'position', 'speed', 'torque'}
    if not isinstance(entry, Mapping) or set(entry) != keys:
        raise InputError(f'{where} is {entry!r}; it must have {", ".join(sorted(keys))}')
    position = entry['position']
    if not isinstance(position, list) or len(position) != 2:
        raise InputError(f'{where}: position is {position!r}; give [lowest, highest] in rad')
    low, high = (_finite(value, f'{where}: position') for value in position)
    speed, torque = (_finite(entry[key], f'{where}: {key}') for key in ('speed', 'torque'))
    if not (low < high and speed > 0.0 and torque > 0.0):
        raise InputError(
            f'{where} is {dict(entry)!r}; the lowest angle must be below the highest, speed and '
            'torque above 0'
        )
    return JointLimits(low, high, speed, torque)


def _finite(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f'{where} is {value!r}; it must be a number')
    return float(value)
