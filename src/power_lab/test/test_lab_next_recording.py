import pytest
from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.plan import Plan
from drive_bench.motion.segment_path import Mounting, Ramps
from power_estimator.effects import builtin_catalogue
from power_lab.diagnose.next_recording import LEAST_OF_EACH, separating_motion
from wattwalk_core.errors import InputError


def test_the_next_motion_fits_the_joints_that_it_is_told_of():
    motion = separating_motion(
        ['viscous_friction', 'coulomb_friction'], builtin_catalogue(), ['LF_KFE'], 'a tie'
    )
    narrow = {'LF_KFE': JointLimits(-1.5, 1.5, 4.0, 40.0)}
    fit = motion.within(narrow)
    assert 'fitted to the joint' in fit.reason
    read = MotionFile.of(fit.content(), 'here', 'next')
    pull = 1.15 * max(read.strongest, 1.0)
    Plan(read, 0.0, Mounting(pull), Ramps()).check('LF_KFE', narrow['LF_KFE'])
    assert fit.within(narrow).segments == fit.segments
    with pytest.raises(InputError, match='nothing for LF_KFE'):
        motion.within({})


@pytest.mark.parametrize('effect', ['regeneration_limit', 'inverter_loss', 'cogging', 'idle'])
def test_each_effect_is_shown_for_long_enough_to_be_told_from_chance(effect):
    motion = separating_motion([effect], builtin_catalogue(), ['LF_KFE'], 'a tie')
    shown = [segment for segment in motion.segments if segment['mode'] != 'rest']
    assert sum(segment['seconds'] for segment in shown) >= LEAST_OF_EACH


@pytest.mark.parametrize('effect', ['regeneration_efficiency', 'regeneration_limit'])
def test_a_motion_for_a_single_drive_tells_of_no_other_drives(effect):
    alone, both = (
        separating_motion([effect], builtin_catalogue(), names, 'a tie')
        for names in (['KNEE'], ['KNEE', 'HIP'])
    )
    assert 'other' not in alone.reason
    assert 'other' in both.reason
    assert alone.segments == both.segments


def test_a_short_motion_beside_a_long_one_is_repeated_for_its_own_sake():
    catalogue = builtin_catalogue()
    alone = separating_motion(['cogging'], catalogue, ['LF_KFE'], 'a tie').seconds
    both = separating_motion(['regeneration_limit', 'cogging'], catalogue, ['LF_KFE'], 'a tie')
    assert both.seconds >= alone + LEAST_OF_EACH
