"""Several recordings of one robot, with errors of the meter that differ between them."""

from dataclasses import fields, replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.per_recording import in_step
from power_estimator.effects.training import material
from power_lab.diagnose.diagnosis import diagnosed
from power_lab.diagnose.measurement import measurement_terms
from truth_circuit import Faults, Truth, record

CATALOGUE = builtin_catalogue()
MID = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')
FIRST = Faults(gain=0.02, current_offset=0.015, delay=0.0015)
SECOND = Faults(gain=-0.02, current_offset=-0.015, delay=0.0095)


def joined(*datasets):
    """One dataset of several recordings."""
    arrays = {
        f.name: np.concatenate([getattr(data, f.name) for data in datasets])
        for f in fields(datasets[0])
        if isinstance(getattr(datasets[0], f.name), np.ndarray)
    }
    number = np.repeat(np.arange(len(datasets), dtype=np.int32), [len(d.time) for d in datasets])
    names = tuple(name for data in datasets for name in data.recordings)
    return replace(
        datasets[0], **arrays | {'segment': number, 'recording': number}, recordings=names
    )


def diagnose(data, known=MID):
    """Diagnosis of recordings that are judged together."""
    actives = [Active.of(CATALOGUE[name]) for name in ('shaft', *known)]
    return diagnosed(material(data, per='drive'), actives, CATALOGUE)


def of_unit(hidden, motion, seed, faults, seconds=60.0):
    effects = dict.fromkeys(MID, 1.0) | hidden
    return record(Truth(effects, motion, seconds, seed, 51, faults))


def test_gain_offset_and_delay_are_each_recordings_own():
    data = joined(of_unit({}, 'walk', 1, FIRST), of_unit({}, 'ladder', 2, SECOND))
    found = diagnose(data.drives(['LF_KFE']))
    assert (found.verdict, found.effects) == ('no_evidence', ())
    terms = measurement_terms(found.found, found.prepared, 0.3, found.apart)
    gain, offset, late = (
        terms[name].json()['recordings']
        for name in ('power_gain', 'current_offset', 'time_offset')
    )
    assert gain['walk_1'] - gain['ladder_2'] == pytest.approx(0.04, abs=0.01)
    assert offset['walk_1'] - offset['ladder_2'] == pytest.approx(0.03, abs=0.008)  # A
    assert late['ladder_2'] - late['walk_1'] == pytest.approx(0.008, abs=0.0005)  # s, as simulated


def test_an_effect_is_named_across_recordings_with_one_coefficient():
    hidden = {'load_friction': 2.0}
    data = joined(of_unit(hidden, 'walk', 1, FIRST), of_unit(hidden, 'ladder', 2, SECOND))
    found = diagnose(data.drives(['LF_KFE']))
    assert found.effects == ('load_friction',)
    (one,) = (c for c in found.candidates if c.name == 'load_friction')
    assert one.coefficients['LF_KFE'] == [pytest.approx(one.coefficient, rel=1e-4)]


def test_one_recording_has_no_errors_beside_those_of_all():
    data = of_unit({}, 'walk', 1, FIRST, 30.0)
    assert diagnose(data.drives(['LF_KFE'])).apart == {}


def test_power_of_a_late_recording_is_put_in_step_with_the_others():
    data = joined(of_unit({}, 'walk', 1, FIRST, 25.0), of_unit({}, 'walk', 1, SECOND, 25.0))
    prepared = material(data).prepared
    moved = in_step(prepared, np.array([0.0, 0.008]))
    late = prepared.recording == 1
    assert np.array_equal(moved.power[:, ~late], prepared.power[:, ~late])
    assert np.allclose(moved.power_at(0.002)[late], prepared.power_at(0.010)[late], atol=1e-3)
