import pickle
import textwrap
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from power_estimator.effects import Effect, Signals, Term, builtin_catalogue, load_catalogue
from power_estimator.effects.catalogue import regressors_of
from power_estimator.effects.fit.design import Active, Structure, evaluate
from power_estimator.effects.fit.per_recording import per_recording
from power_estimator.effects.fit.whole_robot import drive_share, shared_by_size
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.signals.state import OtherDrives
from wattwalk_core.errors import InputError

CATALOGUE = builtin_catalogue()
CONTRACT = {
    *('shaft', 'copper_loss', 'winding_heating', 'viscous_friction', 'coulomb_friction'),
    *('stribeck_friction', 'load_friction', 'iron_loss', 'inverter_loss', 'idle'),
    *('regeneration_efficiency', 'regeneration_limit', 'field_weakening', 'rotor_inertia'),
    *('spring', 'cogging', 'line_resistance', 'time_offset', 'power_gain', 'current_offset'),
    *('torque_bias', 'velocity_lag'),
}


def signals(torque=10.0, velocity=2.0, *, count=400, voltage=48.0, acceleration=0.0):
    def full(value):
        return np.full((count, 1), float(value))

    return Signals(
        rate=400.0,
        names=('LF_KFE',),
        time=np.arange(count) / 400.0,
        segment=np.zeros(count, np.int32),
        recording=np.zeros(count, np.int32),
        position=full(0.0),
        velocity=full(velocity),
        acceleration=full(acceleration),
        torque=full(torque),
        torque_rate=full(0.0),
        voltage=full(voltage),
        temperature=full(np.nan),
        motor_velocity=full(velocity),
        motor_acceleration=full(acceleration),
        motor_torque=full(torque),
        torque_cost=full(0.0),
        electronics=full(0.0),
        drawn=full(torque * velocity),
        scale=DriveScale.reference(1),
        at_motor=np.zeros(1, dtype=bool),
    )


def watts(coefficients, given):
    structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in coefficients))
    values = [
        float(value)
        for active in structure.free
        for value in np.atleast_1d(coefficients[active.name])
    ]
    return evaluate(structure, np.array([values]), given)[-1, 0]


def test_every_name_of_the_contract_is_there():
    assert set(CATALOGUE) >= CONTRACT


@pytest.mark.parametrize('name', list(CATALOGUE))
def test_an_effect_says_all_about_itself_and_returns_what_it_promises(name):
    effect = CATALOGUE[name]
    assert effect.physics
    assert effect.formula
    assert effect.excitation.text
    assert '\n' not in effect.physics
    for term in effect.terms:
        assert term.symbol
        assert term.unit
        assert term.lower <= term.upper
    for shape in effect.shapes:
        columns = regressors_of(effect, signals(), shape)
        assert columns.shape == (400, 1, len(effect.terms))
    assert set(effect.ties) <= {'inverter_resistance'}
    assert set(effect.near) <= set(CATALOGUE)


def test_nobody_changes_a_catalogue():
    for change in ('__setitem__', '__delitem__', 'pop', 'update', 'clear', 'setdefault'):
        assert not hasattr(builtin_catalogue(), change)


def test_shaft_power_is_torque_times_speed():
    assert watts({'shaft': 1.0}, signals(10.0, 2.0)) == pytest.approx(20.0)
    assert watts({'shaft': 1.0}, signals(10.0, -2.0)) == pytest.approx(-20.0)


def test_viscous_friction_costs_its_square_and_heats_the_winding_as_well():
    # f = 5·2 = 10 N·m: 20 W of friction, and copper grows from .02·100 to .02·400
    only = watts({'viscous_friction': 5.0}, signals(10.0, 2.0))
    both = watts({'copper_loss': 0.02, 'viscous_friction': 5.0}, signals(10.0, 2.0))
    assert only == pytest.approx(20.0)
    assert both == pytest.approx(20.0 + 0.02 * 400.0)


def test_coulomb_friction_helps_a_motor_that_brakes():
    # braking at −2 rad/s: the motor carries 10 − 3 N·m
    found = watts({'copper_loss': 0.02, 'coulomb_friction': 3.0}, signals(10.0, -2.0))
    assert found == pytest.approx(3.0 * 2.0 + 0.02 * 49.0)


@pytest.mark.parametrize('name', ['coulomb_friction', 'load_friction', 'iron_loss'])
def test_noise_of_a_speed_at_rest_is_no_motion_to_friction_nor_to_iron(name):
    noisy = signals(10.0, 0.5)
    at_rest = replace(noisy, velocity_noise=noisy.velocity)
    of = partial(regressors_of, CATALOGUE[name], shape={})
    assert not of(at_rest).any()
    assert of(replace(noisy, velocity_noise=0.2 * noisy.velocity)) == pytest.approx(
        of(signals(10.0, 0.4))
    )


def test_a_torque_constant_that_saturates_costs_the_fourth_power_of_a_torque_at_the_joint():
    # 10⁴ · 1e-4 = 1 W; friction of 5·2 = 10 N·m doubles the torque: 16 W, and 20 W of its own
    assert watts({'saturation': 1e-4}, signals(10.0, 2.0)) == pytest.approx(1.0)
    both = watts({'saturation': 1e-4, 'viscous_friction': 5.0}, signals(10.0, 2.0))
    assert both == pytest.approx(16.0 + 20.0)


def test_a_motor_that_saturates_makes_less_torque_than_its_current_says():
    # a thousandth per (N·m)² of 10 N·m: a tenth of 20 W; its winding's current is as measured
    motor = replace(signals(10.0, 2.0), at_motor=np.ones(1, dtype=bool))
    assert watts({'motor_saturation': 1e-3}, motor) == pytest.approx(-2.0)
    assert watts({'saturation': 1e-4}, motor) == 0.0


def test_warm_magnets_make_less_torque_than_a_motors_current_says():
    # 50 K over 25 °C at 0.001/K: a twentieth of 20 W
    warm = replace(
        signals(10.0, 2.0),
        temperature=np.linspace(70.0, 75.0, 400)[:, None],
        at_motor=np.ones(1, dtype=bool),
    )
    assert watts({'magnet_heating': 1e-3}, warm) == pytest.approx(-1.0)
    effect = CATALOGUE['magnet_heating']
    assert effect.usable(warm)
    assert not effect.usable(replace(warm, at_motor=np.zeros(1, dtype=bool)))
    assert not effect.usable(replace(warm, temperature=np.full((400, 1), 70.0)))


def test_rotor_inertia_takes_torque_that_no_sensor_sees():
    found = watts(
        {'copper_loss': 0.02, 'rotor_inertia': 0.07}, signals(10.0, 2.0, acceleration=50.0)
    )
    assert found == pytest.approx(3.5 * 2.0 + 0.02 * 13.5**2)


def test_blocked_regeneration_never_draws_less_than_nothing():
    given = signals(-20.0, 2.0)
    assert watts({'shaft': 1.0}, given) == pytest.approx(-40.0)
    assert watts({'shaft': 1.0, 'regeneration_limit': 1.0}, given) == pytest.approx(0.0)
    assert watts({'shaft': 1.0, 'regeneration_efficiency': 0.25}, given) == pytest.approx(-30.0)


def test_a_drive_alone_loses_its_share_of_what_the_bus_blocks():
    # −40 W here and −20 W elsewhere, of which a third drive takes 30 W: 30 of 60 W are blocked.
    others = OtherDrives.of(np.full((400, 2), [-20.0, 30.0]))
    given = replace(signals(-20.0, 2.0), others=others)
    assert watts({'shaft': 1.0, 'regeneration_limit': 1.0}, given) == pytest.approx(-20.0)


def test_diodes_in_front_of_each_drive_block_all_that_it_returns():
    # −40 W here, of which the other drive would take 30 W.
    drawn = np.tile([-40.0, 30.0], (400, 1))
    two = replace(signals(-20.0, 2.0), drawn=drawn, torque=drawn / 2.0)
    effect = CATALOGUE['regeneration_limit']
    assert effect.regressors(two)[-1, :, 0] == pytest.approx([10.0, 0.0])
    assert effect.regressors(two, supply=0.0)[-1, :, 0] == pytest.approx([40.0, 0.0])
    assert effect.drawn_slope(two, np.ones((1, 1)), supply=0.0)[-1] == pytest.approx([-1.0, 0.0])
    assert effect.usable(two, supply=0.0)
    for other in (replace(two, one_meter=True), signals(-20.0, 2.0)):
        assert not effect.usable(other, supply=0.0)


def test_a_supply_loses_of_what_the_drives_of_its_meter_return_together():
    # −40 W and 30 W: 10 W come back, by the drive that brakes.
    drawn = np.tile([-40.0, 30.0], (400, 1))
    two = replace(signals(-20.0, 2.0), drawn=drawn, torque=drawn / 2.0, one_meter=True)
    effect = CATALOGUE['regeneration_efficiency']
    assert effect.regressors(two, supply=1.0)[-1, :, 0] == pytest.approx([10.0, 0.0])
    assert effect.usable(two, supply=1.0)
    for other in (replace(two, one_meter=False), replace(signals(-20.0, 2.0), one_meter=True)):
        assert not effect.usable(other, supply=1.0)
        assert effect.usable(other, bridge=1.0)


def test_power_beside_one_drive_is_that_of_all_others():
    beside = OtherDrives.of(np.array([[-20.0, 30.0, -5.0]])).beside(np.array([[-5.0]]))
    assert (beside.returned, beside.drawn) == (20.0, 10.0)


def test_line_resistance_sees_the_power_that_all_others_draw():
    # 48 W at 48 V is 1 A
    found = watts({'shaft': 1.0, 'idle': 28.0, 'line_resistance': 0.5}, signals(10.0, 2.0))
    assert found == pytest.approx(48.0 + 0.5)


def test_a_warming_winding_costs_more_as_time_passes():
    effect = CATALOGUE['winding_heating']
    columns = effect.regressors(signals(10.0, 0.0, count=40_000), time_constant=20.0)
    assert columns[0, 0, 0] < 0.01 * columns[-1, 0, 0]
    # after 100 s of 20 s the rise is all there: 100 (N·m)² of heat, times 0.0039, times torque²
    assert columns[-1, 0, 0] == pytest.approx(100.0 * 0.0039 * 100.0, rel=0.01)


def test_the_measured_temperature_counts_only_where_it_moved():
    effect = CATALOGUE['winding_heating']
    assert not effect.usable(signals(), time_constant=0.0)
    assert effect.usable(signals(), time_constant=20.0)


def test_an_effect_of_a_whole_robot_is_near_what_it_is_near_in_a_drive():
    heating = shared_by_size(CATALOGUE['winding_heating'], signals())
    assert heating.near == CATALOGUE['winding_heating'].near


def write(tmp_path, body):
    path = tmp_path / 'mine.py'
    path.write_text(textwrap.dedent(body))
    return path


GOOD = """
    import numpy as np
    from power_estimator.effects import Effect, Term

    class Fan(Effect):
        name = 'fan'
        physics = 'a fan that turns with the joint'
        formula = 'f·|w|³'
        terms = (Term('f', 'W·s³/rad³', 0.0, 10.0),)

        def regressors(self, signals, **shape):
            return np.abs(signals.velocity)[..., None] ** 3
    """


DATA = """
    from dataclasses import replace

    import numpy as np
    from power_estimator.effects import Effect, Term
    from power_estimator.effects.library.friction import VISCOUS_FRICTION

    FAN = Effect(
        name='fan',
        physics='a fan that turns with the joint',
        formula='f·|w|³',
        terms=(Term('f', 'W·s³/rad³', 0.0, 10.0),),
        regressors=lambda signals, **shape: np.abs(signals.velocity)[..., None] ** 3,
    )
    GREASE = replace(VISCOUS_FRICTION, name='grease')
    """


def test_an_effect_derived_from_another_says_itself_that_it_needs_its_own_drive_alone():
    class Alone(Effect):
        name = physics = formula = 'alone'
        terms = (Term('c', 'W'),)
        per_drive = True

        def regressors(self, signals, **shape):
            return np.ones((*signals.torque.shape, 1))

    class Neighbours(Alone):
        """Looks at other drives than the effect that it derives from."""

    assert Alone().per_drive
    assert not Neighbours().per_drive


def test_a_class_states_an_effect_by_its_attributes_and_methods():
    class Rub(Effect):
        name = physics = formula = 'rub'
        terms = (Term('c', 'N·m'),)
        acts_on = 'torque'
        needs_joint_torque = True
        shapes = ({'order': 1.0}, {'order': 2.0})

        def regressors(self, signals, *, order=1.0, **_):
            return signals.velocity[..., None] ** order

        def usable(self, signals, **shape):
            return super().usable(signals) and shape['order'] < 2.0

        def factors(self, scale):
            return 3.0 * super().factors(scale)

    rub, given = Rub(), signals(velocity=2.0)
    assert type(rub) is Effect
    assert rub.regressors(given, order=3.0)[0, 0, 0] == 8.0
    assert [rub.usable(given, **shape) for shape in rub.shapes] == [True, False]
    assert not rub.usable(replace(given, at_motor=np.ones(1, dtype=bool)), order=1.0)
    assert rub.factors(given.scale).tolist() == [[3.0]]


def test_a_user_states_effects_as_data_or_as_changes_of_shipped_ones(tmp_path):
    catalogue = load_catalogue([write(tmp_path, DATA)])
    assert set(catalogue) - set(CATALOGUE) == {'fan', 'grease'}
    assert regressors_of(catalogue['fan'], signals(velocity=2.0), {})[0, 0, 0] == 8.0
    assert catalogue['grease'].near == CATALOGUE['viscous_friction'].near


@pytest.mark.parametrize('form', ['class', 'data'])
def test_effects_reach_other_processes_without_their_functions(tmp_path, form):
    path = write(tmp_path, GOOD if form == 'class' else DATA)
    given = signals(velocity=2.0)
    share = np.array([[3.0]])
    for effect in (load_catalogue([path])['fan'], CATALOGUE['viscous_friction']):
        for variant in (effect, drive_share(effect, 'own', share), per_recording(effect, 1)):
            again = pickle.loads(pickle.dumps(variant))
            assert again == variant
            assert np.array_equal(again.regressors(given), variant.regressors(given))


def test_an_effect_that_no_file_defines_stays_in_its_process():
    with pytest.raises(TypeError, match="'lone' is in no catalogue"):
        pickle.dumps(replace(CATALOGUE['idle'], name='lone'))


def test_a_user_adds_an_effect_by_one_file(tmp_path):
    path = write(tmp_path, GOOD)
    catalogue = load_catalogue([path])
    assert regressors_of(catalogue['fan'], signals(velocity=2.0), {})[0, 0, 0] == 8.0
    assert catalogue.origins['fan'] == path


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (("name = 'fan'", "name = 'idle'"), "'idle' exists already"),
        (("physics = 'a fan that turns with the joint'", ''), "no 'physics'"),
        (('def regressors', 'def other'), 'no method regressors'),
        (('Effect, Term', 'Effect, Trem'), 'ImportError'),
        (("Term('f', 'W·s³/rad³', 0.0, 10.0)", "Term('f', '', 0.0, 10.0)"), 'Term(symbol, unit'),
        (('class Fan(Effect)', 'class Fan'), 'defines no Effect'),
        (('import numpy as np', 'import numpy as np ('), 'SyntaxError'),
        (('import numpy as np', 'raise SystemExit(0)'), 'SystemExit'),
        (("name = 'fan'", "name = 'f\x1b[31m'"), 'name is letters, digits'),
        (('terms = (', 'terms = 5 #('), 'TypeError'),
        (('0.0, 10.0)', '0.0, float("nan"))'), 'Term(symbol, unit'),
    ],
)
def test_an_incomplete_user_effect_is_refused_with_its_file(tmp_path, change, words):
    path = write(tmp_path, GOOD.replace(*change))
    with pytest.raises(InputError, match=r'mine\.py') as caught:
        load_catalogue([path])
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ('signals.velocity[..., None] * float("nan")', 'NaN'),
        ('signals.velocity', 'shape'),
        ('signals.wind', 'raised AttributeError'),
        ('1 / 0', 'raised ZeroDivisionError'),
    ],
)
def test_a_user_effect_that_misbehaves_is_named(tmp_path, body, words):
    path = write(tmp_path, GOOD.replace('np.abs(signals.velocity)[..., None] ** 3', body))
    effect = load_catalogue([path])['fan']
    with pytest.raises(InputError, match='fan') as caught:
        regressors_of(effect, signals(), {})
    assert words in str(caught.value)


def test_a_file_of_effects_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r'nowhere\.py: No such file'):
        load_catalogue([tmp_path / 'nowhere.py'])


def test_cogging_is_looked_for_where_the_motion_covers_a_period():
    swing = 0.3 * np.sin(np.arange(400) / 20.0)[:, None]  # 0.6 rad; a period of order 12 is 0.52
    given = replace(signals(), position=swing)
    cogging = CATALOGUE['cogging']
    assert cogging.usable(given, order=12.0)
    assert not cogging.usable(given, order=6.0)
    assert cogging.usable(given)  # in some shape
