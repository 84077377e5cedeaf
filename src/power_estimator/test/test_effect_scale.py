from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.model_file.model import FittedValue
from power_estimator.effects.model_file.yaml_file import read_model, write_model
from power_estimator.effects.signals.prepared import prepare
from power_estimator.effects.signals.scale import REFERENCE, DriveScale
from power_estimator.effects.training import fit_model, material
from power_estimator.posterior.intervals import posterior_draws
from power_estimator.posterior.judged import judged_effects
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

CATALOGUE = builtin_catalogue()
RATE = 400.0


def turning(
    torque=1.0, speed=1.0, *, copper=0.02, friction=0.0, idle=0.0, volts=48.0, seconds=60.0, seed=3
):
    """
    One drive that turns on, to and fro, below `torque` N·m and `speed` rad/s.

    Its power is torque·speed + copper·torque² + friction·|speed| + idle with 0.2 % noise.
    """
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    waves = 2 * np.pi * random.uniform(0.2, 2.5, 8) * time[:, None]
    velocity = 0.5 * speed + 0.5 * speed * np.sin(waves[:, :4]).mean(axis=1) * 2
    load = torque * np.sin(waves[:, 4:] + 1.0).mean(axis=1) * 2
    power = load * velocity + copper * load**2 + friction * np.abs(velocity) + idle
    noise = 2e-3 * np.abs(power).max() * random.normal(size=len(time))
    return AlignedDataset.blank(
        RATE,
        ('WHEEL',),
        time,
        'made',
        position=(np.cumsum(velocity) / RATE)[:, None],
        velocity=velocity[:, None],
        torque=load[:, None],
        power=(power + noise)[:, None],
        voltage=volts,
    )


def fitted(data, *effects):
    actives = [Active.of(CATALOGUE[name]) for name in effects]
    model, _ = fit_model('made', material(data), actives, CATALOGUE)
    return model


def test_a_unit_is_scaled_by_what_it_is_made_of():
    scale = DriveScale.stack([(2.0, 3.0, 6.0, 0.5, 1.0)])
    by_hand = {
        'W': 6.0,
        'N·m': 6.0 / 3.0,
        'N·m·s/rad': 6.0 / 3.0 / 3.0,
        'kg·m²': 6.0 / 3.0 / 3.0,
        'W/(N·m)²': 6.0 / 2.0**2,
        'W/((N·m)²·K)': 6.0 / 2.0**2,
        'W·s²/rad²': 6.0 / 3.0**2,
        'rad/(N·m)': 3.0 / 2.0,
        'A/min': 6.0 / 0.5,
        'ohm': 0.5**2 / 6.0,
        's': 1.0,
        '1': 1.0,
    }
    for unit, factor in by_hand.items():
        assert scale.factor(unit) == pytest.approx([factor]), unit


@pytest.mark.parametrize('torque', [0.5, 15.0, 50.0])
@pytest.mark.parametrize('speed', [0.5, 8.0])
def test_drives_like_the_reference_drive_keep_its_bounds_loaded_or_not(torque, speed):
    data = turning(torque, speed, copper=0.02, friction=3.0, idle=8.0)
    assert prepare(data).signals.scale.of(0) == REFERENCE


@pytest.mark.parametrize(
    ('torque', 'speed', 'copper'),
    [(0.3, 120.0, 220.0), (2.0, 5.0, 1.5), (400.0, 3.0, 4e-4), (0.02, 600.0, 4e4)],
    ids=['bare motor', 'gripper', 'joint of 2 kW', 'micro motor'],
)
def test_copper_loss_of_any_size_is_found_again_inside_its_bounds(torque, speed, copper):
    data = turning(torque, speed, copper=copper, idle=0.05 * torque * speed)
    model = fitted(data, 'shaft', 'copper_loss', 'idle')
    (found,) = model.groups[0].coefficients['copper_loss']
    assert found.value == pytest.approx(copper, rel=0.05)
    assert found.at_bound == ''
    assert model.at_bound == ()


def test_friction_of_a_mount_that_turns_at_0_02_rad_per_s_is_found_again_beside_its_copper_loss():
    """Its gear takes most of the power, so that the fit takes more steps than of other drives."""
    data = turning(60.0, 0.04, copper=0.0)
    friction = 33.0 * np.sign(data.velocity) + 250.0 * data.velocity
    motor = data.torque + friction
    noise = np.random.default_rng(0).normal(0.0, 0.02, motor.shape)
    power = motor * data.velocity + 0.005 * np.square(motor) + 4.0 + noise
    data = replace(data, power=power.astype(np.float32))
    model = fitted(data, 'shaft', 'copper_loss', 'coulomb_friction', 'viscous_friction', 'idle')
    own = {name: found[0] for name, found in model.groups[0].coefficients.items()}
    expected = {
        'copper_loss': 0.005,
        'coulomb_friction': 33.0,
        'viscous_friction': 250.0,
        'idle': 4.0,
    }
    assert {name: own[name].value for name in expected} == pytest.approx(expected, rel=0.1)


def test_a_shaft_that_is_held_still_has_no_scale_of_speed():
    data = turning(15.0, 0.04)
    noise = np.random.default_rng(0).normal(0.0, 0.01, data.velocity.shape)
    top = np.quantile(np.abs(data.velocity), 0.99)
    assert prepare(data).signals.scale.of(0)[1] == pytest.approx(top / 8.0, rel=1e-3)
    held = replace(data, velocity=noise.astype(np.float32))
    assert prepare(held).signals.scale.of(0) == REFERENCE
    sway = 0.01 * np.sin(2 * np.pi * data.time)[:, None]  # 1.6 mrad to either side
    held = replace(data, velocity=sway.astype(np.float32))
    assert prepare(held).signals.scale.of(0) == REFERENCE


@pytest.mark.parametrize('noise', [0.0, 0.001, 0.003])
def test_a_slow_drive_has_a_scale_of_speed_whatever_the_noise_of_its_speed(noise):
    data = turning(15.0, 0.04)
    more = np.random.default_rng(0).normal(0.0, noise, data.velocity.shape)
    noisy = replace(data, velocity=(data.velocity + more).astype(np.float32))
    assert prepare(noisy).signals.scale.of(0)[1] == pytest.approx(0.0061, rel=0.1)


def test_a_coefficient_at_its_bound_is_marked_and_stays_so_in_the_file(tmp_path):
    data = turning(20.0, 6.0, copper=3.0)  # copper of a hundred drives, with a shaft of one
    data = replace(data, power=data.torque * data.velocity + np.float32(20.0))
    model = fitted(data, 'shaft', 'copper_loss', 'idle')
    assert model.at_bound == ('WHEEL copper_loss k (lower)',)
    write_model(model, tmp_path / 'm.yaml')
    assert read_model(tmp_path / 'm.yaml', CATALOGUE).at_bound == model.at_bound


def test_heating_of_a_winding_that_loses_nothing_is_stranded():
    model = fitted(turning(20.0, 6.0, idle=5.0), 'shaft', 'copper_loss', 'winding_heating', 'idle')

    def with_copper(value, bound):
        own = model.groups[0].coefficients
        heat = tuple(FittedValue(0.1, (0.0, 0.2)) for _ in own['winding_heating'])
        copper = (FittedValue(value, (0.0, 0.1), bound),)
        changed = {**own, 'copper_loss': copper, 'winding_heating': heat}
        return replace(model, groups=(replace(model.groups[0], coefficients=changed),))

    assert with_copper(0.0, 'lower').stranded == (('WHEEL', 'winding_heating', 'copper_loss'),)
    assert with_copper(0.02, '').stranded == ()


def test_an_error_of_the_measurement_at_its_bound_is_marked_too(tmp_path):
    model = fitted(turning(20.0, 6.0, copper=0.02, idle=5.0), 'shaft', 'copper_loss', 'idle')
    measurement = {
        'power_gain': FittedValue(0.04, (0.03, 0.04), 'upper'),
        'current_offset': FittedValue(0.0, (-0.01, 0.01)),
    }
    model = replace(model, groups=(replace(model.groups[0], measurement=measurement),))
    assert model.at_bound == ('WHEEL power_gain (upper)',)
    write_model(model, tmp_path / 'm.yaml')
    assert read_model(tmp_path / 'm.yaml', CATALOGUE).at_bound == model.at_bound


def test_a_torque_sensor_that_reads_low_is_drawn_as_more_torque_with_the_coefficients():
    data = turning(20.0, 6.0, copper=0.02, idle=5.0)
    low = replace(data, torque=(0.9 * data.torque).astype(np.float32))
    model = fitted(low, 'shaft', 'copper_loss', 'idle')
    prepared = material(low).prepared
    drawn, scale = posterior_draws(model, prepared, 200)
    assert drawn.shape == (200, 1, 2)
    assert scale.shape == (200, 1)
    assert (drawn >= 0.0).all()
    assert scale.mean() > 0.05  # of 0.11, against a spread of 0.1 beforehand
    idle = drawn[:, 0, 1]
    assert np.quantile(idle, 0.05) < 5.0 < np.quantile(idle, 0.95)


def test_drives_that_share_coefficients_share_them_in_each_draw():
    pair = [turning(20.0, 6.0, copper=0.02, idle=5.0, seed=seed) for seed in (3, 4)]
    joined = replace(
        pair[0],
        names=('LF_KNEE', 'RF_KNEE'),
        **{
            name: np.concatenate([getattr(one, name) for one in pair], axis=1)
            for name in ('position', 'velocity', 'torque', 'command', 'power', 'voltage')
        },
        current=np.concatenate([one.current for one in pair], axis=1),
        temperature=np.concatenate([one.temperature for one in pair], axis=1),
    )
    model = fitted(joined, 'shaft', 'copper_loss', 'idle')
    prepared = material(joined).prepared
    drawn, scale = posterior_draws(model, prepared, 50)
    assert len(model.groups) == 1
    assert (drawn[:, 0] == drawn[:, 1]).all()
    assert (scale[:, 0] == scale[:, 1]).all()
    assert len(np.unique(drawn[:, 0, 0])) > 25


def test_a_model_without_coefficients_has_draws_of_the_torque_alone():
    data = turning(20.0, 6.0, idle=0.0)
    model = fitted(data, 'shaft')
    drawn, scale = posterior_draws(model, material(data).prepared, 30)
    assert drawn.shape == (30, 1, 0)
    assert np.isfinite(scale).all()


def test_a_model_keeps_the_scale_of_its_drives(tmp_path):
    data = turning(0.3, 120.0, copper=220.0, friction=0.02)
    model = fitted(data, 'shaft', 'copper_loss', 'coulomb_friction')
    write_model(model, tmp_path / 'm.yaml')
    again = read_model(tmp_path / 'm.yaml', CATALOGUE)
    assert again.groups[0].scale == pytest.approx(model.groups[0].scale, rel=1e-5)
    assert again.predict(data) == pytest.approx(model.predict(data), rel=1e-3, abs=1e-3)


def test_torque_of_the_motor_has_friction_in_it():
    data = replace(turning(20.0, 6.0), motor_torque=frozenset({'WHEEL'}))
    with pytest.raises(InputError, match=r"coulomb_friction: the torque of WHEEL is the motor's"):
        fitted(data, 'shaft', 'copper_loss', 'coulomb_friction')
    assert fitted(data, 'shaft', 'copper_loss').effects == ('shaft', 'copper_loss')


def test_a_current_in_place_of_the_torque_gives_the_torque_constant():
    data = turning(20.0, 6.0, copper=0.02, idle=5.0)
    in_amperes = replace(
        data,
        torque=data.torque / np.float32(2.5),
        motor_torque=frozenset({'WHEEL'}),
        current_as_torque=frozenset({'WHEEL'}),
    )
    model = fitted(in_amperes, 'shaft', 'copper_loss', 'idle')
    assert model.groups[0].torque_constant == pytest.approx(2.5, rel=0.01)
    assert model.groups[0].coefficients['copper_loss'][0].value == pytest.approx(0.02, rel=0.05)
    assert np.abs(model.predict(in_amperes) - data.power).mean() < 1.0
    plain = fitted(data, 'shaft', 'copper_loss', 'idle')
    with pytest.raises(InputError, match='WHEEL has a current for torque'):
        plain.predict(in_amperes)


def test_a_drive_without_position_is_judged_on_its_velocity():
    data = turning(20.0, 6.0, copper=0.02)
    blind = replace(data, position=np.full_like(data.position, np.nan))
    model = fitted(blind, 'shaft', 'copper_loss')
    assert model.groups[0].coefficients['copper_loss'][0].value == pytest.approx(0.02, rel=0.05)
    assert not CATALOGUE['cogging'].usable(prepare(blind).signals)


def test_the_noise_of_a_stalled_drives_encoder_is_no_rate_of_its_velocity():
    data = turning(20.0, 6.0, copper=0.02, idle=5.0)
    random = np.random.default_rng(0)
    still = random.normal(0.0, 2e-4, data.position.shape)
    stalled = replace(
        data,
        position=np.float32(1.0 + still),
        velocity=np.float32(random.normal(0.0, 0.1, still.shape)),
        power=np.float32(0.02 * data.torque.astype(float) ** 2 + 5.0),
    )
    model = fitted(stalled, 'shaft', 'copper_loss', 'idle')
    assert model.groups[0].coefficients['copper_loss'][0].value == pytest.approx(0.02, rel=0.1)


def test_a_flywheel_that_hardly_loads_its_motor_is_as_large_as_its_power():
    scale = material(turning(torque=0.2, speed=600.0, copper=40.0, idle=4.0)).prepared.scale
    # Its largest torque is some 0.3 N·m; 40 N·m at 600 rad/s would be 24 kW.
    assert scale.torque == pytest.approx(0.3 / 40.0, rel=0.5)
    assert scale.power * 320.0 < 500.0  # W


def test_drag_in_proportion_to_speed_is_friction_or_iron_loss_and_one_of_them_is_missing():
    """The copper loss of friction's torque tells them apart, and is 2 % of the drag here."""
    data = turning(6.0, 8.0, copper=0.002, idle=5.0)
    data = replace(data, power=data.power + np.float32(0.5) * np.square(data.velocity))
    given = material(data, per='drive')
    known = [Active.of(CATALOGUE[name]) for name in ('shaft', 'copper_loss', 'idle')]
    found = judged_effects(given.prepared, given.structure(known).actives, CATALOGUE)
    assert found.named == ()
    (both,) = found.undecided
    assert set(both.names) == {'viscous_friction', 'iron_loss'}
    assert both.probability > 0.95
    assert both.probability == pytest.approx(sum(found.probability[n] for n in both.names))
