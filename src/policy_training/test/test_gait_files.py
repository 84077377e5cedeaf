import json

import pytest
from policy_training.config import TrainingConfig
from policy_training.environment.environment import WalkingEnvironment
from policy_training.learning.gait_files import load_gait, load_gait_table, with_clock_of_gait
from wattwalk_core.errors import InputError


def test_a_found_gait_sets_the_clock_of_the_policy_that_imitates_it(tmp_path):
    values = {'frequency': 1.4, 'frequency_per_speed': 0.5, 'height': 0.58, 'urgent_foot_y': 0.3}
    file = tmp_path / 'gait.yaml'
    file.write_text(json.dumps({'base': 'trot_even', 'values': values}))
    gait = load_gait(str(file))
    assert (gait.height, gait.urgent_foot_y) == (0.58, 0.3)
    config = TrainingConfig().with_values({'imitation.gait': str(file)})
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
