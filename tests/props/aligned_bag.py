"""Aligned signals written as a recording."""

import numpy as np
from synthetic_walk import Walk


def write(folder, data):
    """A recording of the same signals; its electrical samples are at 1 kHz."""
    walk = Walk(seconds=len(data.time) / data.rate, names=data.names, drive_names=data.names)
    slow = data.time - data.time[0]
    fast = np.arange(len(walk.current)) / 1000.0
    joint = np.arange(len(walk.position)) / 400.0
    for name in ('position', 'velocity'):
        given = getattr(data, name)
        getattr(walk, name)[:] = np.stack([np.interp(joint, slow, g) for g in given.T], axis=1)
    walk.effort[:] = np.stack([np.interp(joint, slow, g) for g in data.torque.T], axis=1)
    walk.voltage[:] = np.stack([np.interp(fast, slow, g) for g in data.voltage.T], axis=1)
    watts = np.stack([np.interp(fast, slow, g) for g in data.power.T], axis=1)
    walk.current[:] = watts / walk.voltage
    return walk.write(folder)
