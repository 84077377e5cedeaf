"""Rows of measured power and estimates over the same 20 ms."""

import numpy as np
import pytest
from power_estimator.drive_types import DriveType
from power_estimator.network.checkpoint import FILE, Checkpoint, Network, NetworkConfig
from power_estimator.network.features import Scaling
from power_estimator.network.lstm import Weights
from power_recordings.card import Card
from power_recordings.messages.cdr import (
    battery_block,
    drive_supply_blocks,
    in_a_list,
    joint_state_block,
)
from power_workbench.live.follower import PERIOD, LiveFollower, RollingPower
from power_workbench.server.actions import keep_note
from wattwalk_core.yaml_file import read_yaml

MS = 1_000_000


def samples(first_ms, count, *watts):
    """Stamps at 1 kHz, and constant power of as many drives as there are watts."""
    stamps = (first_ms + np.arange(count)) * MS
    return stamps.astype(np.int64), np.tile(np.array(watts, float), (count, 1))


def test_a_row_is_the_mean_of_the_samples_that_its_estimate_covers():
    rolling = RollingPower()
    stamps = (1000 + np.arange(100)) * MS
    rolling.measured(['A'], stamps, np.arange(100.0)[:, None])
    rolling.estimated(['A'], 1050 * MS, np.array([40.0]))
    rows = rolling.rows()
    assert rows.stamp_ns[-1] == 1050 * MS
    # After 1030 ms up to 1050 ms: the samples 31 to 50.
    assert rows.measured[-1].tolist() == [pytest.approx(40.5), pytest.approx(40.5)]
    assert rows.estimate[-1].tolist() == [40.0, 40.0]


def test_without_estimates_rows_follow_one_another_at_50_hz():
    rolling = RollingPower()
    rolling.measured(['A', 'B'], *samples(1000, 1000, 2.0, 3.0))
    rows = rolling.rows()
    assert set(np.diff(rows.stamp_ns).tolist()) == {PERIOD}
    assert len(rows.stamp_ns) == pytest.approx(35, abs=1)
    assert np.unique(rows.measured, axis=0).tolist() == [[2.0, 3.0, 5.0]]
    assert np.isnan(rows.estimate).all()
    assert rolling.rows() is None


def test_rows_come_once_and_in_order_when_estimates_begin_late():
    rolling, found = RollingPower(), []
    for block in range(20):
        rolling.measured(['A'], *samples(1000 + 100 * block, 100, 1.0))
        if block >= 10:
            for stamp in range(1000 + 100 * block, 1100 + 100 * block, 20):
                rolling.estimated(['A'], stamp * MS, np.array([2.0]))
        rows = rolling.rows()
        found += [] if rows is None else rows.stamp_ns.tolist()
    assert found == sorted(set(found))
    assert np.diff(found).max() < 2 * PERIOD


def test_the_sum_counts_only_drives_that_measurement_and_model_both_know():
    rolling = RollingPower()
    rolling.measured(['A', 'B'], *samples(1000, 100, 2.0, 30.0))
    rolling.estimated(['A', 'C'], 1090 * MS, np.array([1.0, 500.0]))
    rows = rolling.rows()
    assert rows.names == ('A', 'B', 'C')
    assert rows.measured[-1, -1] == 2.0
    assert rows.estimate[-1, -1] == 1.0


def test_samples_that_do_not_count_are_left_out_of_the_mean():
    rolling = RollingPower()
    stamps, power = samples(1000, 100, 2.0)
    power[:50] = np.nan
    rolling.measured(['A'], stamps, power)
    rolling.estimated(['A'], 1040 * MS, np.array([1.0]))
    rolling.estimated(['A'], 1060 * MS, np.array([1.0]))
    rows = rolling.rows()
    assert np.isnan(rows.measured[-2, 0])
    assert rows.measured[-1, 0] == 2.0


def test_estimates_are_shown_where_nothing_is_measured():
    rolling = RollingPower()
    for stamp in range(1000, 2000, 20):
        rolling.estimated(['A'], stamp * MS, np.array([7.0]))
    rows = rolling.rows()
    assert rows.estimate[:, 0].tolist() == [7.0] * len(rows.stamp_ns)
    assert len(rows.stamp_ns) > 30
    assert np.isnan(rows.measured).all()


def test_a_clock_that_is_set_back_begins_anew():
    rolling = RollingPower()
    rolling.measured(['A'], *samples(100_000, 500, 1.0))
    rolling.rows()
    rolling.measured(['A'], *samples(1000, 500, 9.0))
    rows = rolling.rows()
    assert rows.stamp_ns[0] < 2000 * MS
    assert np.unique(rows.measured[:, 0]).tolist() == [9.0]


def test_silence_is_said_with_its_length_and_what_to_start():
    follower = LiveFollower(100.0)
    assert all('drive_supply' not in text for text in follower.news(101.0)['said'])
    said = follower.news(104.2)['said']
    assert said[0] == 'no drive_supply heard for 4 s: start `ros2 run wattwalk_bringup live`'
    assert any('no model' in text for text in said)


def test_the_budget_joins_the_meters_and_what_the_estimator_reports():
    """48 V · 1 A at the drive, of which 40 W are explained; 50 V · 2 A at the supply."""
    follower, stamps = LiveFollower(0.0), MS * np.arange(100)
    drives = in_a_list(
        *drive_supply_blocks(
            stamps, 0, stamps, ['A'], 48.0, np.ones((100, 1)), [40.0], np.zeros((100, 1))
        )
    )
    supply = in_a_list(battery_block(10 * stamps, [50.0] * 100, [-2.0] * 100))
    for topic, messages in (('drive_supply', drives), ('supply', supply)):
        for message in messages:
            follower.buffers[topic].take(message, 1.0)
    assert follower.news(1.0)['budget']['parts'] == {'electronics': 52.0, 'drives': 48.0}
    follower.report({'copper_loss [W]': '40.0'}, 1.0)
    assert follower.news(1.5)['budget'] == {
        'parts': {'electronics': 52.0, 'copper_loss': 40.0, 'unexplained': 8.0},
        'metered_w': 100.0,
    }
    assert follower.news(9.0)['budget'] == {'parts': {}, 'metered_w': None}


def test_a_model_that_cannot_be_read_is_said_and_the_measurement_goes_on(tmp_path):
    follower = LiveFollower(0.0)
    follower.use(str(tmp_path / 'no_such.yaml'))
    assert any('no_such.yaml' in text for text in follower.news(0.5)['said'])


def test_notes_of_a_session_add_up_with_their_times_and_recordings(tmp_path):
    keep_note(tmp_path, 'it slipped', 'bags/walk')
    keep_note(tmp_path, 'it: stood up', '')
    first, second = read_yaml(tmp_path / 'notes.yaml', 'notes')
    assert (first['text'], first['recording']) == ('it slipped', 'bags/walk')
    assert second['text'] == 'it: stood up'
    assert 'recording' not in second
    assert first['time'] <= second['time']


def test_a_card_keeps_marks_with_their_times(tmp_path):
    card = Card(robot='x').with_mark(1_700_000_000_250 * MS, 'left: "slipped"')
    card.save(tmp_path)
    (mark,) = Card.load(tmp_path).marks
    assert (mark.time, mark.text) == ('2023-11-14T22:13:20.250+00:00', 'left: "slipped"')
    Card(robot='x').save(tmp_path)
    assert 'marks' not in (tmp_path / 'card.yaml').read_text()


def fill(follower, *, targets):
    """Half a second of one joint that carries 10 N·m at 2 rad/s."""
    stamps, zeros = 5_000_000_000 + 2_500_000 * np.arange(200), np.zeros((200, 1))
    for row in in_a_list(joint_state_block(stamps, ['A_HAA'], zeros, zeros + 2.0, zeros + 10.0)):
        follower.buffers['joint_states'].take(row, 0.4)
    for row in in_a_list(joint_state_block(stamps, ['A_HAA'], zeros)) if targets else ():
        follower.buffers['joint_commands'].take(row, 0.4)


@pytest.mark.parametrize('targets', [False, True])
def test_a_model_that_needs_no_targets_is_estimated_without_joint_commands(targets):
    follower = LiveFollower(0.0)
    follower.use('mechanical_power')
    fill(follower, targets=targets)
    news = follower.news(0.5)
    assert [value for value in news['estimate'][0] if value is not None][-1] == 20.0
    assert not any('model' in text for text in news['said'])


def test_no_target_is_made_up_for_a_network(tmp_path):
    shapes = ((4, 3), (4, 1), (4,), (1,), (1,))
    scaling = Scaling((0.0, 0.0, 0.0), (0.1, 15.0, 3.0), 40.0, 50.0)
    weights = Weights(*(np.zeros(shape, np.float32) for shape in shapes))
    drive = DriveType('HAA', ('*_HAA',))
    bounds = ((-9.0, -900.0, -90.0), (9.0, 900.0, 90.0))
    known = Checkpoint(NetworkConfig(hidden=1), (Network(drive, scaling, *bounds, weights),))
    known.save(tmp_path / FILE)
    follower = LiveFollower(0.0)
    follower.use(f'ppn:{tmp_path}')
    fill(follower, targets=False)
    news = follower.news(4.0)
    assert news['estimate'] == []
    assert 'no joint_commands heard for 4 s: the model has no input' in news['said']
