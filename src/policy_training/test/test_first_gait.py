import json

import numpy as np
import torch
from policy_runner.observations import CLOCKED
from policy_training.first_gait import FirstGait
from policy_training.run_folder import read_checkpoint, read_curves
from policy_training.train_command import main

HELD = (
    *('--environments', '4', '--threads', '1', '--set', 'ppo.steps=6', 'ppo.minibatches=2'),
    *('ppo.epochs=1', 'ppo.hidden=[16]', 'ppo.hold_rate=1e-3', 'imitation.critic_rounds=0'),
    *('imitation.robots=2', 'imitation.seconds=2', 'imitation.epochs=2', 'random.velocity=2.0'),
)


def rows(count, *, velocity=0.0, tilt=0.0):
    """Observations of robots that are to stand, at a speed in m/s and a tilt."""
    seen = torch.randn(count, CLOCKED.size, generator=torch.Generator().manual_seed(1))
    for name, value in (('command', 0.0), ('base_velocity', 2.0 * velocity), ('gravity', tilt)):
        seen[:, CLOCKED.part(name)] = 0.0
        seen[:, CLOCKED.part(name).start] = value
    return seen


def disturb(actor):
    with torch.no_grad():
        for parameter in actor.parameters():
            parameter += 0.3 * torch.randn(
                parameter.shape, generator=torch.Generator().manual_seed(2)
            )


def test_a_policy_is_led_back_to_its_first_gait_where_it_is_out_of_balance():
    for away in ({'velocity': 1.0}, {'tilt': 0.3}):
        actor, seen = torch.nn.Linear(CLOCKED.size, 12), rows(400, **away)
        first = actor(seen).detach()
        gait = FirstGait(actor, CLOCKED, within=0.0, rate=3e-3)
        disturb(actor)
        off = (actor(seen) - first).square().mean().sqrt().item()
        share, left = gait.hold(seen, seen)
        assert share == 1.0
        np.testing.assert_allclose(left, off, rtol=1e-5)
        for _ in range(200):
            _, left = gait.hold(seen, seen)
        assert left < 0.05 * off


def test_it_is_free_to_change_what_it_does_in_balance():
    actor = torch.nn.Linear(CLOCKED.size, 12)
    gait = FirstGait(actor, CLOCKED, within=0.0, rate=1e-3)
    disturb(actor)
    before = actor.weight.detach().clone()
    calm = rows(50, velocity=0.2, tilt=0.05)
    assert gait.hold(calm, calm) == (0.0, 0.0)
    assert torch.equal(actor.weight, before)
    mixed = torch.cat([calm, rows(50, velocity=1.0)])
    assert gait.hold(mixed, mixed)[0] == 0.5


def test_actions_that_are_near_enough_are_left_as_they_are():
    actor, seen = torch.nn.Linear(CLOCKED.size, 12), rows(50, velocity=1.0)
    gait = FirstGait(actor, CLOCKED, within=0.05, rate=1e-3)
    with torch.no_grad():
        actor.bias += 0.04
    before = actor.weight.detach().clone()
    assert gait.hold(seen, seen)[0] == 1.0
    assert torch.equal(actor.weight, before)
    with torch.no_grad():
        actor.bias += 0.04
    gait.hold(seen, seen)
    assert not torch.equal(actor.weight, before)


def test_what_counts_is_how_it_is_and_not_what_sensors_say():
    actor = torch.nn.Linear(CLOCKED.size, 12)
    gait = FirstGait(actor, CLOCKED, within=0.0, rate=1e-3)
    assert gait.hold(rows(10, velocity=1.0), rows(10)) == (0.0, 0.0)


def test_runs_and_runs_from_them_hold_to_the_same_first_gait(tmp_path):
    one, two = tmp_path / 'one', tmp_path / 'two'
    gait = ['--config', 'baseline', '--steps', '48']
    assert main(['-o', str(one), *gait, *HELD]) == 0
    assert read_curves(one)[-1]['loss/hurried'] > 0.0
    assert main(['-o', str(two), *gait, '--from', str(one), *HELD]) == 0
    assert main(['-o', str(two), '--resume', '--steps', '72']) == 0
    held = [read_checkpoint(run)['first_gait']['network'] for run in (one, two)]
    reached = read_checkpoint(one)['actor_state_dict']
    for name, values in held[0].items():
        assert torch.equal(values, held[1][name])
        assert not torch.equal(values, reached[f'mlp.{name}'])
    assert json.loads((two / 'curves.jsonl').read_text().splitlines()[-1])['steps'] == 72


def test_to_hold_to_a_first_gait_strides_must_hurry(tmp_path, capsys):
    assert main(['-o', str(tmp_path / 'r'), *HELD, 'hurry=[]']) == 2
    assert 'ppo.hold_rate is 0.001 without hurry' in capsys.readouterr().err
