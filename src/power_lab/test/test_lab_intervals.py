"""Intervals of fitted coefficients."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.compare.fitting import fitted, named_effects
from sim_bridge.plant.parameters import Plant

from power_lab import Session

LEG = ('LF_HAA', 'LF_HFE', 'LF_KFE')
EFFECTS = 'shaft copper_loss viscous_friction coulomb_friction load_friction rotor_inertia idle'


def truth():
    """Coefficients of the simulated leg by effect, one a drive."""
    p = Plant.load('anymal_c').unit(3).resolve(LEG)
    resistance = p['resistance'] + p['device_resistance']
    return {
        'copper_loss': resistance / p['torque_constant'] ** 2,
        'rotor_inertia': p['rotor_inertia'],
        'idle': p['idle_power'],
    }


@pytest.mark.parametrize('reads', [1.0, 0.95])
def test_intervals_hold_the_truth_also_where_the_torque_sensor_reads_low(bag, reads):
    judge = Session.open(bag).judge
    data = replace(judge.recordings.data, torque=judge.recordings.data.torque * np.float32(reads))
    judge = Judge(Loaded.of(data), judge.catalogue)
    model = fitted(judge, named_effects([EFFECTS], judge.catalogue), 'leg', per='drive')
    held = [
        own.interval[0] <= value <= own.interval[1]
        for name, values in truth().items()
        for group, value in zip(model.groups, values, strict=True)
        for own in group.coefficients[name]
    ]
    assert len(held) == 9
    assert sum(held) >= 8, model.groups
