import pytest
import torch
from policy_training.learning.learner import _clip_advantages


def test_a_fall_does_not_outweigh_all_else_that_a_round_teaches():
    advantages = torch.randn(24, 512, 1, generator=torch.manual_seed(0))
    advantages[3, 7] = -200.0
    calm = advantages.clone()
    _clip_advantages(advantages, 2.0)
    assert advantages.std() == pytest.approx(1.0, abs=1e-4)
    assert advantages.mean() == pytest.approx(0.0, abs=1e-4)
    assert -2.5 < advantages[3, 7] == advantages.min()
    assert advantages[0, 0] == pytest.approx(float(calm[0, 0].clamp(-2, 2)), abs=0.15)
