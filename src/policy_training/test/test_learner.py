import pytest
import torch
from policy_training.learning.learner import _clip_advantages
from policy_training.learning.training import make_learner


@pytest.mark.parametrize('share', [0.0, 0.4])
def test_robots_do_what_the_policy_means_for_a_share_of_the_time(tiny, share):
    learner = make_learner(tiny.with_values({'ppo.calm': share}))
    calm = []
    with torch.inference_mode():
        for _ in range(100):
            actions = learner._act()
            mean = learner.ppo.transition.distribution_params[0]
            calm.append((actions == mean).all(dim=1))
            torch.testing.assert_close(
                learner.ppo.transition.actions_log_prob,
                learner.ppo.actor.get_output_log_prob(actions),
            )
    shares = torch.stack(calm).float().mean(dim=0)
    torch.testing.assert_close(shares, torch.full_like(shares, share))


def test_a_fall_does_not_outweigh_all_else_that_a_round_teaches():
    advantages = torch.randn(24, 512, 1, generator=torch.manual_seed(0))
    advantages[3, 7] = -200.0
    calm = advantages.clone()
    _clip_advantages(advantages, 2.0)
    assert advantages.std() == pytest.approx(1.0, abs=1e-4)
    assert advantages.mean() == pytest.approx(0.0, abs=1e-4)
    assert -2.5 < advantages[3, 7] == advantages.min()
    assert advantages[0, 0] == pytest.approx(float(calm[0, 0].clamp(-2, 2)), abs=0.15)
