from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from pushes import falls

HARD = {'random.push': 1.2, 'random.push_period': 2.0}


def test_a_trot_with_cadence_adaptation_withstands_pushes_that_make_one_without_it_fall():
    steady = falls('trot', 1.6, (), robots=32, seconds=8.0, changes=HARD)
    adaptive = falls('trot', 1.6, CADENCE_ADAPTATION, robots=32, seconds=8.0, changes=HARD)
    assert steady >= 8
    assert adaptive <= steady // 4
