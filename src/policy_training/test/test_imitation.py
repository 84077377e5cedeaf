import numpy as np
import torch
from policy_training.environment.vec_env import Mirror
from policy_training.learning.imitation import imitate
from policy_training.learning.training import make_learner

TROT = {
    'imitation.gait': 'trot',
    'imitation.robots': 4,
    'imitation.seconds': 2.0,
    'imitation.epochs': 20,
    'imitation.critic_rounds': 2,
    'ppo.hidden': (64, 32),
}


def actor_of(learner):
    return {name: value.clone() for name, value in learner.ppo.actor.state_dict().items()}


def test_a_network_comes_to_act_as_the_trot_does(tiny):
    learner = make_learner(tiny.with_values(TROT))
    mirror, shares = Mirror(learner.environment.observation), []
    config = learner.config
    left = imitate(config, learner.ppo.actor.mlp, mirror, shares.append)
    idle = imitate(config.with_values({'imitation.epochs': 2}), torch.nn.Linear(50, 12), mirror)
    assert left < 0.8 * idle
    assert shares[-1] == 1.0


def test_the_critic_learns_alone_before_the_gait_is_touched(tiny):
    learner = make_learner(tiny.with_values(TROT))
    learner.imitate_expert(lambda share: None)
    before = actor_of(learner)
    critic = learner.ppo.critic.mlp[0].weight.detach().clone()
    learner.run(2, lambda done: None)
    after = actor_of(learner)
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert not torch.equal(critic, learner.ppo.critic.mlp[0].weight)
    learner.run(3, lambda done: None)
    after = actor_of(learner)
    assert not torch.equal(before['mlp.0.weight'], after['mlp.0.weight'])


def test_without_a_gait_the_policy_learns_from_the_first_round(tiny):
    learner = make_learner(tiny)
    before = actor_of(learner)
    learner.run(1, lambda done: None)
    assert not torch.equal(before['mlp.0.weight'], actor_of(learner)['mlp.0.weight'])


def test_the_same_seed_gives_the_same_imitation(tiny):
    results = []
    for _ in range(2):
        learner = make_learner(tiny.with_values(TROT))
        learner.imitate_expert(lambda share: None)
        results.append(actor_of(learner)['mlp.0.weight'].numpy())
    np.testing.assert_array_equal(*results)
