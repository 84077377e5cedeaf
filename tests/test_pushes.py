from policy_runner.policies.gait_phase import HURRY
from pushes import falls

HARD = {'random.push': 1.2, 'random.push_period': 2.0}


def test_a_trot_that_hurries_withstands_pushes_that_throw_over_one_that_does_not():
    steady = falls('trot', 1.6, (), robots=32, seconds=8.0, changes=HARD)
    hurried = falls('trot', 1.6, HURRY, robots=32, seconds=8.0, changes=HARD)
    assert steady >= 8
    assert hurried <= steady // 4
