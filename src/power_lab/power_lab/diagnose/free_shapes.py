"""Free shapes of what no effect of the catalogue explains, to be fitted beside the effects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Effect, Signals, Term
from power_estimator.effects.fit.design_builder import Linearisation
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.judge.evidence import Evidence, Examiner

from power_lab.structure.drivers import Family, driver_values, factor_values, families
from power_lab.structure.in_time import InTime, course_effect, in_time
from power_lab.structure.problem import problems
from power_lab.structure.screening import DriverGain, DriverScreen
from power_lab.structure.shapes import hats, spread

Floats = NDArray[np.float64]

FREE_KINDS = ('position', 'other_drive')
"""
Quantities beside time that few effects of the catalogue depend on: a free shape over them takes
little of what an effect explains. One over speed or torque would take all of it.
"""
_NODES, _NODES_OF_TURN = 25, 49
_PRIOR, _LIMIT = {'torque': 10.0, 'power': 30.0}, 1e4  # N·m, W
_LEAST = 0.3  # of the squared floor, of a drive that has the shape
_MENTIONED = 0.1  # of the largest drive's gain


@dataclass(frozen=True)
class Remainder:
    """Structure that no effect explains, and what it depends on most."""

    gain: Floats  # W² [D], held out
    kind: str  # as `discover` has it: position, other_drive, time, torque …
    over: tuple[str, ...]  # in words, the drive with most of it first
    shape: Effect | None  # to be fitted beside effects; None where they depend on the same


def free_shape(name: str, places: Mapping[str, tuple[Family, Floats]]) -> Effect:
    """
    Function of a quantity with a value at each of its nodes, for fits beside it.

    places: family and nodes by drive.
    """
    family = next(iter(places.values()))[0]
    count = max(len(nodes) for _, nodes in places.values())
    unit, prior = 'N·m' if family.acts_on == 'torque' else 'W', _PRIOR[family.acts_on]

    def regressors(signals: Signals, **_: float) -> Floats:
        """One hat of each node times the factor of the family."""
        out = np.zeros((*signals.torque.shape, count))
        rows = np.arange(len(out))
        for column, drive in enumerate(signals.names):
            if drive not in places:
                continue
            family, nodes = places[drive]
            left, over = hats(driver_values(family.driver, signals, column), nodes)
            weight = factor_values(family.factor, signals, column)
            out[rows, column, left] = (1.0 - over) * weight
            out[rows, column, left + 1] = over * weight
        return out

    return Effect(
        name=name,
        physics='a shape that no effect of the catalogue has',
        formula='s(z)',
        terms=tuple(Term(f's{i}', unit, -_LIMIT, _LIMIT, prior=prior) for i in range(count)),
        regressors=regressors,
        kind='measurement',
        acts_on=family.acts_on,
        follows=frozenset({'drawn'}) if 'drawn' in family.driver.code else frozenset(),
        per_drive=not any(own.driver.other for own, _ in places.values()),
    )


def other_power(name: str, others: Mapping[str, Sequence[str]]) -> Effect:
    """
    Shares of the power of other drives, for fits beside it.

    others: by drive, those whose power its meter may show.
    """
    count = max(len(names) for names in others.values())

    def regressors(signals: Signals, **_: float) -> Floats:
        out = np.zeros((*signals.torque.shape, count))
        for column, drive in enumerate(signals.names):
            for term, other in enumerate(others.get(drive, ())):
                out[:, column, term] = signals.drawn[:, signals.names.index(other)]
        return out

    return Effect(
        name=name,
        physics='power of other drives in the reading of a meter',
        formula='c·(power of another drive)',
        terms=tuple(Term(f'c{i}', '1', -1.0, 1.0, prior=0.3) for i in range(count)),
        regressors=regressors,
        kind='measurement',
        follows=frozenset({'drawn'}),
    )


def remainder(
    fitter: Fitter, examiner: Examiner, evidence: Evidence, floor: Floats, name: str
) -> Remainder | None:
    """
    Return what the residual of a model depends on most, None where nothing stands out.

    floor: W [D]; name: of the shape.
    """
    prepared = fitter.prepared
    if prepared.whole:
        return None
    residual = examiner.residual(evidence)
    point = fitter.builder.point(evidence.fit.structure, evidence.fit.coefficients)
    screened: dict[tuple[str, ...], dict[int, DriverGain]] = {}
    courses: dict[int, InTime] = {}
    for problem in problems(fitter, evidence, examiner.folds, residual):
        least = _LEAST * float(floor[problem.drive]) ** 2
        course = in_time(problem, prepared.time, prepared.recording)
        if course is not None and course.gain >= least:
            courses[problem.drive] = course
        screen = DriverScreen(problem, point, prepared, moves=0)
        for family in families(point.signals, problem.drive):
            one = None if family.driver.memory else screen.screen(family)
            if one is None or one.gain < least:
                continue
            own = screened.setdefault(family.group, {})
            if problem.drive not in own or one.gain > own[problem.drive].gain:
                own[problem.drive] = one
    of_state = max(screened.values(), key=_sum, default={})
    if not courses and not of_state:
        return None
    gain = np.zeros(len(floor))
    if _sum(courses) >= _sum(of_state):
        for drive, course in courses.items():
            gain[drive] = course.gain
        places = {prepared.names[d]: (c.period, c.knots) for d, c in courses.items()}
        return Remainder(gain, 'time', _in_time(courses), course_effect(name, places))
    for drive, one in of_state.items():
        gain[drive] = one.gain
    kind = next(iter(of_state.values())).family.kind
    shape = _shape(name, of_state, point) if kind in FREE_KINDS else None
    return Remainder(gain, kind, _of_state(of_state, prepared.names), shape)


def _sum(found: Mapping[int, DriverGain] | Mapping[int, InTime]) -> float:
    return sum(one.gain for one in found.values())


def _shape(name: str, found: Mapping[int, DriverGain], point: Linearisation) -> Effect | None:
    signals = point.signals
    names = signals.names
    if next(iter(found.values())).family.driver.name == 'power_of':
        return other_power(name, {names[d]: [o for o in names if o != names[d]] for d in found})
    places = {}
    for drive, one in found.items():
        driver = one.family.driver
        count = _NODES_OF_TURN if driver.name == 'angle' else _NODES
        nodes = spread(driver_values(driver, signals, drive), count)
        if nodes is not None:
            places[names[drive]] = (one.family, nodes)
    return free_shape(name, places) if places else None


def _in_time(courses: Mapping[int, InTime]) -> tuple[str, ...]:
    periods = [one.period for one in courses.values() if one.period]
    if not periods:
        return ('time',)
    return (f'time, with a period of {float(np.median(periods)):.0f} s',)


def _of_state(found: Mapping[int, DriverGain], names: Sequence[str]) -> tuple[str, ...]:
    most = max(one.gain for one in found.values())
    order = sorted(found, key=lambda drive: -found[drive].gain)
    return tuple(
        _words(found[drive].family, names[drive])
        for drive in order
        if found[drive].gain >= _MENTIONED * most
    )


def _words(family: Family, drive: str) -> str:
    """A quantity of a drive, such as position of LF_KFE."""
    if not family.driver.other:
        return f'{family.kind} of {drive}'
    quantity = family.driver.name.removesuffix('_of')
    return f'{quantity} of {family.driver.other} (seen at {drive})'
