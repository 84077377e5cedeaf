"""Discovery's search: chance on motions that repeat themselves, effects that are superseded."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import Effect, Excitation, Term, builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.training import material
from power_lab.discover.discovery import Discoverer
from power_lab.discover.found import Found, without_superseded
from power_lab.structure.in_time import Course
from power_recordings.alignment.dataset import AlignedDataset

CATALOGUE = builtin_catalogue()
KNOWN = ('shaft', 'copper_loss', 'viscous_friction', 'coulomb_friction', 'rotor_inertia', 'idle')


def discovered(data):
    structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in KNOWN))
    terms = measurement_terms(CATALOGUE, shaft=True)
    fitter = material(data).fitter(per_drive=True)
    return Discoverer(fitter, structure.plus(*terms), CATALOGUE).run()


def test_a_rub_is_found_in_a_motion_that_repeats_itself_each_second():
    random = np.random.default_rng(5)
    time = np.arange(0.0, 40.0, 0.0025)
    turn = 2 * np.pi * time
    q = 0.8 * np.sin(turn) + 0.3 * np.sin(2 * turn + 1.0)
    w, a = np.gradient(q, 0.0025), np.gradient(np.gradient(q, 0.0025), 0.0025)
    torque = 1.5 * np.sin(3 * turn + 0.5) + np.cos(turn)
    power = torque * w + 1.3 * torque**2 + 4.2 + 0.02 * a * w
    power = power + 2.0 * np.exp(-(((q - 0.3) / 0.15) ** 4)) * np.abs(w)
    power = power + random.normal(0, 0.1, len(time))
    volts = np.full(len(time), 24.0)
    signals = {
        'position': q + random.normal(0, 2e-4, len(time)),
        'velocity': w + random.normal(0, 0.005, len(time)),
        'torque': torque + random.normal(0, 0.003, len(time)),
        'voltage': volts,
        'current': power / volts,
        'power': power,
    }
    columns = {name: values[:, None].astype(np.float32) for name, values in signals.items()}
    found = discovered(AlignedDataset.blank(400.0, ['BENCH'], time, 'bench', **columns))
    assert found.chance <= 0.05
    assert found.found[0].kind == 'position'


def test_a_step_in_time_begins_with_its_own_sample():
    course = Course(knots=3, step=(10.0, 12.0))
    columns = course.columns(np.array([10.0, 11.0, 12.0, 14.0]), np.zeros(4, np.int32))
    assert columns[:, -1].tolist() == [0.0, 0.0, 1.0, 1.0]
    assert columns[:, :3].tolist() == [[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0, 1]]
    assert course.words == 'a step after 2 s'


class Explained:
    """A fit whose error, W², says which effects it has."""

    def __init__(self, mse):
        self.mean_mse = np.array([mse])
        self.mse = np.full((40, 1), mse)


def found_effect(name, gain):
    return SimpleNamespace(name=name, gain=np.array([gain]))


def test_a_cycle_in_time_is_dropped_once_a_cause_is_found_that_explains_it():
    errors = {('cycle', 'voltage'): 1.0, ('voltage',): 1.01, ('cycle',): 4.0, (): 9.0}

    def examined(structure, start):
        return Explained(errors[tuple(sorted(structure.names))])

    def effect(name, gain):
        class Own(Effect):
            physics, formula, excitation = 'p', 'c', Excitation('none')
            terms = (Term('c', 'W', 0.0, 1.0),)

            def regressors(self, signals, **shape):
                return np.ones((*signals.torque.shape, 1))

        Own.name = name
        return Found(name, 'voltage', (0,), np.array([gain]), (1.0, 2.0), effect=Own())

    found = [effect('cycle', 5.0), effect('voltage', 3.0)]
    whole = Structure(tuple(Active.of(one.effect) for one in found))
    kept, best = without_superseded(found, Explained(1.0), whole, examined, np.array([0.3]))
    assert [one.name for one in kept] == ['voltage']
    assert kept[0].gain == pytest.approx(9.0 - 1.01)
    assert best.mean_mse == pytest.approx(1.01)


def test_effects_that_each_explain_something_all_stay_the_largest_first():
    errors = {('a', 'b'): 1.0, ('a',): 8.0, ('b',): 2.0}

    def examined(structure, start):
        return Explained(errors[tuple(sorted(structure.names))])

    found = [found_effect('a', 1.0), found_effect('b', 7.0)]

    class Names:
        def __init__(self, names):
            self.names = names

        def without(self, name):
            return Names([other for other in self.names if other != name])

    kept, _ = without_superseded(
        found, Explained(1.0), Names(['a', 'b']), examined, np.array([0.3])
    )
    assert [one.name for one in kept] == ['b', 'a']
