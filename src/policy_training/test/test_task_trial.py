from dataclasses import replace

import numpy as np
import pytest
from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot_gait import TROTS
from policy_training.config import TrialConfig
from policy_training.environment.expert_policy import ExpertPolicy
from policy_training.evaluation.task_trial import TaskTrial

EVEN = replace(
    TROTS['trot_even'], cadence_adaptation=CADENCE_ADAPTATION, max_forward=1.2, max_yaw=1.2
)


@pytest.fixture(scope='module')
def scores():
    """Scores of a trot, and of one with wide, deep and high steps."""
    trial = TaskTrial(TrialConfig(calm=1, pushed=1, seconds=5.0), threads=1)
    wide = replace(EVEN, foot_y=0.34, height=0.46, swing_height=0.14)
    return [
        trial.run(lambda robots, gait=gait: ExpertPolicy(robots, [gait] * robots.count), seed=3)
        for gait in (EVEN, wide)
    ]


def test_wide_deep_and_high_steps_draw_more(scores):
    even, wide = scores
    assert even.power > 150.0
    assert wide.power > 1.3 * even.power
    assert even.cost >= even.power


def test_a_score_names_every_task_and_its_sum_is_their_mean(scores):
    assert list(scores[0].by_task) == ['forward', 'fast', 'turn', 'sideways']
    assert scores[0].power == pytest.approx(np.mean(list(scores[0].by_task.values())))
