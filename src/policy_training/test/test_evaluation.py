import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import policy_folders
import pytest
from policy_runner.policies.by_name import load_policy
from policy_training.commands.arguments import evaluate as main
from policy_training.evaluation.evaluate import score_walk, verdict
from policy_training.evaluation.gait_cycle import find_steps
from policy_training.evaluation.measured_walk import (
    RAW_RATE,
    _held,
    idle_power,
    measure_walk,
    recorded_walk,
)
from policy_training.evaluation.report import falls_front, pareto_front
from policy_training.evaluation.robustness import RobustnessConfig, _judge
from policy_training.evaluation.tasks import TASKS, Task, parse_tasks
from power_estimator.proxies import Proxy
from power_recordings.card import Card
from sim_bridge.offline.controllers import PolicyWalk, make_controller
from sim_bridge.offline.run import OfflineRun, write_bag
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import Simulation
from sim_bridge.plant.world import walking_world
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.errors import InputError


@pytest.fixture(scope='module')
def walk():
    return measure_walk('trot', TASKS[0], Plant.load('anymal_c'), duration=7.0, seed=1)


def test_power_adds_up_from_its_parts_to_the_supply(walk):
    entry = score_walk(walk, 98.0, {})
    power = entry['power_w']
    assert sum(power[p] for p in ('electronics', 'idle', 'HAA', 'HFE', 'KFE')) == pytest.approx(
        power['supply']
    )
    # 192 W of computers, and what the supply's own resistance takes
    assert 185.0 < power['electronics'] < 205.0
    assert entry['cost_of_transport'] == pytest.approx(
        power['supply'] / (52.135 * 9.81 * (0.6 - entry['tracking']['vx'])), rel=0.03
    )
    assert entry['falls'] == 0
    json.dumps(entry, allow_nan=False)


def test_only_steady_walking_counts(walk):
    since = walk.data.time - walk.data.time[0]
    assert not walk.steady[since < 3.0].any()
    assert walk.steady.sum() / walk.data.rate > 1.0


def test_an_estimate_by_joint_type_stands_beside_the_measured_power(walk):
    entry = score_walk(walk, 98.0, {'mechanical_power': Proxy('mechanical_power')})
    found = entry['estimates']['mechanical_power']
    assert found['drives'] == pytest.approx(found['HAA'] + found['HFE'] + found['KFE'])
    assert entry['estimated_w'] == pytest.approx(found['drives'] + entry['power_w']['electronics'])


def test_the_gait_is_that_of_the_trot(walk):
    entry = score_walk(walk, 98.0, {})
    assert entry['gait']['stride_s'] == pytest.approx(1.0 / 1.9, rel=0.03)
    share = entry['gait']['stance_s'] / entry['gait']['stride_s']
    assert share == pytest.approx(0.58, abs=0.06)
    assert entry['gait']['strides'] >= 4


def test_a_walk_that_never_gets_steady_has_no_power(walk):
    nothing = np.zeros_like(walk.steady)
    entry = score_walk(replace(walk, steady=nothing), 98.0, {})
    assert entry['power_w'] is None
    assert entry['tracking'] == {'vx': None, 'vy': None, 'yaw': None}


def test_idle_drives_draw_their_electronics():
    assert idle_power(Plant.load('anymal_c')) == pytest.approx(12 * 8.2, rel=0.03)
    assert idle_power(Plant.load('ideal')) == pytest.approx(0.0, abs=0.5)


def test_strides_are_found_from_touch_down_to_touch_down():
    time = np.arange(0.0, 3.0, 1.0 / RAW_RATE)
    force = np.where(time % 0.5 < 0.3, 150.0, 0.0)
    found = find_steps(force, np.ones(len(time), bool))
    lengths = [(stop - start) / RAW_RATE for start, _, stop in found]
    swings = [(stop - up) / RAW_RATE for _, up, stop in found]
    assert lengths == pytest.approx([0.5] * 4)
    assert swings == pytest.approx([0.2] * 4)
    flicker = force + np.where(time % 0.5 < 0.3, 0.0, 20.0)
    assert len(find_steps(flicker, np.ones(len(time), bool))) == 0
    late = time > 1.2
    assert len(find_steps(force, late)) == 2


def test_a_policy_folder_is_a_controller_of_the_simulation(tmp_path):
    folder = policy_folders.save(tmp_path / 'p')
    controller = make_controller(str(folder), 0)
    simulation = Simulation(Plant.load('ideal'), walking_world())
    assert controller.period == 40
    np.testing.assert_allclose(controller.command(simulation).position, DEFAULT_POSE, atol=1e-6)
    (folder / 'policy.yaml').write_text('{}')
    with pytest.raises(InputError, match='is missing'):
        make_controller(str(folder), 0)


def test_the_command_of_a_task_ramps_up_after_a_second_of_standing():
    task = Task('fast', (1.0, 0.0, -0.8))
    assert task(0.5).tolist() == [0.0, 0.0, 0.0]
    assert task(1.2) == pytest.approx([0.2, 0.0, -0.4])
    assert task(5.0) == pytest.approx([1.0, 0.0, -0.8])


@pytest.mark.parametrize('text', ['backwards', 'x=1,2', 'x=a,b,c', 'x=9,0,0', 'x=nan,0,0'])
def test_tasks_that_are_none_are_refused(text):
    with pytest.raises(InputError, match='task'):
        parse_tasks([text])


def test_tasks_of_ones_own_are_read():
    assert parse_tasks(['turn', 'arc=0.5,0,-0.4'])[1] == Task('arc', (0.5, 0.0, -0.4))


def judged(reached_error, fell_at=None, pushed_at=None, kick=0.0):
    count, step = 400, 0.02
    commands = np.zeros((count, 2, 3))
    commands[200:] = (0.5, 0.1, 0.3)
    reached = commands - np.asarray(reached_error)
    fell = np.zeros((count, 2), bool)
    pushed = np.zeros((count, 2), bool)
    if fell_at is not None:
        fell[fell_at, 0] = True
    if pushed_at is not None:
        pushed[pushed_at] = True
        reached[pushed_at : pushed_at + 90] += kick
    config = RobustnessConfig(robots=2, seconds=8.0)
    return _judge(config, commands, reached, fell, pushed, step)


def test_errors_of_trials_are_those_of_settled_walking():
    found = judged((0.1, -0.05, 0.2))
    assert found.mean_error == pytest.approx({'vx': 0.1, 'vy': 0.05, 'yaw': 0.2})
    assert found.following
    assert judged((0.0, 0.0, 0.0), pushed_at=300, kick=1.0).mean_error['vx'] < 1e-9


def test_a_fall_or_a_large_error_is_not_following():
    assert not judged((0.0, 0.0, 0.0), fell_at=100).following
    assert judged((0.0, 0.0, 0.0), fell_at=100).falls == 1
    one = judged((0.0, 0.0, 0.0), fell_at=100)
    assert one.fell_95[0] < 1.0 / one.robots < one.fell_95[1]
    assert not judged((0.2, 0.0, 0.0)).following
    assert not judged((0.0, 0.0, 0.25)).following


def entry(name, supply, kfe, away=0.0):
    return {
        'name': name,
        'task': 'forward',
        'power_w': {'supply': supply, 'KFE': kfe, 'HFE': 50.0, 'HAA': 20.0},
        'tracking': {'vx': away, 'vy': 0.0, 'yaw': 0.0},
    }


def test_the_verdict_compares_with_the_first_policy():
    (sentence,) = verdict([entry('baseline', 800.0, 200.0), entry('pmp', 600.0, 100.0)], {})
    assert '-25 % at the supply' in sentence
    assert 'KFE -50 %' in sentence
    assert 'misses' not in sentence


def test_a_change_has_the_interval_that_both_walks_give_it():
    """800 ± 8 W against 600 ± 8 W: 100 · √(8² + (8 · 0.75)²) / 800 = 1.25 %."""
    first, other = entry('baseline', 800.0, 200.0), entry('pmp', 600.0, 100.0)
    first['power_interval_w'] = {'supply': [792.0, 808.0]}
    other['power_interval_w'] = {'supply': [592.0, 608.0]}
    (sentence,) = verdict([first, other], {})
    assert '-25 % (-26 … -24) at the supply' in sentence


def test_power_is_drawn_against_errors_of_one_unit_and_a_policy_keeps_its_colour():
    """Errors 0.3 and 0.4 m/s make 0.5 m/s; the yaw rate has an axis of its own."""
    one, two = entry('a', 400.0, 50.0), {**entry('b', 300.0, 50.0), 'task': 'turn'}
    one['tracking'] = {'vx': 0.3, 'vy': 0.4, 'yaw': -0.2}
    figure = pareto_front([one, two], {'a': '#111111', 'b': '#222222'})
    speed, yaw = figure['data'][:2]
    assert (speed['x'], yaw['x']) == ([0.5], [0.2])
    titles = [figure['layout'][axis]['title']['text'] for axis in ('xaxis', 'xaxis2')]
    assert [title.rsplit(' ')[-1] for title in titles] == ['m/s', 'rad/s']
    assert [trace['marker']['color'] for trace in figure['data'][:4]] == [
        *(['#111111'], ['#111111'], ['#222222'], ['#222222'])
    ]


def test_power_saved_by_not_walking_is_called_so():
    (sentence,) = verdict([entry('a', 800.0, 200.0), entry('b', 300.0, 50.0, away=0.5)], {})
    assert 'misses the command in vx' in sentence


def test_the_falls_front_has_mean_power_and_the_share_that_fell_of_each_policy():
    entries = [entry('a', 400.0, 50.0), entry('a', 600.0, 50.0), entry('b', 300.0, 50.0)]
    figure = falls_front(
        entries,
        {'a': {'falls': 1, 'robots': 64}, 'c': {'falls': 0, 'robots': 8}},
        {'a': '#111111', 'c': '#222222'},
    )
    points = [(p['text'][0], p['x'][0], p['y'][0]) for p in figure['data']]
    assert points == [('a', 1.562, 500.0), ('c', 0.0, None)]


def test_the_command_writes_json_and_a_page_that_needs_no_network(tmp_path, network_run, capsys):
    page, figures = tmp_path / 'e.html', tmp_path / 'e.json'
    arguments = ['--policies', 'trot', '--tasks', 'turn', '--duration', '6', '--trials', '0']
    models = ['--models', f'ppn:{network_run}']
    assert main([*arguments, *models, '--json', str(figures), '--report', str(page)]) == 0
    (found,) = json.loads(figures.read_text())['policies']
    assert {
        'name',
        'task',
        'power_w',
        'estimated_w',
        'tracking',
        'falls',
        'cost_of_transport',
    } <= (found.keys())
    assert set(found['power_w']) == {'supply', 'electronics', 'idle', 'HAA', 'HFE', 'KFE'}
    assert found['cost_of_transport'] is None
    assert set(found['tracking']) == {'vx', 'vy', 'yaw'}
    text = re.sub(r'<script.*?</script>', '', page.read_text(), flags=re.DOTALL)
    assert not re.search(r'(src|href)="https?:', text)
    assert 'Content-Security-Policy' in text
    assert 'trot' in capsys.readouterr().out


def test_a_command_that_holds_all_the_time_counts_after_a_second_and_a_half():
    told = SimpleNamespace(
        stamp_ns=np.arange(0, 5_000_000_000, 100_000_000),
        velocity=np.tile(np.float32([0.6, 0.0, 0.0]), (50, 1)),
    )
    recording = SimpleNamespace(cmd_vel=lambda: told)
    held = _held(recording, np.array([0.5, 1.4, 1.6, 4.0]), Task('forward', (0.6, 0.0, 0.0)))
    assert held.tolist() == [False, False, True, True]


def test_a_bag_of_running_nodes_is_evaluated_by_the_command_that_it_holds(tmp_path):
    bag = tmp_path / 'walk'
    world = walking_world()
    controller = PolicyWalk('trot', load_policy('trot'), Task('x', (0.3, 0.0, 0.5)))
    run = OfflineRun(Plant.load('anymal_c'), world, controller, duration=6.0, seed=2)
    write_bag(bag, run, Card(robot='anymal_c', drives=world.joints, controller='trot'))
    walk = recorded_walk(bag, 'mine')
    assert walk.task.command == (0.3, 0.0, 0.5)
    assert walk.task.name == '0.3,0,0.5'
    assert walk.falls == 0
    assert walk.steady.any()
    since = walk.data.time - walk.data.time[0]
    assert not walk.steady[since < 2.7].any()
    figures = tmp_path / 'e.json'
    assert main(['--bags', f'mine={bag}', '--json', str(figures)]) == 0
    (found,) = json.loads(figures.read_text())['policies']
    assert found['name'] == 'mine'
    assert found['power_w']['supply'] == pytest.approx(walk.data.supply[walk.steady].mean())


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ([], 'nothing to evaluate'),
        (['--bags', 'walk'], 'NAME=BAG'),
        (['--bags', 'a=nowhere'], 'nowhere'),
        (['--policies', 'gallop'], "'gallop'"),
        (['--policies', 'trot', 'trot'], 'called the same'),
        (['--policies', 'trot', '--duration', '1'], '5..600'),
        (['--policies', 'trot', '--tasks', 'fly'], "'fly'"),
        (['--policies', 'trot', '--models', 'ppn:nowhere'], 'nowhere'),
        (['--policies', 'trot', '--plant', 'nowhere'], 'nowhere'),
    ],
)
def test_bad_input_ends_with_one_line_and_code_2(capsys, arguments, words):
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert '\n' not in error
