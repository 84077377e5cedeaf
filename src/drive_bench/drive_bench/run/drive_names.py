"""Which joints the user means."""

from collections.abc import Sequence

from wattwalk_core.errors import InputError


def resolve(
    wanted: Sequence[str], joints: Sequence[str], there: Sequence[bool]
) -> tuple[str, ...]:
    """
    Joints by name or by how their name ends: KFE is LF_KFE where no other drive of it is there.

    there: whether a joint reads anything but zeros, as the drives do that are missing on a bus.
    InputError for none or several; a name that is a joint's counts as it is.
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
