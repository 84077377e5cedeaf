"""Departures of effects from their formulas, at figures that can be checked by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from power_estimator.effects import Signals, builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.reducer import Reducer
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.posterior.departures import Departures

EFFECTS = builtin_catalogue()
COPPER, VISCOUS = (Active.of(EFFECTS[name]) for name in ('copper_loss', 'viscous_friction'))
TIME = np.arange(400) / 100.0
SPEED = 3.0 + np.sin(2 * np.pi * TIME)  # rad/s
TORQUE = np.where(TIME < 2.0, 1.0, -1.0)  # N·m


def signals(cost=0.0):
    """A drive that turns on and pulls with 1 N·m to either side; cost: W/(N·m) of its torque."""
    return SimpleNamespace(
        time=TIME,
        steady=False,
        scale=DriveScale.reference(1),
        velocity=SPEED[:, None],
        torque=TORQUE[:, None],
        motor_velocity=SPEED[:, None],
        motor_torque=TORQUE[:, None],
        torque_cost=np.full((len(TIME), 1), cost),
    )


def departures():
    """Departures on signals that pass as they are, and on regressors of their textbook."""
    regressors = {'copper_loss': TORQUE**2, 'viscous_friction': SPEED}
    as_they_are = Reducer(100.0, (slice(0, len(TIME)),), steady=True)
    return Departures(
        SimpleNamespace(
            prepared=SimpleNamespace(
                signals=signals(), reducer=as_they_are, reduced=as_they_are.reduce
            ),
            regressors=lambda active, s: regressors[active.name][:, None, None],
        )
    )


def of(name, value, cost=0.0):
    """Departures of one effect."""
    active = COPPER if name == 'copper_loss' else VISCOUS
    return departures().of({name: (active, np.array([value]))}, signals(cost))


def of_cause(departed, cause, place):
    """A column of the forms by which a kind of power departs."""
    return departed.formed[:, departed.causes.index(cause) + place]


def dry(speed, cost=0.0, recording=None):
    """Departures of 2 N·m of dry friction of a drive at so many rad/s [T]: turns, and at rest."""
    moves = np.broadcast_to(speed, TIME.shape)[:, None]
    none = np.zeros_like(moves, dtype=np.float64)
    pieces = np.zeros(len(TIME), np.int32) if recording is None else recording
    given = Signals(
        **dict.fromkeys(('acceleration', 'motor_acceleration', 'torque_rate'), none),
        electronics=none,
        **dict.fromkeys(('torque', 'motor_torque'), none + 5.0),
        **dict.fromkeys(('velocity', 'motor_velocity'), none + moves),
        **dict.fromkeys(('segment', 'recording'), pieces),
        rate=100.0,
        names=('LF_KFE',),
        time=TIME,
        position=np.cumsum(moves, axis=0) / 100.0,
        voltage=none + 48.0,
        temperature=none * np.nan,
        torque_cost=none + cost,
        drawn=none,
        scale=DriveScale.reference(1),
        at_motor=np.zeros(1, dtype=bool),
    )
    own = Active.of(EFFECTS['coulomb_friction'])
    as_they_are = Reducer(100.0, (slice(0, len(TIME)),), steady=True)
    prepared = SimpleNamespace(signals=given, reducer=as_they_are, reduced=as_they_are.reduce)
    builder = SimpleNamespace(prepared=prepared, regressors=lambda a, s: a.effect.regressors(s))
    return Departures(builder).of({own.name: (own, np.array([2.0]))}, given).formed[:, -5:].T


def test_dry_friction_holds_a_drive_at_rest_as_it_last_moved():
    *_, held = dry(np.where(TIME < 2.0, 1.0, 0.0), cost=1.5)
    assert held[TIME < 1.9] == pytest.approx(0.0, abs=1e-6)
    assert held[TIME > 2.1] == pytest.approx(0.5 * 2.0 * 1.5, rel=0.01)  # half of 2 N·m
    *_, held = dry(np.where(TIME < 2.0, -1.0, 0.0), cost=1.5)
    assert held[TIME > 2.1] == pytest.approx(-0.5 * 2.0 * 1.5, rel=0.01)


def test_how_a_drive_moved_in_another_recording_does_not_hold_it():
    other = (TIME >= 2.5).astype(np.int32)
    *_, held = dry(np.where(TIME < 2.0, 1.0, 0.0), cost=1.5, recording=other)
    assert held[(TIME > 2.1) & (TIME < 2.5)] == pytest.approx(1.5, rel=0.01)
    assert held[TIME >= 2.5] == pytest.approx(0.0, abs=1e-6)


def test_the_sign_of_friction_may_turn_up_to_sixteen_times_as_fast_octave_by_octave():
    slow = 0.02  # rad/s, of 0.05 below which the sign fades out
    *turns, _ = dry(slow)
    for turn, times in zip(turns, (1.0, 2.0, 4.0, 8.0), strict=True):
        faster, now = (np.tanh(n * slow / 0.05) for n in (2.0 * times, times))
        assert turn == pytest.approx(0.5 * 2.0 * (faster - now) * slow)
    # By shares of 1, not of 0.5, they make the sign of 2 N·m turn 16 times as fast.
    assert 2.0 * sum(turns) == pytest.approx(2.0 * (np.tanh(6.4) - np.tanh(0.4)) * slow)
    assert dry(1.0)[0] == pytest.approx(0.0, abs=1e-9)


def test_friction_that_changes_over_time_departs_by_a_tenth_of_its_power():
    found = of('viscous_friction', 2.0)
    over_time = 2 * (TIME - TIME.mean()) / np.ptp(TIME)  # −1 to 1
    # Speed, load, direction, quadrant and time are its forms, in this order.
    own = of_cause(found, 'departures of viscous', 4)
    assert own == pytest.approx(0.1 * 2.0 * SPEED**2 * over_time)


def test_departures_grow_with_the_coefficients():
    once, twice = (of('viscous_friction', own) for own in (1.0, 2.0))
    first = once.causes.index('departures of viscous')
    assert twice.formed[:, first:] == pytest.approx(2.0 * once.formed[:, first:])
    assert twice.formed[:, :first] == pytest.approx(once.formed[:, :first])  # of the shaft


def test_friction_departs_by_the_power_that_it_costs_at_the_motor():
    at_rest, at_cost = (of('viscous_friction', 2.0, cost) for cost in (0.0, 1.5))
    before, after = (of_cause(one, 'departures of viscous', 4) for one in (at_rest, at_cost))
    # Friction b·w acts as b·w·(w + dP/dτ).
    assert after == pytest.approx(before * (SPEED + 1.5) / SPEED)


def test_copper_loss_bends_by_the_load_alone_and_a_sensor_by_its_torque():
    found = of('copper_loss', 0.5)
    causes = np.array(found.bent_causes)
    copper = found.bent[:, causes == 'departures of copper'] / (0.5 * TORQUE[:, None] ** 2)
    assert np.ptp(copper, axis=0) == pytest.approx(0.0, abs=1e-12)  # the load is 1 N·m throughout
    shaft = found.bent[:, causes == 'departures of shaft'] / (TORQUE * SPEED)[:, None]
    assert np.ptp(shaft[:200], axis=0) == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(shaft, axis=0).max() > 1e-3  # it is another line to the other side
