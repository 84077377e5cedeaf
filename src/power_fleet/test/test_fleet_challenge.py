"""Sealed histories of two robots."""

import numpy as np
import pytest
from power_fleet.commands.arguments import challenge, reveal
from power_fleet.fleet_challenge import draw_fleet
from power_lab.challenge.challenge import SEALED
from power_lab.commands.challenge import DRIVES
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError


def test_half_of_the_fleets_are_quiet_and_the_others_change_within_their_limits():
    drawn = [draw_fleet(seed, 40, 30.0) for seed in range(200)]
    assert 80 <= sum(one.kind == 'quiet' for one in drawn) <= 120
    for one in drawn:
        ageing = [bool(plan.age) for plan in one.plans]
        assert sum(ageing) == (one.course is not None)
        if one.course is None:
            continue
        assert ageing[one.robot]
        size = abs(one.course.size)
        low, high = {'power_gain': (0.03, 0.06), 'current_offset': (0.02, 0.04)}.get(
            one.course.effect, (0.25, 0.6)
        )
        assert low <= size <= high
        (hidden,) = one.answer()['hidden']
        days = [day.day for day in one.plans[one.robot].days]
        assert days[hidden['recording']] >= one.course.begin > days[hidden['recording'] - 1]


def test_robots_take_turns_and_a_week_is_missing():
    for seed in range(80):
        plans = draw_fleet(seed, 40, 30.0).plans
        days = sorted(day.day for plan in plans for day in plan.days)
        assert len(days) == 40
        assert plans[0].unit != plans[1].unit
        assert np.diff(days).max() >= 8


def test_the_answer_of_a_seed_is_always_the_same_and_too_few_recordings_are_refused():
    assert draw_fleet(3, 40, 30.0) == draw_fleet(3, 40, 30.0)
    with pytest.raises(InputError, match='--recordings 15: give at least 16'):
        draw_fleet(3, 15, 30.0)


def test_a_fleet_is_recorded_sealed_and_revealed(tmp_path, capsys, monkeypatch):
    folder, seed = tmp_path / 'fleet', 0
    while draw_fleet(seed, 16, 10.0).course is None:
        seed += 1
    run = ['--seed', str(seed), '--recordings', '16', '--duration', '10']
    assert challenge([*run, '-o', str(folder), '--workers', '2']) == 0
    told = capsys.readouterr().out
    bags = sorted(folder.glob('robot_*'))
    assert len(bags) == 16
    cards = [Recording.open(bag).card for bag in bags]
    assert len({card.unit for card in cards}) == 2
    assert all(card.created and 'temperature' in card.other for card in cards)
    (hidden,) = draw_fleet(seed, 16, 10.0, DRIVES).answer()['hidden']
    sealed = (folder / SEALED).read_text()
    assert hidden['words'] not in sealed + told
    assert not any(hidden['effect'] in (bag / 'card.yaml').read_text() for bag in bags)
    assert reveal([str(folder)]) == 0
    assert hidden['words'] in capsys.readouterr().out
    assert challenge([*run, '-o', str(folder)]) == 2
    assert 'is there already; give another folder' in capsys.readouterr().err
