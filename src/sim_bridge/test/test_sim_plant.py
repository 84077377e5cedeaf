import numpy as np
import pytest
from sim_bridge.plant.parameters import PLANTS, Effects, Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError


@pytest.mark.parametrize('path', sorted(PLANTS.glob('*.yaml')), ids=lambda path: path.stem)
def test_shipped_plants_load_and_know_every_joint_of_the_robot(path):
    plant = Plant.load(path.stem)
    assert plant.name == path.stem
    assert plant.resolve(JOINT_NAMES)['resistance'].shape == (12,)


def test_a_saved_plant_loads_as_the_same_plant(tmp_path):
    plant = Plant.load('anymal_c').with_effects(fan=0.5, cogging=False).unit(7)
    plant.save(tmp_path / 'mine.yaml')
    assert Plant.load(tmp_path / 'mine.yaml') == plant


@pytest.mark.parametrize(
    ('text', 'quoted'),
    [
        (
            'drive_types: {KFE: {resistance: -1}}',
            r'KFE\.resistance: expected 0\.01 to 10 ohm, .* -1',
        ),
        (
            'drive_types: {KFE: {resistence: 1}}',
            "unknown key 'resistence'; there can be resistance",
        ),
        ('drive_types: {KFE: {resistance: warm}}', "'warm'"),
        ('drive_types: []', r'drive_types: .*there is \[\]'),
        ('effects: {gravity: true}', "effects: unknown key 'gravity'.*copper_loss"),
        ('effects: {idle: -2}', 'effects.idle.strength: expected 0 to 10, there is -2'),
        (
            'effects: {idle: {enabled: 3}}',
            'idle.enabled: expected true or false, there is 3',
        ),
        ('effects: {spring: true, rotor_inertia: false}', 'spring is on without rotor_inertia'),
        ('meter: {bits: 99}', 'meter.bits: expected a whole number from 6 to 24 bit, there is 99'),
        ('drive_types: {}', 'drive_types is empty'),
        ('supply: 48', 'supply: .* there is 48'),
        ('sensors: {ambient: .nan}', 'sensors.ambient: .* there is nan'),
        ('motor: {}', "unknown key 'motor'"),
        ('unit_number: -1', 'unit_number: .* there is -1'),
        ('[1, 2]', r'there is \[1, 2\]'),
        ('a: b: c', 'is no valid YAML'),
    ],
)
def test_a_wrong_plant_file_is_refused_with_the_value_in_the_message(tmp_path, text, quoted):
    path = tmp_path / 'plant.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=quoted) as caught:
        Plant.load(path)
    assert '\n' not in str(caught.value)


def test_a_missing_plant_file_names_the_shipped_ones(tmp_path):
    with pytest.raises(InputError, match='anymal_c, anymal_c_published, ideal'):
        Plant.load(tmp_path / 'nowhere.yaml')


def test_a_drive_without_a_type_is_named():
    plant = Plant.parse({'drive_types': {'HAA': {}}})
    with pytest.raises(InputError, match="'LF_KFE'"):
        plant.resolve(['LF_KFE'])


def test_unit_0_is_as_written_and_other_units_differ_by_a_few_percent():
    plant = Plant.load('anymal_c')
    nominal = plant.resolve(JOINT_NAMES)
    assert np.ptp(nominal['resistance']) == 0.0
    for name, low, high in (('resistance', 0.005, 0.08), ('coulomb', 0.03, 0.3)):
        spread = np.log(plant.unit(2).resolve(JOINT_NAMES)[name] / nominal[name])
        assert low < spread.std() < high
        assert abs(spread).max() < 2.6 * high


def test_a_unit_is_the_same_each_time_and_whichever_drives_are_asked_for():
    plant = Plant.load('anymal_c').unit(3)
    whole, alone = plant.resolve(JOINT_NAMES), plant.resolve(['LH_KFE'])
    index = JOINT_NAMES.index('LH_KFE')
    assert all(whole[name][index] == alone[name][0] for name in alone)
    assert plant.unit(4).resolve(['LH_KFE'])['resistance'] != alone['resistance']


def test_effects_switch_and_scale_by_name():
    effects = Effects.parse(
        {'idle': False, 'fan': 2.5, 'cogging': {'enabled': True, 'strength': 0.5}}
    )
    assert (effects.idle.scale, effects.fan.scale, effects.cogging.scale) == (0.0, 2.5, 0.5)
