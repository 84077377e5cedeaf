from dataclasses import replace

import numpy as np
import pytest
from power_estimator.judge.held_out import held_out_rows
from power_estimator.judge.recordings import Loaded
from power_estimator.live.estimator import LiveEstimator, LiveSample
from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.features import features
from power_estimator.network.ppn import PowerPredictionNetwork
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

from power_estimator import recordings


def test_the_features_trained_on_are_those_that_the_live_node_forms(bag, checkpoint, monkeypatch):
    data = recordings.load([bag], [])
    trained = recordings.live_features([bag], data)
    seen: list[LiveSample] = []
    advance = LiveEstimator._advance
    monkeypatch.setattr(
        LiveEstimator, '_advance', lambda self, s: (seen.append(s), advance(self, s))[1]
    )
    live = LiveEstimator(PowerPredictionNetwork(checkpoint), data.names)
    recording = Recording.open(bag)
    states, commands = recording.joint_states(), recording.joint_commands()
    first = int(np.searchsorted(states.stamp_ns, round(data.time[0] * 1e9) - 1000))
    for row in range(first, len(states)):
        held = int(np.searchsorted(commands.stamp_ns, states.stamp_ns[row], side='right')) - 1
        live.command(int(commands.stamp_ns[held]), commands.position[held])
        signals = (states.position[row], states.velocity[row], states.effort[row])
        live.joint_state(int(states.stamp_ns[row]), *signals)
    formed = [np.stack([s[3] - s[0], s[2], s[1]], axis=1) for s in (one.signals for one in seen)]
    ends = np.array([s.stamp for s in seen[: len(trained)]]) / 1e9
    assert np.allclose(ends, data.time + 0.0025, atol=1e-6)
    assert np.allclose(formed[: len(trained)], trained, atol=1e-3)


def test_the_live_features_are_close_to_the_smoothed_ones(bag):
    data = recordings.load([bag], [])
    live = recordings.live_features([bag], data)
    assert live.shape == features(data).shape
    assert np.isnan(live).mean() < 0.01
    for column in range(3):
        smoothed = features(data)[..., column].ravel()
        known = np.isfinite(live[..., column].ravel())
        assert np.corrcoef(smoothed[known], live[..., column].ravel()[known])[0, 1] > 0.9


def test_a_moved_recording_is_known_by_its_hash_and_a_changed_one_is_not(bag, bags, tmp_path):
    moved = tmp_path / 'elsewhere'
    moved.mkdir()
    for file in bag.iterdir():
        (moved / file.name).write_bytes(file.read_bytes())
    assert recordings.describe(moved).sha256 == recordings.describe(bag).sha256
    other = bags(tmp_path / 'other', 5.0, seed=9)
    assert recordings.describe(other).sha256 != recordings.describe(bag).sha256


def test_drives_are_chosen_by_pattern_and_the_supply_then_says_nothing(bag):
    data = recordings.load([bag], ['*_HFE'])
    assert data.names == ('LF_HFE',)
    assert np.isnan(data.supply).all()
    with pytest.raises(InputError, match=r"'\*_KFE': there are LF_HAA, LF_HFE"):
        recordings.load([bag], ['*_KFE'])


def test_only_the_test_part_of_a_known_recording_is_judged_on(drives, checkpoint):
    given = Loaded.of(drives(20.0))
    time, recording = given.data.time, given.data.recording
    span = [float(time[100]), float(time[199])]

    def rows(*trained):
        ppn = PowerPredictionNetwork(replace(checkpoint, recordings=trained))
        return held_out_rows(ppn, given, time, recording)

    known = TrainingRecording(**given.identities[0], held_out={'HAA': [span]})
    assert np.flatnonzero(rows(known)[:, 0]).tolist() == list(range(100, 200))
    assert rows(known)[:, 1].all()
    assert rows().all()
