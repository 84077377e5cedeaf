"""Errors that no effect explains, at figures that can be checked by hand."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.prepared import prepare
from power_estimator.effects.signals.reducer import Reducer
from power_estimator.posterior.meter import MeterProblem
from power_estimator.posterior.noise import RowErrors, learned_errors
from power_estimator.posterior.rates import with_quiet_rates
from power_estimator.posterior.stand_ins import Apart
from truth_circuit import Truth, record


def test_a_block_that_fits_badly_counts_less():
    """Of ten blocks with errors of ±1 W one has ±4 W: Student's t gives it 1/4 of the others'."""
    signs = np.tile([1.0, -1.0], 50)
    power = 10.0 + signs * np.where(np.arange(100) < 10, 4.0, 1.0)
    blocks = np.array_split(np.arange(100), 10)
    found = learned_errors(np.ones((100, 1)), np.array([1e3]), power, 1, blocks, least=1e-9)
    assert found.weights[:10] == pytest.approx(1 / 4, rel=1e-3)  # 5/(4 + 16) over 5/(4 + 1)
    assert found.weights[10:] == pytest.approx(1.0)
    assert found.variance == pytest.approx((0.9 * 1.0 + 0.1 * 16.0 / 4.0), rel=1e-3)


@pytest.mark.parametrize(
    ('errors', 'overlap', 'lasting'),
    [([2.0, 2.0, 2.0], 0.0, 4.0), ([2.0, 2.0, 2.0], 0.5, 4.0), ([2.0, 0.0, -2.0], 0.5, -4.0)],
)
def test_errors_last_that_are_those_of_the_next_row(errors, overlap, lasting):
    """Of errors of 4 W², white ones have overlap·4 W² in common with the next row's."""
    found = RowErrors(4.0, np.array(errors), np.ones(3), 1.0)
    assert found.lasting(np.array([0, 1, 2]), overlap) == pytest.approx(lasting)
    assert found.lasting(np.array([0, 2, 4]), overlap) == 4.0  # no two rows are neighbours


@pytest.mark.parametrize('rate', [400.0, 125.0, 80.0])
def test_white_noise_in_next_rows_has_the_correlation_of_the_low_pass(rate):
    reducer = Reducer(rate, (slice(0, 100_000),)).sparse()
    rows = reducer.reduce(np.random.default_rng(0).normal(size=100_000))
    assert np.corrcoef(rows[:-1], rows[1:])[0, 1] == pytest.approx(reducer.overlap, abs=0.03)


def test_evidence_counts_less_by_what_the_errors_scatter_along_an_effect():
    truth = Truth({'copper_loss': 1.0, 'idle': 1.0}, 'walk', 20.0, 1)
    prepared = prepare(record(truth).drives(['LF_KFE']))
    own = replace(prepared, signals=with_quiet_rates(prepared.signals))
    effects = builtin_catalogue()
    meter = MeterProblem(own, [Active.of(effects['shaft'])], None)
    actives = [Active.of(effects[name]) for name in ('copper_loss', 'idle')]
    columns = meter.columns(actives, {})
    meter.learn_noise(columns, ['copper_loss', 'idle'])
    noise = meter.noise
    assert noise is not None
    white = np.random.default_rng(0).normal(size=len(noise.rows)) / noise.root[:, 0]
    copper = columns.effects[noise.rows, 0]
    loud = np.where(copper > np.quantile(copper, 0.9), 3.0, 0.3)  # nearly as large together

    def ratio(errors):
        meter.noise = replace(noise, left=errors)
        squares, expected = meter.scatter(columns, slice(0, 1), np.ones(1))
        return squares / expected

    assert 0.5 < ratio(white) < 1.7
    assert ratio(loud * white) > 1.5 * ratio(white)


def test_log_odds_come_closer_to_those_before_by_the_scatter():
    one = np.ones(1)
    odds = Apart(4.0 * one, 2.0).odds(-1.0, 9.0, one)
    assert (odds.before, odds.after, odds.ratio) == (-1.0, 4.0, 4.0)
    assert Apart(4.0 * one, 2.0).odds(-1.0, -9.0, one).after == -9.0  # against it: whole


def moved(velocity):
    """Signals of a drive that moves at a velocity [8000] at 400 Hz."""
    own = prepare(record(Truth({'idle': 1.0}, 'walk', 20.0, 1)).drives(['LF_KFE'])).signals
    (part, *_) = own.stretches()
    count = part.stop - part.start
    signals = own.rows(np.arange(part.start, part.stop), np.zeros(count, np.int32))
    column = np.resize(velocity, count)[:, None]
    return with_quiet_rates(replace(signals, velocity=column, motor_velocity=column))


def test_at_rest_friction_sees_a_third_of_the_noise_of_a_speed_that_swings_slowly():
    time = np.arange(8000) / 400.0
    truth = np.where(
        time % 4.0 < 2.0, np.sin(np.pi * time) ** 2 * np.sign(np.sin(np.pi * time)), 0
    )
    noise = 0.05 * np.random.default_rng(0).normal(size=truth.shape)
    signals = moved(truth + noise)
    truth = truth[: len(signals.sliding)]
    rest = (time % 4.0 > 2.2)[: len(truth)] & (time % 4.0 < 3.8)[: len(truth)]
    assert np.std(signals.sliding[rest, 0]) < 0.05 / 3
    assert np.corrcoef(signals.sliding[:, 0], truth)[0, 1] > 0.995


def test_steps_of_a_speed_without_noise_are_left_as_they_are():
    ladder = np.repeat([0.0, 1.0, -0.5, 2.0, 0.0, -2.0, 0.5, 1.5], 1000)
    signals = moved(ladder)
    assert np.abs(signals.sliding - signals.velocity).max() < 0.02
