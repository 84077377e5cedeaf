import numpy as np
import pytest
from policy_runner.commands.run import main
from policy_runner.policies.velocity_commands import (
    CommandRange,
    RandomCommands,
    SteadyCommand,
    parse_velocity,
)
from wattwalk_core.errors import InputError

TIMES = np.arange(0.0, 600.0, 0.05)


def sample(seed, **span):
    commands = RandomCommands(seed, CommandRange(**span))
    return np.array([commands(time) for time in TIMES])


def test_the_same_seed_gives_the_same_commands_in_whatever_order_one_asks():
    forwards, backwards = RandomCommands(4), RandomCommands(4)
    ahead = [forwards(time) for time in TIMES]
    behind = [backwards(time) for time in TIMES[::-1]][::-1]
    assert np.array_equal(ahead, behind)
    assert not np.array_equal(ahead, sample(5))


def test_commands_stay_within_their_span_and_use_it():
    values = sample(1, forward=0.6, backward=0.4, lateral=0.3, yaw=0.7)
    assert -0.4 <= values[:, 0].min() < -0.3
    assert 0.5 < values[:, 0].max() <= 0.6
    assert 0.2 < np.abs(values[:, 1]).max() <= 0.3
    assert 0.6 < np.abs(values[:, 2]).max() <= 0.7


def test_commands_are_ramped_and_never_jump():
    values = sample(2, ramp=0.5)
    assert np.abs(np.diff(values, axis=0)).max() <= 1.4 * 0.05 / 0.5 + 1e-9


def test_walking_straight_sideways_turning_mixing_and_standing_all_occur():
    moving = np.abs(sample(3)) > 1e-9
    for pattern in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)):
        share = (moving == np.array(pattern, dtype=bool)).all(axis=1).mean()
        assert share > 0.02, pattern


def test_the_first_second_stands():
    assert not np.any([RandomCommands(seed)(0.99) for seed in range(20)])


@pytest.mark.parametrize(
    ('field', 'value'),
    [('forward', 3.0), ('lateral', -0.1), ('ramp', 3.0), ('weights', (0.0,) * 5)],
)
def test_impossible_spans_are_refused_with_their_value(field, value):
    with pytest.raises(InputError, match=r'expected|must'):
        CommandRange(**{field: value})


def test_a_held_velocity_stands_for_a_second_and_comes_in_over_another():
    held = SteadyCommand(parse_velocity('0.6,0,-0.8'))
    assert [held(time).tolist() for time in (0.0, 1.0, 1.5, 2.0, 99.0)] == [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [0.3, 0.0, -0.4],
        [0.6, 0.0, -0.8],
        [0.6, 0.0, -0.8],
    ]


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--velocity=fast'], "velocity is 'fast'; expected VX,VY,YAW"),
        (['--velocity=0.5,0'], "velocity is '0.5,0'; expected VX,VY,YAW such as"),
        (['--velocity=1.6,0,0'], 'within ±1.5 m/s'),
        (['--velocity=nan,0,0'], 'within ±1.5 m/s'),
        (['--velocity=1,0,0', '--random-commands'], 'exclude each other'),
    ],
)
def test_a_bad_velocity_is_refused_in_words(arguments, words, capsys):
    assert main(arguments) == 2
    assert words in capsys.readouterr().err
