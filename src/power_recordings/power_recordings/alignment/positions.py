"""Positions of drives that turn without end: unwrapping, and the check against the velocity."""

import numpy as np
from wattwalk_core.arrays import Floats, Singles

_TURN = 2 * np.pi
_JUMP = 0.75 * _TURN  # between two samples: an encoder that starts anew
_ALIKE = (0.7, 1.4)  # rate of the position over the velocity, both in radians
_REST = 0.2  # rad
_CLEAR = 0.8  # correlation of the two


def unwrapped(time: Floats, position: Singles, velocity: Singles) -> Singles:
    """Unwrap positions [N] in rad of an encoder that starts anew every turn.

    time: s [N]; velocity: rad/s [N]. Positions are returned as they are if they span more than one
    turn, or if the velocity does not confirm that the jumps are whole turns.
    """
    step = np.diff(position.astype(np.float64))
    known = np.isfinite(step)
    jumps = known & (np.abs(step) > _JUMP)
    if not jumps.any() or float(np.nanmax(position) - np.nanmin(position)) > 1.01 * _TURN:
        return position
    went = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)
    turns = np.where(jumps, np.rint((went - step) / _TURN), 0.0)
    rest = np.abs(step + _TURN * turns - went)[jumps]
    if not np.isfinite(rest).all() or np.median(rest) > 0.25 * _TURN:
        return position
    return np.asarray(position + _TURN * np.concatenate([[0.0], np.cumsum(turns)]), np.float32)


def stands_still(position: Singles | Floats) -> bool:
    """Return whether positions [N] span less than 0.2 rad from the 1st to the 99th percentile.

    Encoder noise and the compliance of a stalled shaft stay within that. True if all are NaN.
    """
    if not np.isfinite(position).any():
        return True
    low, high = np.nanpercentile(position, [1, 99]).tolist()
    return bool(high - low < _REST)


def is_rate(time: Floats, position: Singles, velocity: Singles) -> bool:
    """Return whether velocity [N] is the time derivative of position [N], in the same unit."""
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    rate = np.diff(position.astype(np.float64)) / np.maximum(np.diff(time), 1e-9)
    good = np.isfinite(rate) & np.isfinite(middle)
    if good.sum() < 10 or middle[good].std() == 0.0 or rate[good].std() == 0.0:
        return False
    correlation = float(np.corrcoef(rate[good], middle[good])[0, 1])
    slope = float(rate[good] @ middle[good] / (middle[good] @ middle[good]))
    return correlation > _CLEAR and _ALIKE[0] < slope < _ALIKE[1]
