"""True plants for the lab's benchmarks, computed from currents and voltages, with their truth.

    from truths import FAMILIES, MOTIONS, Case, hidden_watts, record

    found = record(Case('elastic', 'walk', seconds=150, drives=3, seed=7, hidden=('spring',)))
    found.data        # AlignedDataset as `power_lab` loads it (unsmoothed, at the joints' rate)
    found.known       # effects of the base model: 'shaft' and all that exists but what is hidden
    found.missing     # effects that a perfect diagnosis names; empty for a null (hidden=())
    found.coefficients['LF_KFE']   # k, k_warm, inertia, idle, spring, friction_at_1, …
    found.power, found.parts       # W at 50 Hz without the meter's errors; parts sum to the power
    hidden_watts(found.case)       # W rms that each hidden effect changes the power by

A family (FAMILIES) draws plants; `developed` says whether the lab may be developed on it. Motions
of a family: `FAMILIES[name].motions`; any of MOTIONS runs with any family. `strength` multiplies
what is hidden. `plant_seed` holds the plant while `seed` draws other runs of it. 150 s of three
drives take about 1.5 s; the first call of a machine compiles for 10 s.

Coefficients, at the joint: `k` W/(N·m)² of winding and switches at 25 °C; `k_warm` at the
temperatures of the recording; `inertia` kg·m²; `idle` W, mean; `spring` rad/(N·m), 0 if rigid;
`friction_at_1` N·m at 1 rad/s without load and `load_friction`, both at the mean temperature;
`iron_at_1` W at 1 rad/s; `line` ohm; `torque_scale` and `meter_gain` of the sensors; `inverter` W,
mean. Where torque is computed from the current (`found.data.motor_torque`), friction, inertia and
iron are in it: `known` leaves them out, as nothing of them can be missing.
"""

from truths.families import FAMILIES, UNMODELLED
from truths.motions import MOTIONS
from truths.recorded import Case, Recorded, hidden_watts, record

__all__ = [
    'FAMILIES',
    'MOTIONS',
    'UNMODELLED',
    'Case',
    'Recorded',
    'hidden_watts',
    'record',
]
