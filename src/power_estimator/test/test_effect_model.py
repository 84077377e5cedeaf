from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_estimator.drive_types import DriveType
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import DriveGroup, EffectModel, FittedValue
from power_estimator.effects.model_file.yaml_file import read_model, write_model
from power_estimator.loader import load_model
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError

CATALOGUE = builtin_catalogue()


def data(names=('LF_KFE', 'RH_KFE', 'LF_HAA'), *, torque=10.0, velocity=2.0, voltage=np.nan):
    signals = {'torque': torque, 'velocity': velocity, 'voltage': voltage}
    time = np.arange(200) / 200.0
    return AlignedDataset.blank(200.0, names, time, 'made', position=0.3, command=0.3, **signals)


def model(**changes):
    structure = Structure(tuple(Active.of(CATALOGUE[n]) for n in ('shaft', 'copper_loss', 'idle')))
    coefficients = {
        'copper_loss': (FittedValue(0.02, (0.019, 0.021)),),
        'idle': (FittedValue(8.0, (7.9, 8.1)),),
    }
    measurement = {
        'power_gain': FittedValue(0.01, (0.0, 0.02)),
        'current_offset': FittedValue(0.01, (0, 0.02)),
    }
    group = DriveGroup(DriveType('KFE', ('*_KFE',)), coefficients, measurement, 0.0, 48.0)
    return EffectModel('base', structure, (group,), **changes)


def write(tmp_path: Path, change=lambda content: None) -> Path:
    path = tmp_path / 'base.yaml'
    write_model(model(), path)
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, allow_unicode=True))
    return path


def test_power_is_the_sum_of_the_effects_on_every_drive_of_the_type():
    power = model().predict(data())
    assert power[:, :2] == pytest.approx(20.0 + 0.02 * 100.0 + 8.0)
    assert np.isnan(power[:, 2]).all()


def test_numbers_of_numpy_are_written_as_numbers_with_six_digits(tmp_path):
    (group,) = model().groups
    given = replace(group, voltage=np.float32(24.123456789), copper=np.int64(2))
    write_model(replace(model(), groups=(given,)), tmp_path / 'm.yaml')
    (found,) = read_model(tmp_path / 'm.yaml', CATALOGUE).groups
    assert (found.voltage, found.copper) == (24.1235, 2.0)


def test_a_model_stands_on_another_one():
    under = np.full((200, 3), 5.0)
    power = model(base='torque_abs').predict(data(), base=under)
    assert power[5, 0] == pytest.approx(35.0)


def test_what_is_saved_is_read_back(tmp_path):
    path = tmp_path / 'base.yaml'
    first = model(
        fitted_on=({'name': 'walk', 'sha256': 'ab'},), history=({'step': 'fit', 'n': 1},)
    )
    write_model(first, path)
    second = read_model(path, CATALOGUE)
    assert second == first
    assert load_model(str(path)).predict(data())[5, 0] == pytest.approx(30.0)


def test_every_shape_of_an_effect_is_read_back(tmp_path):
    lossy = CATALOGUE['regeneration_efficiency']
    for shape in lossy.shapes:
        path = tmp_path / 'lossy.yaml'
        first = EffectModel('lossy', Structure((Active.of(lossy, shape),)))
        write_model(first, path)
        assert read_model(path, CATALOGUE).structure == first.structure
    own, _, supply = (Active.of(lossy, shape) for shape in lossy.shapes)
    assert own.per_drive
    assert not supply.per_drive


def test_a_model_may_list_effects_only_but_then_says_nothing(tmp_path):
    path = tmp_path / 'bare.yaml'
    path.write_text('effects: [shaft, copper_loss]\n')
    bare = read_model(path, CATALOGUE)
    assert bare.effects == ('shaft', 'copper_loss')
    with pytest.raises(InputError, match='bare: the model has no coefficients yet'):
        bare.predict(data())


def test_errors_of_the_measurement_may_be_listed_but_are_in_every_fit_anyway(tmp_path):
    path = tmp_path / 'bare.yaml'
    path.write_text('effects: [shaft, power_gain, idle]\n')
    assert read_model(path, CATALOGUE).effects == ('shaft', 'idle')


def test_a_file_may_have_the_unit_that_a_coefficient_had_formerly(tmp_path):
    path = tmp_path / 'base.yaml'
    write_model(model(), path)
    content = yaml.safe_load(path.read_text())
    content['effects']['winding_heating'] = {'time_constant': 20.0}
    content['drives']['KFE']['coefficients']['winding_heating'] = [
        {'value': 0.5, 'unit': 'W/((N·m)²·K)'},
        {'value': 0.0, 'unit': 'W/(N·m)²'},
    ]
    path.write_text(yaml.safe_dump(content, allow_unicode=True))
    (group,) = read_model(path, CATALOGUE).groups
    assert group.coefficients['winding_heating'][0].value == 0.5


def coefficient(content, **changes):
    content['drives']['KFE']['coefficients']['copper_loss'][0].update(changes)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (lambda c: c['effects'].update(magic=None), "unknown effect 'magic'"),
        (lambda c: c.update(effects=[]), 'effects lists none'),
        (lambda c: c.update(effects={'idle': {'colour': 2}}), "no shape 'colour'"),
        (lambda c: c.update(magic=1), "unknown key 'magic'"),
        (
            lambda c: c.update(format='other/3'),
            "expected 'power_model/1', there is 'other/3'",
        ),
        (lambda c: c['drives'].update(KFE=3), 'drives.KFE: expected keys with values, there is 3'),
        (lambda c: c['drives']['KFE'].pop('coefficients'), "'coefficients' is missing"),
        (lambda c: c['drives']['KFE']['coefficients'].pop('idle'), "coefficients of 'idle'"),
        (
            lambda c: c['drives']['KFE']['coefficients'].update(spring=[{'value': 1}]),
            "'spring', which is not active",
        ),
        (lambda c: coefficient(c, value=-0.02), 'physics allows 0 … 1'),
        (lambda c: coefficient(c, value=float('nan')), 'copper_loss[0].value: expected'),
        (
            lambda c: coefficient(c, value='much'),
            "[0].value: expected -1e+12 to 1e+12, there is 'much'",
        ),
        (lambda c: coefficient(c, unit='W/((N·m)²·K)'), "it must be in 'W/(N·m)²'"),
        (lambda c: coefficient(c, unit='mW'), "given in 'mW'; it must be in 'W/(N·m)²'"),
        (lambda c: coefficient(c, interval=[2.0, 1.0]), 'runs backwards'),
        (lambda c: coefficient(c, interval=[1.0]), 'interval: expected more values'),
        (
            lambda c: c['drives']['KFE']['coefficients'].update(idle=[8.0, 9.0]),
            'idle has 1 coefficient',
        ),
        (
            lambda c: c['drives']['KFE'].update(patterns='KFE'),
            'patterns: expected a list',
        ),
        (
            lambda c: c['drives']['KFE'].update(voltage=None),
            '10000 V, there is None',
        ),
        (lambda c: c['drives']['KFE'].update(voltage=-48), 'voltage: expected 0.1 to 10000 V'),
        (lambda c: c['drives']['KFE'].update(velocity_lag=-0.1), 'velocity_lag: expected 0 to 1'),
        (lambda c: c['drives']['KFE']['measurement'].update(idle=1.0), "measurement has 'idle'"),
        (lambda c: c.update(effects=[['shaft']]), "effects lists names, there is ['shaft']"),
        (lambda c: c.update(drives=5), 'drives: expected keys with values, there is 5'),
        (lambda c: c.update(history=[{'rmse_w': 3}]), 'history: rmse_w: expected keys'),
        (lambda c: c.update(history='long'), "history: expected a list, there is 'long'"),
    ],
)
def test_a_nonsense_model_file_is_refused_with_the_entry(tmp_path, change, words):
    path = write(tmp_path, change)
    with pytest.raises(InputError, match=r'base\.yaml') as caught:
        read_model(path, CATALOGUE)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['[1, 2]', '{a: [', '\x00', ''])
def test_a_file_that_is_no_model_is_refused(tmp_path, text):
    path = tmp_path / 'base.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=r'base\.yaml'):
        read_model(path, CATALOGUE)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match='cannot read'):
        read_model(tmp_path / 'none.yaml', CATALOGUE)
