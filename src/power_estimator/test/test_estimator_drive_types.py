import pytest
from power_estimator.drive_types import assign, infer_types, parse_types
from wattwalk_core.errors import InputError


def names(drives):
    return {t.name: t.patterns for t in infer_types(drives)}


def test_drives_of_legs_are_grouped_by_what_follows_the_leg():
    assert names(['LF_HAA', 'LF_KFE', 'RH_HAA']) == {'HAA': ('*_HAA',), 'KFE': ('*_KFE',)}


def test_one_measured_leg_stands_for_all_legs():
    (haa,) = infer_types(['LF_HAA'])
    assert haa.matches('RH_HAA')


def test_other_robots_are_grouped_by_the_ending_that_their_drives_share():
    assert names(['FL_hip_joint', 'FR_hip_joint']) == {'hip_joint': ('*_hip_joint',)}
    assert names(['one_hip', 'two_hip']) == {'hip': ('*_hip',)}


def test_an_arm_has_a_type_for_each_joint():
    assert names(['joint_1', 'joint_2', 'wrist']) == {
        'joint_1': ('joint_1',),
        'joint_2': ('joint_2',),
        'wrist': ('wrist',),
    }


def test_a_drive_goes_to_the_first_type_that_matches():
    types = parse_types(['front=LF_*,RF_*', 'rest=*'])
    assert assign(['LF_HAA', 'LH_HAA', 'RF_KFE'], types) == {'front': [0, 2], 'rest': [1]}


@pytest.mark.parametrize('text', ['HAA', 'HAA=', '=*_HAA', 'a b=*'])
def test_types_of_another_form_are_refused(text):
    with pytest.raises(InputError):
        parse_types([text])
