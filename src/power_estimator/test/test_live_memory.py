"""Live estimates are those of the whole recording, however far back a model looks."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.drive_types import DriveType
from power_estimator.effects import Effect, Excitation, Term, builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import DriveGroup, EffectModel, FittedValue
from power_estimator.live.estimator import LiveEstimator, Status, stream_of
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from power_estimator.scores import block_means
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
RATE = 400
NAMES = ('LF_HAA', 'LF_HFE')


def model(*effects, drives=NAMES, **given):
    """Coefficients of one for each effect, except those of the shaft, which physics fixes."""
    catalogue = builtin_catalogue()
    actives = [Active.of(catalogue['shaft'])]
    coefficients = {}
    for name, shape, *values in effects:
        actives.append(Active.of(catalogue[name], shape))
        coefficients[name] = tuple(FittedValue(v, (v, v)) for v in values)
    groups = tuple(DriveGroup(DriveType(d, (d,)), coefficients, {}) for d in drives)
    return EffectModel('own', Structure(tuple(actives)), groups, **given)


def walk(seconds, **signals):
    """Noisy torque around a load, and slower speed, at 400 Hz."""
    random = np.random.default_rng(0)
    time = np.arange(round(seconds * RATE)) / RATE
    torque = 20 + 15 * np.sin(9 * time[:, None] + [0, 1]) + random.normal(0, 5, (len(time), 2))
    velocity = 2 * np.sin(9 * time[:, None] + [1, 2])
    position = -2 / 9 * np.cos(9 * time[:, None] + [1, 2])
    return AlignedDataset.blank(
        RATE, NAMES, time, 'walk', torque=torque, velocity=velocity, position=position, **signals
    )


def play(live, data, *, every=1):
    """Estimates of the rows of data, one in so many; a gap where time jumps."""
    signals = (data.position, data.velocity, data.torque)
    found = []
    for row in range(0, len(data.time), every):
        if np.isfinite(data.temperature).any():
            live.supply(data.voltage[row].astype(float), data.temperature[row].astype(float))
        if np.isfinite(data.command).any():
            live.command(START + round(1e9 * data.time[row]), data.command[row].astype(float))
        stamp = START + round(1e9 * data.time[row])
        found.append(live.joint_state(stamp, *(s[row].astype(float) for s in signals)))
    return [estimate for estimate in found if estimate is not None]


def watts(found):
    return np.array([estimate.power for estimate in found])


def offline(given, data):
    return block_means(given.predict(data), data.segments(), 8)


def heating(seconds):
    return ('copper_loss', {}, 0.05), ('winding_heating', {'time_constant': seconds}, 0.05, 0.2)


@pytest.mark.parametrize(('seconds', 'piece'), [(330.0, 200), (20.0, 8)])
def test_a_winding_warms_piece_by_piece_as_it_does_in_the_whole(seconds, piece):
    heated, data = model(*heating(seconds / 5)), walk(seconds)
    stream = stream_of(heated, NAMES, RATE)
    pieces = [data.rows(slice(row, row + piece)) for row in range(0, len(data.time), piece)]
    found, expected = np.concatenate([stream.advance(p) for p in pieces]), heated.predict(data)
    assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()
    third = len(expected) // 3
    assert expected[-third:].mean() > 1.3 * expected[:third].mean()


def test_the_heat_at_the_start_of_the_recording_fitted_on_is_in_no_estimate():
    cold, data = ('copper_loss', {}, 0.05), walk(2.0)
    started_hot, started_cold = (
        model(cold, ('winding_heating', {'time_constant': 50.0}, 0.05, start))
        for start in (0.2, 0.0)
    )
    assert np.array_equal(started_hot.predict(data), started_cold.predict(data))


def test_a_winding_warms_live_as_it_does_offline():
    heated, data = model(*heating(6.0)), walk(20.0)
    found, expected = watts(play(LiveEstimator(heated, NAMES), data)), offline(heated, data)
    assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()


def test_a_gap_cools_the_winding_live_as_it_does_offline():
    heated, data = model(*heating(6.0)), walk(10.0)
    split = 4 * RATE
    late = np.arange(len(data.time)) >= split
    broken = replace(
        data, time=data.time + 3.0 * late, segment=data.segment + late.astype(np.int32)
    )
    live = LiveEstimator(heated, NAMES)
    found = watts(play(live, broken))
    assert np.allclose(found, offline(heated, broken), rtol=1e-3, atol=0.01)
    cold = offline(heated, data.rows(slice(split, None)))
    assert found[200:250].mean() > cold[:50].mean() + 5.0


def test_a_winding_warms_up_in_status_until_its_start_no_longer_matters():
    found = play(LiveEstimator(model(*heating(2.0)), NAMES), walk(8.0))
    known = [estimate.stamp for estimate in found if estimate.status is Status.OK]
    assert (known[0] - START) / 1e9 == pytest.approx(2.0 * np.log(20.0), abs=0.05)


def test_time_that_starts_anew_starts_the_winding_anew():
    heated, data = model(*heating(6.0)), walk(4.0)
    live = LiveEstimator(heated, NAMES)
    first = watts(play(live, data))
    again = replace(data, time=data.time - 3600.0)
    assert np.allclose(watts(play(live, again)), first, rtol=1e-6)


def test_a_measured_winding_temperature_is_used_and_needs_no_warm_up():
    data = walk(2.0, temperature=np.linspace(25.0, 125.0, 800)[:, None], voltage=48.0)
    measured = model(('copper_loss', {}, 0.05), ('winding_heating', {'time_constant': 0.0}, 1, 0))
    found = play(LiveEstimator(measured, NAMES), data)
    assert np.allclose(watts(found), offline(measured, data), rtol=1e-3, atol=0.01)
    assert found[1].status is Status.OK
    assert play(LiveEstimator(measured, NAMES), walk(1.0)) == []


@pytest.mark.parametrize('relaxation', [0.0, 0.003, 0.012])
def test_derivatives_and_springs_are_those_of_the_whole(relaxation):
    sprung = model(('rotor_inertia', {}, 0.05), ('spring', {'relaxation': relaxation}, 0.001))
    data = walk(4.0)
    smooth = replace(data, torque=20 + 15 * np.sin(9 * data.time[:, None] + [0, 1]))
    found, expected = watts(play(LiveEstimator(sprung, NAMES), smooth)), offline(sprung, smooth)
    assert np.abs(found - expected)[1:].max() < 0.01 * expected.std()


def test_products_are_formed_before_they_are_averaged():
    data = walk(1.0)
    torque = np.where(np.arange(400) % 2, 30.0, -30.0)[:, None] * np.ones(2)
    bursts = replace(data, torque=torque, velocity=0 * data.velocity)
    copper = model(('copper_loss', {}, 0.05))
    found = watts(play(LiveEstimator(copper, NAMES), bursts))
    assert np.allclose(found, 0.05 * 30.0**2)


def test_joint_states_at_200_hz_do_for_a_model_at_400_hz():
    copper, data = model(('copper_loss', {}, 0.05)), walk(2.0)
    smooth = replace(data, torque=20 + 15 * np.sin(9 * data.time[:, None] + [0, 1]))
    found = play(LiveEstimator(copper, NAMES), smooth, every=2)
    assert len(found) == 99
    assert np.allclose(watts(found)[:-1].mean(), offline(copper, smooth).mean(), rtol=0.01)


def test_effects_on_a_network_carry_both_memories(checkpoint):
    ppn = PowerPredictionNetwork(checkpoint)
    added = model(*heating(6.0), base='ppn:x', base_model=ppn)
    data = walk(10.0, command=0.01)
    found = play(LiveEstimator(added, NAMES), data)
    expected = offline(added, data)
    known = np.isfinite(expected)
    assert np.allclose(watts(found)[known], expected[known], rtol=1e-3, atol=0.02)


def test_an_effect_that_cannot_be_carried_is_refused_by_name():
    class Wear(Effect):
        name = physics = formula = 'wear'
        terms = (Term('c', 'W/rad'),)
        excitation = Excitation('none')

        def regressors(self, signals, **shape):
            return abs(signals.velocity).cumsum(axis=0)[..., None]

    worn = replace(model(), structure=Structure((Active(Wear()),)))
    with pytest.raises(InputError, match='own: wear follows all samples before, and cannot be'):
        LiveEstimator(worn, NAMES)


def test_a_proxy_that_has_to_be_scaled_is_refused_by_what_it_needs():
    with pytest.raises(InputError, match='torque_squared: its factor to watts needs power'):
        LiveEstimator(Proxy('torque_squared'), NAMES)


def test_parts_of_each_block_sum_to_the_power_and_are_those_of_the_whole():
    friction = ('coulomb_friction', {}, 3.0), ('regeneration_efficiency', {}, 0.3)
    given, data = model(*heating(5.0), *friction), walk(4.0)
    stream = stream_of(given, NAMES, RATE)
    whole = given.by_part(data)
    assert np.abs(sum(whole.values()) - given.predict(data)).max() < 1e-3
    for row in range(0, len(data.time), 8):
        power = stream.advance(data.rows(slice(row, row + 8))).mean(axis=0)
        assert sum(stream.parts.values()) == pytest.approx(power, rel=1e-5, abs=1e-3)
    last = {name: values[-8:].mean(axis=0) for name, values in whole.items()}
    for name, values in stream.parts.items():
        assert values == pytest.approx(last[name], rel=0.01, abs=0.05), name


def test_a_model_that_names_no_losses_has_the_shaft_and_the_rest():
    live = LiveEstimator(Proxy('mechanical_power'), NAMES)
    found = play(live, walk(1.0))[-1]
    assert {*found.parts} == {'shaft', 'losses'}
    assert sum(found.parts.values()) == pytest.approx(found.power, rel=1e-5)
