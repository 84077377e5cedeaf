"""Torque at the joint beside the motor's current: gear, torque constant, winding, scale."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.judge.estimator import JudgeSettings
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.compare.both_sides import both_sides
from power_recordings.alignment.dataset import AlignedDataset

KT, R = 2.0, 0.5  # N·m/A at the joint, W/A²


def bench(*, loss=0.0, scale=1.0, driven=True, seconds=60):
    """A gear that takes a share of the load, and a sensor that reads scale of the torque."""
    t = np.arange(400 * seconds) / 400.0
    speed = 4.0 + 2.0 * np.sin(0.7 * t)
    torque = 10.0 * np.sin(1.1 * t) + 4.0 * np.sin(2.9 * t) + (0.0 if driven else 20.0)
    current = (torque + loss * np.abs(torque) + 0.3) / KT
    power = KT * current * speed + R * current**2 + 0.4 * speed + 5.0
    columns = {'velocity': speed, 'torque': scale * torque, 'power': power}
    data = AlignedDataset.blank(
        400.0, ('KNEE',), t, 'bench', voltage=48.0, **{k: v[:, None] for k, v in columns.items()}
    )
    return replace(data, motor_current=current[:, None].astype(np.float32))


def found(data, **settings):
    judge = Judge(Loaded.of(data), settings=JudgeSettings(fit=FitSettings(**settings)))
    (one,) = both_sides(judge).values()
    return one


def test_the_torque_constant_comes_from_the_power_without_a_torque_sensor():
    one = found(bench(scale=0.6))
    assert one.torque_constant.value == pytest.approx(KT, rel=0.01)
    assert one.torque_constant.interval[0] <= KT <= one.torque_constant.interval[1] * 1.001
    assert one.resistance.value == pytest.approx(R, rel=0.02)


def test_a_gear_is_told_from_a_scale_by_a_drive_that_is_driven():
    gear, scale = found(bench(loss=0.25)), found(bench(scale=0.8))
    assert gear.verdict == 'gear loss'
    assert gear.gear_loss.value == pytest.approx(0.25, abs=0.01)
    assert gear.scale.value == pytest.approx(1.0, abs=0.01)
    assert scale.verdict == 'torque scale'
    assert scale.scale.value == pytest.approx(0.8, abs=0.01)
    assert found(bench(loss=0.25, scale=0.8)).verdict == 'both'
    assert found(bench()).verdict == 'agree'


def test_a_drive_that_only_drives_leaves_both_open_with_both_sizes():
    one = found(bench(loss=0.25, driven=False))
    assert one.verdict == 'torque scale or gear loss'
    assert one.ratio.value == pytest.approx(1.25, abs=0.01)
    (line,) = [line for line in one.lines() if 'scale or gear' in line]
    assert 'reads 0.80 of the torque' in line
    assert 'loses 20% of the load' in line
    assert 'known weight on a lever decides' in line
    efficiency = [own.value for own in one.efficiency]
    assert 0.77 < min(efficiency) <= max(efficiency) < 0.80


def test_a_stall_that_warms_tells_resistance_at_20_degrees_and_its_coefficient():
    t = np.arange(400 * 60) / 400.0
    current = 2.0 + 2.0 * np.floor(t / 12.0) % 8.0
    warm = 30.0 + 0.8 * t
    power = R * current**2 * (1 + 0.0039 * (warm - 20.0)) + 4.0
    columns = {'torque': 0.1 * current, 'temperature': warm, 'power': power}
    data = AlignedDataset.blank(
        400.0, ('A',), t, 'stall', velocity=0.0, voltage=36.0,
        **{k: v[:, None] for k, v in columns.items()},
    )  # fmt: skip
    one = found(replace(data, motor_current=current[:, None].astype(np.float32)))
    assert one.resistance.value == pytest.approx(R, rel=0.01)
    assert one.temperature_coefficient.value == pytest.approx(0.0039, rel=0.03)
    assert one.by_torque.value == pytest.approx(0.1, rel=0.01)
    assert one.verdict is None


def test_a_current_that_the_power_does_not_follow_gives_no_torque_constant():
    data = bench()
    random = np.random.default_rng(1).normal(0.0, 3.0, data.motor_current.shape)
    slow = np.repeat(random[::400], 400, axis=0).astype(np.float32)
    one = found(replace(data, motor_current=data.motor_current + slow))
    assert one.torque_constant is None
    assert 'follows the torque' in one.remark


def test_blocks_are_those_of_the_judges_settings():
    assert found(bench(), block_seconds=(10.0,)).remark.startswith('its current is too small')


def test_computed_power_is_said_to_give_the_figures_of_its_formula():
    data = replace(bench(), computed_power=frozenset({'KNEE'}))
    assert 'figures of that formula' in found(data).lines()[-1]


def test_a_recording_without_motor_current_has_one_side():
    assert both_sides(Judge(Loaded.of(replace(bench(), motor_current=None)))) == {}


def test_rows_without_a_current_do_not_count():
    data = bench()
    gone = np.arange(len(data.time))[:, None] % 4000 < 40
    one = found(replace(data, motor_current=np.where(gone, np.nan, data.motor_current)))
    assert one.torque_constant.value == pytest.approx(KT, rel=0.01)


@pytest.mark.parametrize(('signal', 'value'), [('torque', 0.0), ('power', 5.0)])
def test_a_signal_that_never_changes_says_nothing(signal, value):
    data = bench()
    one = found(replace(data, **{signal: np.full_like(data.torque, value)}))
    assert one.verdict is None
    assert one.remark


def test_no_gear_gains_so_that_more_power_at_the_joint_is_a_scale():
    one = found(bench(scale=1.3, driven=False))
    assert one.verdict == 'torque scale'
    assert one.scale.value == pytest.approx(1.3, abs=0.02)
    assert 'the gear takes' not in ' '.join(one.lines())


def test_load_and_speed_that_rise_together_give_no_torque_constant():
    data = bench()
    ramp = np.linspace(1.0, 5.0, len(data.time))[:, None]
    noise = np.random.default_rng(2).normal(0.0, 2.0, ramp.shape)
    power = KT * ramp * ramp + R * ramp**2 + 5.0 + noise
    columns = {'velocity': ramp, 'torque': KT * ramp, 'motor_current': ramp, 'power': power}
    one = found(replace(data, **{name: own.astype(np.float32) for name, own in columns.items()}))
    assert one.torque_constant is None
    assert 'vary together' in one.remark
