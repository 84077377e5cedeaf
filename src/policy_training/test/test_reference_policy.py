import copy
import json

import numpy as np
import pytest
import torch
from policy_runner.policies.observations import CLOCKED
from policy_training.commands.arguments import train as main
from policy_training.config import TrainingConfig
from policy_training.learning.reference_policy import PolicyTrial, ReferencePolicy
from policy_training.learning.run_folder import read_checkpoint, read_curves

HELD = (
    *('--environments', '4', '--threads', '1', '--set', 'ppo.steps=6', 'ppo.minibatches=2'),
    *(
        'ppo.epochs=1',
        'ppo.hidden=[16]',
        'ppo.anchor_rate=1e-3',
        'ppo.anchor_tolerance=0',
        'imitation.critic_rounds=0',
    ),
    *('imitation.robots=2', 'imitation.seconds=2', 'imitation.epochs=2', 'random.velocity=2.0'),
)


def test_a_policy_is_tried_on_the_plant_that_it_trains_on():
    """A robot that stands draws less on drives without losses or electronics."""
    still = [(torch.zeros(12, CLOCKED.size), torch.zeros(12))]
    trial = {'selection.trial.calm': 1, 'selection.trial.pushed': 0, 'physics.threads': 1}
    watts = []
    for plant in ('anymal_c', 'ideal'):
        config = TrainingConfig().with_values({**trial, 'physics.plant': plant})
        watts.append(PolicyTrial(config, CLOCKED).run(still, seed=0).power)
    assert watts[1] < 0.1 * watts[0]


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


def test_a_policy_is_pulled_back_to_its_reference_where_it_is_out_of_balance():
    for away in ({'velocity': 1.0}, {'tilt': 0.3}):
        actor, seen = torch.nn.Linear(CLOCKED.size, 12), rows(400, **away)
        first = actor(seen).detach()
        reference = ReferencePolicy(actor, CLOCKED, tolerance=0.0, rate=3e-3)
        disturb(actor)
        off = (actor(seen) - first).square().mean().sqrt().item()
        share, left = reference.anchor(seen, seen)
        assert share == 1.0
        np.testing.assert_allclose(left, off, rtol=1e-5)
        for _ in range(200):
            _, left = reference.anchor(seen, seen)
        assert left < 0.05 * off


def test_it_is_free_to_change_what_it_does_in_balance():
    actor = torch.nn.Linear(CLOCKED.size, 12)
    reference = ReferencePolicy(actor, CLOCKED, tolerance=0.0, rate=1e-3)
    disturb(actor)
    before = actor.weight.detach().clone()
    calm = rows(50, velocity=0.2, tilt=0.05)
    assert reference.anchor(calm, calm) == (0.0, 0.0)
    assert torch.equal(actor.weight, before)
    mixed = torch.cat([calm, rows(50, velocity=1.0)])
    assert reference.anchor(mixed, mixed)[0] == 0.5


def test_actions_that_are_near_enough_are_left_as_they_are():
    actor, seen = torch.nn.Linear(CLOCKED.size, 12), rows(50, velocity=1.0)
    reference = ReferencePolicy(actor, CLOCKED, tolerance=0.05, rate=1e-3)
    with torch.no_grad():
        actor.bias += 0.04
    before = actor.weight.detach().clone()
    assert reference.anchor(seen, seen)[0] == 1.0
    assert torch.equal(actor.weight, before)
    with torch.no_grad():
        actor.bias += 0.04
    reference.anchor(seen, seen)
    assert not torch.equal(actor.weight, before)
    with torch.no_grad():
        actor.bias.copy_(reference.content()['network']['bias'])
        actor.weight.copy_(reference.content()['network']['weight'])
    reference.anchor(seen, seen)  # nor does momentum go on
    assert torch.equal(actor.weight, before)


def test_what_counts_is_how_it_is_and_not_what_sensors_say():
    actor = torch.nn.Linear(CLOCKED.size, 12)
    reference = ReferencePolicy(actor, CLOCKED, tolerance=0.0, rate=1e-3)
    assert reference.anchor(rows(10, velocity=1.0), rows(10)) == (0.0, 0.0)


def test_runs_and_runs_from_them_have_the_same_reference_policy(tmp_path):
    one, two = tmp_path / 'one', tmp_path / 'two'
    gait = ['--config', 'baseline', '--steps', '48']
    assert main(['-o', str(one), *gait, *HELD]) == 0
    assert read_curves(one)[-1]['loss/urgent'] > 0.0
    assert main(['-o', str(two), *gait, '--from', str(one), *HELD]) == 0
    assert main(['-o', str(two), '--resume', '--steps', '72']) == 0
    held = [read_checkpoint(run)['reference_policy']['network'] for run in (one, two)]
    reached = read_checkpoint(one)['actor_state_dict']
    for name, values in held[0].items():
        assert torch.equal(values, held[1][name])
        assert not torch.equal(values, reached[f'mlp.{name}'])
    assert json.loads((two / 'curves.jsonl').read_text().splitlines()[-1])['steps'] == 72
    assert read_curves(two)[-1]['loss/from_reference'] > 0.0
    moments = read_checkpoint(two)['reference_policy']['optimiser']['state'][0]
    assert moments['step'] > 8  # of two rounds and of the one after


def test_a_restored_reference_continues_as_the_original_does():
    reference = ReferencePolicy(
        torch.nn.Linear(CLOCKED.size, 12), CLOCKED, tolerance=0.0, rate=1e-3
    )
    seen = rows(50, velocity=1.0)
    disturb(reference.actor)
    reference.anchor(seen, seen)
    actor = copy.deepcopy(reference.actor)
    other = ReferencePolicy(actor, CLOCKED, tolerance=0.0, rate=1e-3)
    other.restore(copy.deepcopy(reference.content()), go_on=True)
    for one in (reference, other):
        torch.manual_seed(0)
        one.anchor(seen, seen)
    torch.testing.assert_close(actor.weight, reference.actor.weight)


def test_a_changed_rate_counts_for_a_run_that_goes_on():
    seen = rows(50, velocity=1.0)
    moved = []
    for rate in (1e-4, 1e-2):
        first = ReferencePolicy(
            torch.nn.Linear(CLOCKED.size, 12), CLOCKED, tolerance=0.0, rate=1e-4
        )
        disturb(first.actor)
        first.anchor(seen, seen)
        reference = ReferencePolicy(copy.deepcopy(first.actor), CLOCKED, tolerance=0.0, rate=rate)
        reference.restore(first.content(), go_on=True)
        before = reference.actor.weight.detach().clone()
        reference.anchor(seen, seen)
        moved.append((reference.actor.weight - before).abs().max().item())
    assert moved[1] > 10.0 * moved[0]


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (
            ['--config', 'pmp', '--set', "power.model=''", 'power.weight=0.0'],
            'needs a reference policy',
        ),
        (['--set', 'cadence_adaptation=[3.0]'], 'cadence_adaptation is [3.0]'),
        (['--set', 'hurry=[fast, 0.2, 0.6]'], 'cadence_adaptation[0]: expected a number'),
        (['--set', 'hurry=[]'], 'without cadence_adaptation'),
    ],
)
def test_bad_input_ends_with_one_line_and_code_2(tmp_path, capsys, arguments, words):
    assert main(['-o', str(tmp_path / 'r'), '--environments', '2', *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert '\n' not in error


def test_a_run_without_a_reference_policy_cannot_get_one_in_its_middle(tmp_path, capsys):
    free = [*HELD, 'ppo.anchor_rate=0.0']
    assert main(['-o', str(tmp_path / 'r'), '--steps', '24', *free]) == 0
    again = ['-o', str(tmp_path / 'r'), '--resume', '--steps', '48']
    assert main([*again, '--set', 'ppo.anchor_rate=1e-4']) == 2
    assert 'no reference policy' in capsys.readouterr().err
