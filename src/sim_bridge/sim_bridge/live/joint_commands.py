"""Drive commands from JointState messages on `joint_commands`."""

from collections.abc import Collection, Sequence

import numpy as np
from wattwalk_core.arrays import Floats

from sim_bridge.plant.drive import JointCommand


def joint_command(
    joints: Sequence[str],
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float],
    effort: Sequence[float],
    absent: Collection[str] = (),
) -> JointCommand:
    """Return the command of a message's fields, in the order of joints.

    An empty field commands nothing; a joint that is not named, or whose value is not finite,
    is damped; joints that are absent may be named, to no effect, as on a bus where their drives
    are missing. ValueError for unknown or repeated names and fields of another length.
    """
    places: list[int | None] = []
    for name in names:
        if name in absent and name not in joints:
            places.append(None)
            continue
        if name not in joints:
            raise ValueError(f'no joint {name!r}; there are {", ".join(joints)}')
        places.append(joints.index(name))
    there = [place for place in places if place is not None]
    if len(set(there)) != len(there):
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
    field: str, values: Sequence[float], places: Sequence[int | None], count: int
) -> Floats | None:
    if len(values) == 0:
        return None
    if len(values) != len(places):
        raise ValueError(f'{field} has {len(values)} values for {len(places)} names')
    result: Floats = np.full(count, np.nan)
    for place, value in zip(places, values, strict=True):
        if place is not None:
            result[place] = value
    return result
