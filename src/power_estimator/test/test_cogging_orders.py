"""Orders of cogging that are found in what a model leaves."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.candidate_screener import shaped
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.fit.orders import (
    ErrorsByPosition,
    Orders,
    errors_by_position,
    orders_of,
)
from power_estimator.effects.signals.prepared import prepare
from power_estimator.posterior.judged import judged_effects
from truth_circuit import Truth, record

EFFECTS = builtin_catalogue()
KNOWN = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')
COPPER = 0.02  # W/(N·m)², of the truth's
TURN = 2 * np.pi


def errors(order, turns=1.0, rows=3000, noise=0.0, seed=0):
    """Errors that repeat so many times a turn, over positions in any order."""
    random = np.random.default_rng(seed)
    at = random.uniform(0.0, turns * TURN, rows)
    error = np.sin(order * at + 0.7) + noise * random.normal(size=rows)
    return ErrorsByPosition(at - at.min(), error, shows=np.full(rows, 200.0))


@pytest.mark.parametrize('order', [28, 13, 84, 151])
@pytest.mark.parametrize('turns', [0.5, 1.0, 7.0])
def test_the_order_of_a_drive_is_found_whatever_it_is(order, turns):
    assert orders_of([errors(order, turns)]).found[0] == order


def test_the_order_of_a_geared_joint_need_not_be_whole():
    (first, *_) = orders_of([errors(50.9 * 1.35, turns=3.0)]).found
    assert first == pytest.approx(50.9 * 1.35, abs=1 / 3.0 / 8)  # an eighth of what is told apart


def test_a_peak_near_a_whole_number_gives_both():
    found = orders_of([errors(28.3)]).found
    assert found[0] == 28.0
    assert found[1] == pytest.approx(28.3, abs=1 / 8)


def test_an_order_is_found_under_noise_of_four_times_its_size():
    assert orders_of([errors(28, noise=4.0)]).found[0] == 28


def test_drives_of_one_kind_show_their_order_together():
    drives = [errors(28, rows=300, noise=4.0, seed=seed) for seed in range(6)]
    assert orders_of(drives).found[0] == 28


def test_all_orders_count_that_the_position_tells_apart():
    # Over half a turn, orders differ by two: from 6 to 200 these are 97.
    assert orders_of([errors(28, turns=0.5)]).tried == pytest.approx(97, rel=0.01)


def test_less_than_two_periods_are_no_period():
    least = min(orders_of([errors(28, turns=0.25)]).found)
    assert least >= 2 / 0.25


@pytest.mark.parametrize('given', [[], [replace(errors(28), shows=np.full(3000, 3.0))]])
def test_without_motion_no_order_is_found(given):
    assert orders_of(given) == Orders()


@pytest.fixture(scope='module')
def ladder():
    """One drive at a ladder of speeds of up to 8 rad/s, without cogging."""
    truth = Truth(dict.fromkeys(KNOWN, 1.0), 'ladder', 60.0, 1)
    return prepare(record(truth).drives(['LF_KFE']))


def with_cogging(prepared, order, torque=3.0, copper=COPPER):
    s = prepared.signals
    extra = torque * np.sin(order * s.position) * (s.velocity + 2 * copper * s.torque)
    return replace(prepared, power=(prepared.power + prepared.reduced(extra)).astype(np.float32))


def found_by_position(prepared, order, seam=-np.inf):
    """Orders in an error that is cogging's own, of a model that lacks nothing else."""
    s = prepared.signals
    slope = prepared.reduced(s.velocity)
    error = prepared.reduced(np.sin(order * s.position) * s.velocity)[:, 0]
    rows = np.flatnonzero(np.abs(prepared.time - seam) > 0.5)
    error = error[rows]
    return orders_of(errors_by_position(prepared, rows, error, slope))


def test_orders_count_that_only_slow_motion_shows(ladder):
    # At the median of its speeds, 2.8 rad/s, 84 periods a turn pass with 37 Hz.
    assert found_by_position(ladder, 84).found[0] == 84


def test_recordings_that_begin_far_from_each_other_show_their_order(ladder):
    half = ladder.signals.time[len(ladder.signals.time) // 2]
    samples, rows = ladder.signals.time > half, ladder.time > half
    far = replace(ladder.signals, position=ladder.signals.position + 100.3 * samples[:, None])
    two = replace(ladder, signals=far, recording=rows.astype(np.int32))
    assert found_by_position(two, 28, half).found[0] == 28
    # Ten times as many orders would be told apart if the way between them counted.
    assert found_by_position(two, 28, half).tried < 4 * found_by_position(ladder, 28).tried


def test_a_drive_that_stands_has_no_order(ladder):
    shape = ladder.signals.position.shape
    jitter = 1e-4 * np.random.default_rng(0).normal(size=shape)
    still = replace(ladder.signals, position=jitter, velocity=0.01 * jitter)
    assert found_by_position(replace(ladder, signals=still), 28) == Orders()


def test_a_drive_without_positions_has_no_order(ladder):
    unknown = replace(ladder.signals, position=np.full_like(ladder.signals.position, np.nan))
    assert found_by_position(replace(ladder, signals=unknown), 28) == Orders()


def fitted_order(prepared, start):
    fitter = Fitter(prepared)
    actives = [Active.of(EFFECTS[name]) for name in ('shaft', *KNOWN)]
    structure = Structure((*actives, Active.of(EFFECTS['cogging'], {'order': start})))
    found = shaped(fitter, Folds.of(fitter.blocks, fitter.settings), structure)
    (shape,) = [active.parameters for active in found.actives if active.name == 'cogging']
    return shape['order']


@pytest.mark.parametrize('order', [28.0, 42.0, 84.0])
def test_a_fit_finds_the_order_of_its_cogging(ladder, order):
    assert fitted_order(with_cogging(ladder, order), 6.0) == order


def test_a_model_keeps_its_order_where_that_is_best(ladder):
    assert fitted_order(with_cogging(ladder, 30.3), 30.3) == 30.3


def test_missing_cogging_is_named_with_its_order(ladder):
    known = [Active.of(EFFECTS[name]) for name in ('shaft', *KNOWN)]
    judged = judged_effects(with_cogging(ladder, 28.0), known, EFFECTS)
    assert judged.candidates[0].active.key == ('cogging', (('order', 28.0),))
    assert judged.candidates[0].probability > 0.95


def test_cogging_is_found_behind_a_delay_of_the_meter(ladder):
    s = ladder.signals
    later = replace(s, position=np.roll(s.position, 6, axis=0))  # 15 ms at 400 Hz
    extra = 3.0 * np.sin(28.0 * later.position) * s.velocity
    power = ladder.power + ladder.reduced(extra)
    known = [Active.of(EFFECTS[name]) for name in ('shaft', *KNOWN)]
    judged = judged_effects(replace(ladder, power=power.astype(np.float32)), known, EFFECTS)
    assert judged.candidates[0].active.name == 'cogging'


def test_no_cogging_is_named_where_there_is_none(ladder):
    known = [Active.of(EFFECTS[name]) for name in ('shaft', *KNOWN)]
    judged = judged_effects(ladder, known, EFFECTS)
    assert judged.probability['cogging'] < 0.1
