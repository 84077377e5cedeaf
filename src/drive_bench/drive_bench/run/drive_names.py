"""Joints by name or by the end of their name."""

from collections.abc import Sequence

from wattwalk_core.errors import InputError


def resolve(
    wanted: Sequence[str], joints: Sequence[str], there: Sequence[bool]
) -> tuple[str, ...]:
    """
    Return joints by name or by its end: KFE is LF_KFE where no other joint _KFE is present.

    there: whether each joint is present. InputError for none or several that fit; a full name
    comes first.
    """
    return tuple(dict.fromkeys(_one(name, joints, there) for name in wanted))


def _one(name: str, joints: Sequence[str], there: Sequence[bool]) -> str:
    if name in joints:
        return name
    fits = [joint for joint in joints if joint.endswith(f'_{name}')]
    present = [joint for joint in fits if there[list(joints).index(joint)]]
    if len(present) == 1:
        return present[0]
    if len(fits) == 1:
        return fits[0]
    if fits:
        raise InputError(f'--drive {name} may be {", ".join(present or fits)}; give one of them')
    raise InputError(f'no drive {name!r} in joint_states; it has {", ".join(joints)}')
