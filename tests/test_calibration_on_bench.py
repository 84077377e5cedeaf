"""The simulated meter against the simulated analyser, whose truth the plant knows."""

import json

import numpy as np
import pytest
from calibration import plant_blocks, trial
from power_calibration.commands.arguments import calibrate as calibrate
from power_calibration.timing.delay import delay_of
from power_calibration.timing.summary import step_response
from power_recordings.card import Card
from power_recordings.reading.reader import Recording
from sim_bridge.commands.arguments import bench as bench
from sim_bridge.offline.run import OfflineRun, simulate_recording
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import Stand, stand_world

SEEDS = 5


@pytest.fixture(scope='module')
def trials():
    # 4 Hz folds onto itself at 1 kHz, this does not
    blocks = plant_blocks('sine', 10.0, 4.0371)
    return [trial(blocks, seed) for seed in range(SEEDS)]


@pytest.mark.parametrize(
    ('name', 'widest'),
    [
        ('voltage gain', 0.002),
        ('voltage offset', 0.08),  # V
        ('current gain', 0.004),
        ('current offset', 0.02),  # A
        ('time offset', 8e-6),  # s
        ('drift', 1.0),  # ppm
    ],
)
def test_intervals_hold_the_truth_of_meters_and_clocks_that_are_off(trials, name, widest):
    held = 0
    for _, made in trials:
        value, true, _, _ = made[name]
        half = 0.5 * (value.high - value.low)
        assert half < widest
        assert abs(value.value - true) < 2.5 * half
        held += value.low <= true <= value.high
    assert held >= SEEDS - 1


def test_the_bandwidth_is_that_of_the_meters_filter_delay_and_steps(trials):
    for found, made in trials:
        cutoff, bandwidth, _, _ = made['bandwidth']
        assert cutoff.value == pytest.approx(bandwidth, rel=0.1)
        assert 0 < cutoff.high - cutoff.low < 200.0
        assert 0 < found.loss.rms < found.loss.total


def test_calibration_takes_the_bias_away_and_never_adds_error(trials):
    for found, _ in trials:
        (before, after), (_, mean_after) = found.errors
        assert abs(mean_after) < 0.1
        assert after <= before + 0.01


def test_bench_writes_a_log_that_calibrate_reads(tmp_path, capsys):
    bag, log, json_file = tmp_path / 'bag', tmp_path / 'a.csv', tmp_path / 'c.json'
    wanted = ['sine', '--unit', '3', '--duration', '5', '-o', str(bag), '--analyser', str(log)]
    assert bench([*wanted, '--analyser-drift', '40', '--analyser-offset', '-5000']) == 0
    said = capsys.readouterr().out
    assert 'next: ros2 run power_calibration calibrate' in said
    arguments = [str(bag), '--reference', str(log), '-o', str(tmp_path / 'c.yaml')]
    assert calibrate([*arguments, '--json', str(json_file)]) == 0
    found = json.loads(json_file.read_text())
    errors = Plant.load('anymal_c').unit(3).resolve(['LF_KFE'])
    gain = found['channels']['LF_KFE.current']['gain']
    assert gain == pytest.approx(1 / errors['current_gain'][0], abs=1e-3)
    assert found['drift_ppm'] == pytest.approx(40.0, abs=5.0)
    assert Card.load(bag).drives == ('LF_KFE',)
    assert bench([*wanted[:-1], str(tmp_path / 'a.txt'), '--overwrite']) == 2


class Jumps:
    """Torque that jumps every quarter of a second and pushes as much one way as the other."""

    period = 5
    velocity = None
    name = 'jumps'

    def command(self, simulation):
        efforts = (30.0, 5.0, -30.0, -5.0)
        return JointCommand(effort=np.array([efforts[int(4 * simulation.time + 1e-9) % 4]]))

    def reset(self):
        pass


def test_jumps_of_torque_are_answered_when_the_meters_delay_says():
    heavy = stand_world('LF_KFE', Stand(inertia=5.0))
    stiff = Plant.load('anymal_c').with_effects(spring=False)
    run = OfflineRun(stiff, heavy, Jumps(), duration=5.0, seed=3)
    found = step_response(simulate_recording(run), 'LF_KFE')
    assert found.events == 19
    # a step's mean, the filter and the delay leave 53 % at 0.5 ms, 89 % at 1 ms
    assert found.current_half.value == pytest.approx(0.0005, abs=2.5e-4)


def shifted(recording, by):
    supply = recording.drive_supply()
    samples = {
        'drive_supply': supply.rows(slice(None)),
        'joint_states': recording.joint_states(),
    }
    moved = supply.stamp_ns + round(by * 1e9)
    object.__setattr__(samples['drive_supply'], 'stamp_ns', moved)
    return Recording.in_memory('moved', samples)


def test_a_shift_of_the_stamps_is_found_as_it_is_on_a_simulated_walk(walk_small):
    straight = delay_of(walk_small, 'LF_HFE').delay
    moved = delay_of(shifted(walk_small, 0.006), 'LF_HFE').delay
    assert straight.value == pytest.approx(0.0006, abs=1.5e-3)
    assert moved.value - straight.value == pytest.approx(0.006, abs=3e-4)


@pytest.fixture(scope='module')
def walk_small(request):
    return Recording.open(request.config.rootpath / 'bags' / 'walk_small')
