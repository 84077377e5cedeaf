import json

import numpy as np
import pytest
from power_calibration.analyser.curve import Curve
from power_calibration.commands.arguments import sync as main
from power_calibration.timing.delay import delay_of
from power_calibration.timing.step_response import step_response
from power_calibration.timing.summary import clock_quality, stamp_qualities, summarise
from power_recordings.messages.samples import DriveSamples, JointSamples
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

DRIVE = 'LF_HFE'
START = 1_700_000_000_000_000_000
SECONDS = 16.0


def motion(time):
    """Position, speed, torque of a leg that never quite repeats itself."""
    phase = 2 * np.pi * 1.6 * time + 0.4 * np.sin(0.7 * time)
    rate = 2 * np.pi * 1.6 + 0.28 * np.cos(0.7 * time)
    angle = 0.4 * np.sin(phase) + 0.1 * np.sin(2 * phase + 1)
    speed = rate * (0.4 * np.cos(phase) + 0.2 * np.cos(2 * phase + 1))
    torque = 15 * np.sin(phase + 0.9) + 8 * np.sin(3 * phase) + 6 * np.sin(0.31 * time)
    return angle, speed, torque


def electrical(time):
    """Current at 48 V of a drive with losses that the proxy has no terms of its own for."""
    _, speed, torque = motion(time)
    drag = 1.4 * np.tanh(speed / 0.07) + 2.0 * speed / (1 + 0.05 * np.abs(speed))
    watts = (torque + drag) * speed + 0.018 * (torque + drag) ** 2 + 8.0
    return watts / 48.0


def recording(delay=0.0, noise=0.02, amps=None, seed=0, **changes):
    random = np.random.default_rng(seed)
    fast, slow = np.arange(0, SECONDS, 0.001), np.arange(0, SECONDS, 0.0025)
    angle, speed, torque = motion(slow)
    current = (electrical(fast - delay) if amps is None else amps(fast))[:, None]
    current = current + noise * random.standard_normal(current.shape)
    column = np.full((len(fast), 1), np.nan)
    samples = {
        'drive_supply': DriveSamples(
            stamp_ns=changes.get('stamps', START + np.rint(fast * 1e9).astype(np.int64)),
            names=(DRIVE,),
            sequence=changes.get('sequence', np.arange(len(fast), dtype=np.uint64)),
            device_time=np.rint(fast * 1e9 * (1 + 25e-6)).astype(np.uint64),
            voltage=np.full((len(fast), 1), 48.0),
            current=current,
            temperature=column,
            status=np.zeros((len(fast), 1), np.uint8),
        ),
        'joint_states': JointSamples(
            START + np.rint(slow * 1e9).astype(np.int64),
            (DRIVE,),
            angle[:, None] + 2e-4 * random.standard_normal((len(slow), 1)),
            speed[:, None],
            torque[:, None] + 0.1 * random.standard_normal((len(slow), 1)),
        ),
    }
    return Recording.in_memory('made', {**samples, **changes.get('topics', {})})


@pytest.mark.parametrize('delay', [-0.008, 0.0, 0.0006, 0.015])
def test_a_delay_between_power_and_joints_is_found_with_its_sign(delay):
    found = delay_of(recording(delay), DRIVE)
    assert found.delay.value == pytest.approx(delay, abs=4e-4)
    assert found.delay.low - 3e-4 <= delay <= found.delay.high + 3e-4
    assert found.delay.high - found.delay.low < 2e-3
    assert found.r2 > 0.99


def test_what_a_shift_costs_is_the_change_of_power_itself():
    def sine(time):
        return (100 + 50 * np.sin(2 * np.pi * 4 * time)) / 48

    found = delay_of(recording(amps=sine, noise=0.0), DRIVE)
    watts, percent = found.error_at(0.005)
    by_hand = 2 * np.sin(np.pi * 4 * 0.005)
    assert watts == pytest.approx(by_hand * 50 / np.sqrt(2), rel=0.01)
    assert percent == pytest.approx(100 * by_hand, rel=0.01)


def test_power_that_follows_no_joint_has_no_delay():
    random = np.random.default_rng(5)
    walk = np.convolve(
        random.standard_normal(int(SECONDS * 1000) + 99), np.ones(100) / 100, 'valid'
    )
    found = delay_of(recording(amps=lambda time: 2 + walk), DRIVE)
    assert found.delay is None
    assert summarise(recording(amps=lambda time: 2 + walk)).verdict.startswith(
        'Power does not depend'
    )


def test_a_drive_that_is_not_there_is_refused():
    with pytest.raises(InputError, match=r"'RF_KFE'.*LF_HFE"):
        delay_of(recording(), 'RF_KFE')


def test_a_recording_whose_drives_have_no_meter_of_their_own_is_refused_with_what_to_do():
    joints = recording().joint_states()
    with pytest.raises(InputError, match='give voltage and current in the map in place of supply'):
        summarise(Recording.in_memory('log', {'joint_states': joints}))


def test_jumps_of_command_are_events_of_known_time():
    late, period = 0.0032, 0.6437
    times = np.arange(0, SECONDS, 0.0025)
    target = np.where((times / period) % 2 < 1, 1.0, -1.0)
    jumps = times[1:][np.diff(target) != 0]

    def amps(time):
        count = np.searchsorted(jumps + late, time, side='right')
        return np.where(count % 2, -3.0, 3.0)

    commands = JointSamples(
        START + np.rint(times * 1e9).astype(np.int64),
        (DRIVE,),
        *(np.full((len(times), 1), np.nan) for _ in range(2)),
        target[:, None],
    )
    found = step_response(recording(amps=amps, topics={'joint_commands': commands}), DRIVE)
    assert found.events == len(jumps[(jumps > 0.1) & (jumps < SECONDS - 0.1)])
    assert found.current_half.value == pytest.approx(late - 0.0005 + 0.0003, abs=7e-4)
    assert found.current_half.low <= found.current_half.value <= found.current_half.high
    assert step_response(recording(), DRIVE) is None


def test_jitter_losses_and_the_devices_clock_are_told_by_stream():
    random = np.random.default_rng(1)
    count = int(SECONDS * 1000)
    sequence = np.arange(count, dtype=np.uint64)
    sequence[5000:] += np.uint64(7)
    even = sequence.astype(np.int64) * 1_000_000
    stamps = START + even + np.rint(20_000 * random.standard_normal(count)).astype(np.int64)
    made = recording(stamps=stamps, sequence=sequence)
    supply, joints = stamp_qualities(made)
    assert supply.topic == 'drive_supply'
    assert (supply.lost, supply.gaps, supply.by_sequence) == (7, 1, True)
    assert supply.spread == pytest.approx(20e-6, rel=0.05)
    assert supply.worst == pytest.approx(2.576 * 20e-6, rel=0.1)
    assert supply.rate == pytest.approx(1000.0, abs=0.01)
    assert (joints.lost, joints.by_sequence) == (0, False)
    assert joints.spread < 1e-9
    clock = clock_quality(recording())
    assert clock.drift == pytest.approx(25.0, abs=0.1)
    assert clock.spread < 2e-9


def test_the_command_writes_figures_page_and_picture(walk, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run = walk(seconds=6.0)
    fast, slow = np.arange(6000) / 1000, np.arange(2400) / 400
    for column in range(3):
        angle, speed, torque = motion(slow + column)
        run.position[:, column], run.velocity[:, column] = angle, speed
        run.effort[:, column] = torque
        run.current[:, column] = electrical(fast + column - 0.004)
    run.write(tmp_path / 'bag')
    assert main(['bag', '--json', 's.json', '--report', 's.html']) == 0
    said = capsys.readouterr().out
    assert 'late against joint stamps' in said
    assert 'next: ' in said
    with open('s.json') as file:
        found = json.load(file)
    assert found['delay'] == pytest.approx(0.004, abs=5e-4)
    assert set(found['drives']) == {'LF_HAA', 'LF_HFE', 'LF_KFE'}
    assert found['smoothing']['gain']['50'] == pytest.approx(-0.116, abs=1e-3)
    assert 'Synchronisation of bag' in (tmp_path / 's.html').read_text()
    assert main(['bag', '--drives', 'LF_KFE', '--report', 's.png']) == 0
    assert main(['bag', '--report', 's.txt']) == 2
    assert main(['bag', '--drives', 'RH_KFE']) == 2
    assert main(['gone']) == 2


def test_bad_samples_are_in_no_run_and_cost_none_of_the_others():
    time = np.arange(2000) * 0.001
    bad = np.zeros(2000, bool)
    bad[700:720] = True
    values = np.where(bad, 1e6, time)[:, None]
    curve = Curve.of_samples(time, values, bad)
    assert [(run[0], run[-1]) for run, _ in curve.runs] == [(0.0, time[699]), (0.72, time[-1])]
    for run, kept in curve.runs:
        np.testing.assert_array_equal(kept[:, 0], run)
