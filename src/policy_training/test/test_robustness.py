import policy_folders
import pytest
from policy_runner.policies.folder import read_folder
from policy_runner.policies.learned import Perceptron
from policy_training.evaluation.robustness import (
    RobustnessConfig,
    evaluate_robustness,
    rough_world,
)
from wattwalk_core.errors import InputError


def test_a_policy_that_only_stands_does_not_follow(tmp_path):
    contract, tensors = read_folder(policy_folders.save(tmp_path / 'p'))
    found = evaluate_robustness(
        contract,
        Perceptron(tensors, 'elu'),
        RobustnessConfig(robots=6, seconds=8.0),
        threads=1,
    )
    assert not found.following
    assert found.mean_error['yaw'] > 0.1


def test_a_policy_of_another_joint_order_cannot_be_tried(tmp_path):
    joints = policy_folders.JOINT_NAMES[::-1]
    contract, tensors = read_folder(policy_folders.save(tmp_path / 'p', joints=joints))
    with pytest.raises(InputError, match='order of joints'):
        evaluate_robustness(
            contract, Perceptron(tensors, 'elu'), RobustnessConfig(robots=1, seconds=4.0)
        )


def test_trials_are_of_some_robots_for_some_seconds():
    with pytest.raises(InputError, match='robots: expected a whole number'):
        RobustnessConfig(robots=0)


def test_trials_are_on_the_plant_that_is_named():
    name = 'anymal_c'
    assert rough_world(RobustnessConfig(plant=name)).physics.plant == name
