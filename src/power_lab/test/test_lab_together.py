"""Several recordings of one robot, with errors of the meter that differ between them."""

from dataclasses import fields, replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.per_recording import in_step
from power_estimator.effects.training import material
from power_estimator.judge.estimator import together
from power_lab.diagnose.diagnosis import Diagnoser
from power_lab.diagnose.measurement_check import check_measurement
from power_lab.diagnose.next_recording import separating_motion
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


def diagnoser(data, known=MID):
    """The lab on recordings that are judged together, with the delays that it found."""
    structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in ('shaft', *known)))
    own, terms, delays = together(material(data), structure, CATALOGUE)
    return Diagnoser(own.fitter(per_drive=True), structure.plus(*terms), CATALOGUE), delays


def of_unit(hidden, motion, seed, faults, seconds=60.0):
    effects = dict.fromkeys(MID, 1.0) | hidden
    return record(Truth(effects, motion, seconds, seed, 51, faults))


def test_gain_offset_and_delay_are_each_recordings_own():
    data = joined(of_unit({}, 'walk', 1, FIRST), of_unit({}, 'ladder', 2, SECOND))
    lab, delays = diagnoser(data)
    assert delays[1] - delays[0] == pytest.approx(0.008, abs=0.0005)  # s, as simulated
    found = lab.run()
    assert found.verdict == 'no_evidence', found.steps
    checked = check_measurement(found, lab.fitter, None, other_recording=False, delays=delays)
    gains = list(checked['power_gain'].recordings.values())
    assert gains[0] - gains[1] == pytest.approx(0.04, abs=0.01)
    offsets = list(checked['current_offset'].recordings.values())
    assert offsets[0] - offsets[1] == pytest.approx(0.03, abs=0.008)  # A
    late = checked['time_offset'].recordings
    assert late['ladder_2'] - late['walk_1'] == pytest.approx(0.008, abs=0.0005)  # s
    assert checked['power_gain'].json()['recording'] in data.recordings


def test_coefficients_are_common_and_an_effect_is_named_across_recordings():
    hidden = {'load_friction': 1.0}
    data = joined(of_unit(hidden, 'walk', 1, FIRST), of_unit(hidden, 'ladder', 2, SECOND))
    lab, _ = diagnoser(data)
    found = lab.run()
    assert found.effects == ('load_friction',), found.steps
    column = found.best.fit.structure.columns_of('load_friction')
    assert found.best.fit.coefficients[:, column].shape == (3, 1)  # by drive, for both recordings


def test_one_recording_has_the_terms_that_it_always_had():
    lab, delays = diagnoser(of_unit({}, 'walk', 1, FIRST, 30.0))
    assert not delays.any()
    assert [len(lab.base.columns_of(n)) for n in ('power_gain', 'current_offset')] == [1, 1]


def test_power_of_a_late_recording_is_put_in_step_with_the_others():
    data = joined(of_unit({}, 'walk', 1, FIRST, 25.0), of_unit({}, 'walk', 1, SECOND, 25.0))
    prepared = material(data).prepared
    moved = in_step(prepared, np.array([0.0, 0.008]))
    late = prepared.recording == 1
    assert np.array_equal(moved.power[:, ~late], prepared.power[:, ~late])
    assert np.allclose(moved.power_at(0.002)[late], prepared.power_at(0.010)[late], atol=1e-3)


def test_what_the_walk_leaves_open_is_named_with_the_recording_that_shows_it():
    hidden = {'regeneration_limit': 1.0}
    walk = of_unit(hidden, 'walk', 2, Faults(), 40.0)
    alone = diagnoser(walk)[0].run()
    assert alone.verdict == 'ambiguous', alone.steps
    assert 'regeneration_limit' in alone.effects
    open_ = [name for name in alone.effects if name not in alone.certain]
    assert len(open_) > 1
    asked = separating_motion(open_, CATALOGUE, walk.names, 'to tell them apart')
    effects = dict.fromkeys(MID, 1.0) | hidden
    shown = record(Truth(effects, 'asked', 0.0, 3, 51, SECOND, asked.segments))
    both = diagnoser(joined(walk, shown))[0].run()
    assert both.verdict == 'named', both.steps
    assert both.effects == ('regeneration_limit',)
