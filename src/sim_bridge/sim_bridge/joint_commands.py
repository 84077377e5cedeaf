"""A JointState on `joint_commands` as a command to the drives."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_bridge.drive import JointCommand

Floats = NDArray[np.float64]


def joint_command(
    joints: Sequence[str],
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float],
    effort: Sequence[float],
) -> JointCommand:
    """
    The command that a message's fields give, in the order of joints.

    An empty field commands nothing; a joint that is not named, or whose value is not finite,
    is damped. ValueError for unknown or repeated names and fields of another length.
    """
    places = []
    for name in names:
        if name not in joints:
            raise ValueError(f'no joint {name!r}; there are {", ".join(joints)}')
        places.append(joints.index(name))
    if len(set(places)) != len(places):
        raise ValueError('a joint is named twice')
    return JointCommand(
        *(
            _placed(field, values, places, len(joints))
            for field, values in (
                ('position', position),
                ('velocity', velocity),
                ('effort', effort),
            )
        )
    )


def _placed(
    field: str, values: Sequence[float], places: Sequence[int], count: int
) -> Floats | None:
    if len(values) == 0:
        return None
    if len(values) != len(places):
        raise ValueError(f'{field} has {len(values)} values for {len(places)} names')
    result: Floats = np.full(count, np.nan)
    result[list(places)] = values
    return result
