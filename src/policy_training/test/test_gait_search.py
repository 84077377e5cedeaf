import json
from dataclasses import replace

import numpy as np
import pytest
from policy_runner.policies.trot_gait import TROTS
from policy_training.commands.arguments import optimise_gait
from policy_training.config import TrainingConfig, TrialConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.environment.power_term import PlantPower
from policy_training.environment.robots import Substep
from policy_training.evaluation.task_trial import TaskTrial, TrialScore
from policy_training.learning.gait_files import (
    GaitSearchFolder,
    load_gait,
    load_gait_table,
    with_clock_of_gait,
)
from policy_training.learning.gait_search import (
    RANGES,
    GaitSearch,
    GaitSearchConfig,
    GaitTrial,
    start_of,
    to_gait,
    to_point,
    try_gaits,
)
from sim_bridge.plant.parameters import Plant
from wattwalk_core.errors import InputError

START = start_of(TROTS['trot_even'])
TRIAL = TrialConfig(calm=1, pushed=1, seconds=5.0)
SMALL = GaitSearchConfig(population=4, trial=TRIAL)


def quadratic(gait):
    return 400.0 * (gait.height - 0.56) ** 2 + (gait.foot_y - 0.2) ** 2


def walk(search, generations):
    for _ in range(generations):
        search.tell([quadratic(gait) for gait in search.ask()])
    return search


def test_a_gait_and_its_point_are_the_same_within_the_ranges():
    point = np.linspace(0.1, 0.9, len(RANGES))
    np.testing.assert_allclose(to_point(to_gait(START, point)), point, atol=1e-9)


def test_an_urgent_value_that_is_none_starts_at_the_calm_one():
    place = list(RANGES).index('urgent_foot_y')
    low, high = RANGES['urgent_foot_y']
    assert to_point(START)[place] == pytest.approx((START.foot_y - low) / (high - low))


def test_the_search_finds_the_bottom_of_a_bowl():
    found = walk(GaitSearch(replace(SMALL, population=12), START), 60).centre
    assert found.height == pytest.approx(0.56, abs=0.01)
    assert found.foot_y == pytest.approx(0.2, abs=0.03)


def test_a_search_that_is_told_its_costs_again_asks_for_the_same_gaits(tmp_path):
    folder, search = GaitSearchFolder(tmp_path / 'g'), GaitSearch(SMALL, START)
    folder.start(SMALL, 'trot_even')
    costs = []
    for _ in range(5):
        costs.append([quadratic(gait) for gait in search.ask()])
        search.tell(costs[-1])
    lines = ''.join(json.dumps({'costs': row}) + '\n' for row in costs)
    (tmp_path / 'g' / 'generations.jsonl').write_text(lines + '{"costs": [1.0, 2')
    np.random.seed(99)  # noqa: NPY002  # nobody's global numbers count
    again = GaitSearch(folder.resume()[0], START)
    folder.replay(again)
    assert again.generation == 5
    assert again.ask() == search.ask()
    assert (tmp_path / 'g' / 'generations.jsonl').read_text() == lines


@pytest.fixture(scope='module')
def scores():
    """Scores of the gait that policies imitate, and of one with wide, deep steps."""
    wide = replace(START, foot_y=0.34, height=0.46, swing_height=0.14)
    return try_gaits(TaskTrial(TRIAL, 2, threads=1), [START, wide], seed=3)


def test_wide_deep_and_high_steps_draw_more(scores):
    even, wide = scores
    assert even.power > 150.0
    assert wide.power > 1.3 * even.power
    assert even.cost >= even.power


def test_a_score_names_every_task_and_its_sum_is_their_mean(scores):
    assert list(scores[0].by_task) == ['forward', 'fast', 'turn', 'sideways']
    assert scores[0].power == pytest.approx(np.mean(list(scores[0].by_task.values())))


def test_the_plants_power_of_a_still_motor_is_copper_loss_and_idle():
    plant = Plant.load('anymal_c')
    torque, still = np.full((1, 12), 20.0), np.zeros((1, 12))

    def watts(motor):
        step = Substep(still, still, still, motor, still)
        return PlantPower(plant, 1, 0.005).drives([step, step])

    loaded, idle = watts(torque), watts(still)
    resistance = plant.resolve(['LF_HAA'])['resistance'][0]
    constant = plant.resolve(['LF_HAA'])['torque_constant'][0]
    assert (idle > 0.0).all()
    assert loaded[0, 0] - idle[0, 0] > 0.9 * resistance * (20.0 / constant) ** 2
    assert np.allclose(watts(-torque), loaded), 'a still motor loses the same either way'


def test_a_robots_power_does_not_depend_on_its_neighbours():
    plant, random = Plant.load('anymal_c'), np.random.default_rng(0)
    motor, speed = random.normal(0, 20, (3, 12)), random.normal(0, 3, (3, 12))
    many = PlantPower(plant, 3, 0.005).drives([Substep(motor, motor, speed, motor, speed)])
    one = PlantPower(plant, 1, 0.005).drives(
        [Substep(*(x[1:2] for x in (motor, motor, speed, motor, speed)))]
    )
    np.testing.assert_allclose(many[1], one[0], rtol=1e-9)


def test_a_found_gait_sets_the_clock_of_the_policy_that_imitates_it(tmp_path):
    values = {'frequency': 1.4, 'frequency_per_speed': 0.5, 'height': 0.58, 'urgent_foot_y': 0.3}
    (tmp_path / 'gait.yaml').write_text(json.dumps({'base': 'trot_even', 'values': values}))
    gait = load_gait(str(tmp_path))
    assert (gait.height, gait.urgent_foot_y) == (0.58, 0.3)
    config = TrainingConfig().with_values({'imitation.gait': str(tmp_path)})
    clocked = with_clock_of_gait(config)
    assert clocked.observation.stride_frequency == 1.4
    assert clocked.observation.frequency_per_speed == 0.5
    environment = WalkingEnvironment(clocked.with_values({'physics.environments': 2}))
    assert environment.observation.frequency_per_speed == 0.5


def test_a_shipped_gait_loads_by_its_name_and_is_named_where_one_is_not_found():
    gait = load_gait('trot_economy')
    assert gait.frequency_per_speed > 0.5
    assert TrainingConfig.load('economy').imitation.gait == 'trot_economy'
    with pytest.raises(InputError, match='trot_even, trot_economy, trot_sturdy, or give'):
        load_gait('trot_nowhere')


AT = [{'command': [1.0, 0, 0], 'values': {}}, {'command': [0, 0.4, 0], 'values': {}}]


def test_gaits_by_command_are_read_with_what_they_have_in_common(tmp_path):
    path = tmp_path / 'gait.yaml'
    own = [AT[0] | {'values': {'height': 0.5}}, AT[1] | {'values': {'foot_y': 0.2}}]
    given = {'base': 'trot_even', 'values': {'height': 0.6, 'damping': 2.0}, 'by_command': own}
    path.write_text(json.dumps(given))
    table = load_gait_table(str(path))
    assert table.commands == ((1.0, 0.0, 0.0), (0.0, 0.4, 0.0))
    assert [(g.height, g.damping) for g in table.gaits] == [(0.5, 2.0), (0.6, 2.0)]
    assert load_gait(str(path)).height == 0.6
    assert load_gait_table('trot_even') is None


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ({'base': 'gallop', 'values': {}}, 'gallop'),
        ({'base': 'trot', 'values': {}, 'by_command': AT[:1]}, '1 commands and 1 gaits'),
        (
            {'base': 'trot', 'values': {}, 'by_command': [{'command': [1], 'values': {}}]},
            'command',
        ),
        (
            {'base': 'trot', 'values': {}, 'by_command': [AT[0] | {'values': {'frequency': 2.0}}]},
            "'frequency'; give it once",
        ),
        ({'base': 'trot', 'values': {'wings': 2.0}}, 'wings'),
        ({'base': 'trot', 'values': {'height': 0.9}}, '0.9'),
    ],
)
def test_a_bad_gait_file_is_refused_with_the_value_that_is_wrong(tmp_path, content, words):
    (tmp_path / 'gait.yaml').write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        load_gait(str(tmp_path / 'gait.yaml'))


def test_the_command_searches_goes_on_and_writes_a_gait_that_loads(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        'policy_training.learning.gait_search.try_gaits',
        lambda trial, gaits, seed: [fake_score(gait) for gait in gaits],
    )
    run = str(tmp_path / 'run')
    assert optimise_gait(['-o', run, '--generations', '2', '--population', '4']) == 0
    assert optimise_gait(['-o', run, '--generations', '3', '--resume']) == 0
    assert 'imitation.gait=' in capsys.readouterr().out
    rows = (tmp_path / 'run' / 'generations.jsonl').read_text().splitlines()
    assert [json.loads(row)['generation'] for row in rows] == [1, 2, 3]
    assert load_gait(run).height > 0.4
    assert optimise_gait(['-o', run]) == 2
    assert '--resume' in capsys.readouterr().err


def searched(folder, task, frequency):
    config = replace(SMALL, task=task)
    GaitSearchFolder(folder).start(config, 'trot_even')
    values = {'frequency': frequency, 'height': 0.55}
    (folder / 'gait.yaml').write_text(json.dumps({'base': 'trot_even', 'values': values}))
    return folder


def test_searches_of_a_task_each_join_to_a_gait_with_one_line_of_frequency_over_speed(
    tmp_path, capsys
):
    tasks = {'turn': 1.2, 'forward': 1.8, 'fast': 2.2}  # at 0, 0.6 and 1 m/s
    runs = [str(searched(tmp_path / task, task, hz)) for task, hz in tasks.items()]
    assert optimise_gait(['--join', *runs, '-o', str(tmp_path / 'all')]) == 0
    assert '1.20 Hz, and 1.00 Hz more for each m/s' in capsys.readouterr().out
    gait, table = (load(str(tmp_path / 'all')) for load in (load_gait, load_gait_table))
    assert (gait.frequency, gait.frequency_per_speed) == pytest.approx((1.2, 1.0), abs=1e-3)
    assert [command for command in table.commands][1] == (0.6, 0.0, 0.0)
    assert {shape.height for shape in table.gaits} == {0.55}
    assert optimise_gait(['--join', runs[0], runs[0], '-o', str(tmp_path / 'two')]) == 2
    assert 'of different tasks' in capsys.readouterr().err


def test_a_search_of_one_task_walks_that_alone_and_leaves_the_line_over_speed_out():
    config = replace(SMALL, task='turn')
    assert len(config.searched) == len(RANGES) - 1
    trial = GaitTrial(config, 1, threads=1)
    (score,) = trial.scores([START], 7)
    assert list(score.by_task) == ['turn']
    assert score.cost > score.power
    (again,) = trial.scores([START], 8)
    assert again.power == score.power, 'calm robots walk the same way whatever the pushes'
    with pytest.raises(InputError, match="task is 'hop'; it must be one of forward, fast"):
        replace(SMALL, task='hop')


def fake_score(gait):
    cost = quadratic(gait)
    return TrialScore(cost, cost, 1.0, 0.0, 0.0, 0.0, {'forward': cost})
