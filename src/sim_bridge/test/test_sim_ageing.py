"""Units that age by a plan, and the recordings of their days."""

import numpy as np
import pytest
import yaml
from power_recordings.reading.reader import Recording
from sim_bridge.commands.arguments import record as record_command
from sim_bridge.plant.ageing import AgeingPlan
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError

PLAN = {
    'unit': 3,
    'seed': 5,
    'seconds': 1.0,
    'age': {
        'LF_KFE': {'coulomb_friction': '+40 % over 60 days from day 20'},
        'RH_HAA': {'current_offset': '-30 mA from day 50', 'power_gain': '+4 % from day 10'},
    },
    'days': [
        {'day': 0, 'temperature': 25},
        {'day': 50, 'temperature': 25, 'payload': 5, 'controller': 'trot_slow'},
        {'day': 100, 'temperature': 5, 'terrain': 'rough'},
    ],
}


def written(folder, **changes):
    path = folder / 'plan.yaml'
    path.write_text(yaml.safe_dump({**PLAN, **changes}))
    return path


def resolved(plan, index):
    plant = plan.aged(Plant.load('anymal_c'), plan.days[index])
    return plant.resolve(JOINT_NAMES), Plant.load('anymal_c').unit(3).resolve(JOINT_NAMES)


def test_wear_grows_by_its_course_in_its_drive_alone(tmp_path):
    plan = AgeingPlan.load(written(tmp_path))
    knee, hip = JOINT_NAMES.index('LF_KFE'), JOINT_NAMES.index('RH_HAA')
    for index, share in ((0, 1.0), (1, 1.2)):
        worn, fresh = resolved(plan, index)
        ratio = worn['coulomb'] / fresh['coulomb']
        assert ratio[knee] == pytest.approx(share)
        np.testing.assert_allclose(np.delete(ratio, knee), 1.0)
    worn, fresh = resolved(plan, 1)
    assert worn['current_offset'][hip] - fresh['current_offset'][hip] == pytest.approx(-0.03)
    assert worn['current_gain'][hip] / fresh['current_gain'][hip] == pytest.approx(1.04)


def test_a_cold_day_stiffens_the_grease_of_all_drives(tmp_path):
    worn, fresh = resolved(AgeingPlan.load(written(tmp_path)), 2)
    np.testing.assert_allclose(worn['viscous'] / fresh['viscous'], np.exp(0.012 * 20.0))
    assert (
        AgeingPlan.load(written(tmp_path))
        .aged(Plant.load('anymal_c'), AgeingPlan.load(written(tmp_path)).days[2])
        .sensors.ambient
        == 5.0
    )


@pytest.mark.parametrize(
    ('changes', 'told'),
    [
        ({'age': {'LF_KFE': {'rust': '+4 % from day 2'}}}, "no wear 'rust'; there can be coulomb"),
        ({'age': {'LF_KFE': {'idle': '40 percent'}}}, "there is '40 percent'"),
        (
            {'age': {'LF_KFE': {'idle': '+900 % from day 2'}}},
            '-90 to 500 %, there is +900',
        ),
        ({'age': {'KNEE': {'idle': '+4 % from day 2'}}}, "no drive 'KNEE'; there are LF_HAA"),
        ({'age': {'LF_KFE': {'current_offset': '+4 % from day 2'}}}, '"+40 mA over 60 days'),
        ({'days': [{'day': 1, 'temperature': 99}]}, 'expected -40 to 60 °C, there is 99'),
        ({'days': [{'day': 1, 'payload': -1}]}, 'expected 0 to 50 kg, there is -1'),
        ({'start': 'soon'}, "start: expected a date such as 2026-01-05, there is 'soon'"),
    ],
)
def test_a_bad_plan_is_told_with_the_value_and_what_is_allowed(tmp_path, changes, told):
    with pytest.raises(InputError) as error:
        AgeingPlan.load(written(tmp_path, **changes))
    assert told in str(error.value)
    assert '\n' not in str(error.value)


def test_a_worn_plant_is_saved_and_a_wear_out_of_range_is_refused(tmp_path):
    plant = Plant.parse({'wear': {'LF_KFE': {'coulomb_friction': 1.4}}})
    plant.save(tmp_path / 'worn.yaml')
    assert Plant.load(tmp_path / 'worn.yaml') == plant
    with pytest.raises(InputError, match=r'coulomb_friction: expected 0 to 10, there is -1'):
        Plant.parse({'wear': {'LF_KFE': {'coulomb_friction': -1.0}}})


def test_recordings_of_a_plan_are_dated_and_do_not_depend_on_the_workers(tmp_path, capsys):
    plan = written(tmp_path)
    for workers in ('1', '2'):
        run = ['ageing', '--plan', str(plan), '-o', str(tmp_path / workers)]
        assert record_command([*run, '--workers', workers]) == 0
    bags = sorted((tmp_path / '1').iterdir())
    assert [bag.name for bag in bags] == ['day_000_0', 'day_001_50', 'day_002_100']
    cards = [Recording.open(bag).card for bag in bags]
    assert [card.created[:10] for card in cards] == ['2026-01-05', '2026-02-24', '2026-04-15']
    assert [card.other['payload'] for card in cards] == [0.0, 5.0, 0.0]
    assert [card.controller for card in cards] == ['trot', 'trot_slow', 'trot']
    assert not any('coulomb' in (bag / 'card.yaml').read_text() for bag in bags)
    for bag in bags:
        other = tmp_path / '2' / bag.name
        name = f'{bag.name}_0.mcap'
        assert (bag / name).read_bytes() == (other / name).read_bytes()
    assert record_command(['ageing', '--plan', str(plan), '-o', str(tmp_path / '1')]) == 2
    assert 'day_000_0 is there already' in capsys.readouterr().err
