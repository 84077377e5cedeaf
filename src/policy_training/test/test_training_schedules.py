"""Schedules of a run: exploration, pushes, price of power, and the policy that is kept."""

import numpy as np
import pytest
import torch
from policy_training.config import PpoConfig, RandomConfig
from policy_training.environment.robots import Robots
from policy_training.evaluation.task_trial import TrialScore
from policy_training.learning.learner import Learner
from policy_training.learning.reference_policy import ReferencePolicy
from policy_training.learning.training import make_learner
from wattwalk_core.errors import InputError


def score(cost, speed_error=0.0, falls=0.0):
    return TrialScore(cost, cost, 50.0, falls, speed_error, 0.0, {})


@pytest.fixture
def learner(tiny):
    changes = {'power.multiplier_rate': 0.1, 'power.most_multiplier': 1.2}
    return make_learner(tiny.with_values(changes))


def select(learner, monkeypatch, found):
    monkeypatch.setattr(learner._trial, 'run', lambda layers, seed: found)
    return learner._select()


def test_exploration_shrinks_by_equal_ratios_to_its_end():
    ppo = PpoConfig(std=0.2, std_end=0.05, learn_std=False)
    assert [ppo.std_at(share) for share in (0.0, 0.5, 1.0, 2.0)] == pytest.approx(
        [0.2, 0.1, 0.05, 0.05]
    )


def test_an_end_of_exploration_does_not_go_with_one_that_is_learned():
    with pytest.raises(InputError, match='learn_std'):
        PpoConfig(std_end=0.05, learn_std=True)


def test_a_round_explores_as_its_place_in_the_run_says(tiny):
    changes = {'ppo.learn_std': False, 'ppo.std': 0.2, 'ppo.std_end': 0.05}
    learner = make_learner(tiny.with_values(changes))
    learner.environment.steps = int(0.5 * learner.config.steps)
    learner._round()
    assert learner.ppo.get_policy().output_std.mean().item() == pytest.approx(0.1, rel=0.05)


def test_pushes_grow_from_their_first_share_to_the_whole():
    plan = RandomConfig(push_first=0.5, push_from=100.0, push_to=300.0)
    assert [plan.push_share(s) for s in (0.0, 100.0, 200.0, 300.0, 1e9)] == pytest.approx(
        [0.5, 0.5, 0.75, 1.0, 1.0]
    )


def test_a_push_of_half_the_share_is_half_as_hard(tiny):
    robots = [
        Robots(tiny.physics, RandomConfig(push=1.0), np.random.default_rng(3)) for _ in range(2)
    ]
    ids = np.arange(robots[0].count)
    robots[0].push(ids, 1.0)
    robots[1].push(ids, 0.5)
    whole, half = (r.motion().velocity[:, :2] for r in robots)
    np.testing.assert_allclose(half, 0.5 * whole, atol=1e-9)


def test_the_price_of_power_rises_while_the_limits_are_kept_and_falls_twice_as_fast(
    learner, monkeypatch
):
    environment = learner.environment
    select(learner, monkeypatch, score(300.0))
    assert environment.power_multiplier == pytest.approx(1.1)
    select(learner, monkeypatch, score(300.0, falls=0.5))
    assert environment.power_multiplier == 1.0, 'never below the weight of the config'
    for _ in range(5):
        select(learner, monkeypatch, score(300.0))
    assert environment.power_multiplier == 1.2, 'never above the limit'
    select(learner, monkeypatch, score(300.0, speed_error=0.3))
    assert environment.power_multiplier == 1.0


def test_the_policy_that_cost_least_is_kept_and_comes_back_from_a_checkpoint(
    learner, monkeypatch, tiny
):
    def weights(layers):
        return layers[0][0].clone()

    select(learner, monkeypatch, score(300.0))
    best = weights(learner.actor_layers())
    with torch.no_grad():
        next(iter(learner.ppo.actor.mlp.parameters())).add_(1.0)
    select(learner, monkeypatch, score(310.0))
    assert torch.equal(weights(learner.chosen_layers()), best)
    assert not torch.equal(weights(learner.actor_layers()), best)
    other = Learner(learner.config, learner.environment)
    other.restore(learner.checkpoint())
    assert torch.equal(weights(other.chosen_layers()), best)
    assert other.environment.power_multiplier == learner.environment.power_multiplier


def test_without_trials_the_last_policy_is_kept(tiny):
    learner = make_learner(tiny)
    assert learner.chosen_layers()[0][0] is not None
    assert torch.equal(learner.chosen_layers()[0][0], learner.actor_layers()[0][0])


def test_a_trial_of_a_random_policy_says_that_it_does_not_follow(tiny):
    changes = {'selection.every': 1}
    config = tiny.with_values(changes)
    learner = make_learner(config)
    values = learner._round().values
    assert values['trial/speed_error'] > 0.1
    assert values['trial/cost'] > values['trial/power']


def test_only_rows_of_full_urgency_count_where_the_anchor_says_so(tiny):
    learner = make_learner(tiny)
    observation = learner.environment.observation
    actor = learner.ppo.actor.mlp
    states = torch.zeros(3, observation.size)
    gravity = observation.part('gravity').start
    states[:, gravity + 2] = -1.0
    tilts = torch.tensor([0.0, 0.2, 0.5])  # capture-point errors 0, 0.45 and 1.1 m/s
    states[:, gravity] = tilts
    shares = []
    for least in (0.0, 1.0):
        reference = ReferencePolicy(
            actor, observation, tolerance=0.0, rate=0.0, least_urgency=least
        )
        shares.append(reference.anchor(states, states)[0])
    assert shares == pytest.approx([2 / 3, 1 / 3])


def test_legs_pass_through_the_ground_where_only_feet_and_base_touch_it(tiny):
    count = []
    for contacts in ('all', 'feet_and_base'):
        physics = tiny.with_values({'physics.contacts': contacts}).physics
        robots = Robots(physics, RandomConfig(resting=1.0), np.random.default_rng(0))
        robots._qpos[:, 2] -= 0.3
        robots._batch.forward()
        count.append(robots.motion().collisions.sum())
    assert count[0] > 0
    assert count[1] == 0
