"""Hidden effects in the logs of real drives."""

import drive_logs
import numpy as np
import pytest
from drive_logs import DRIVE_LOGS, OfLog, added_power, log_questions, read_log, with_power
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError


@pytest.fixture
def swinging():
    time = np.arange(2000) / 100.0
    tau = np.stack([np.sin(time), 2 * np.cos(1.3 * time)], axis=1)
    w = np.stack([np.cos(2 * time), np.sin(time)], axis=1)
    power = tau * w + 0.5 * tau**2 + 3.0
    return AlignedDataset.blank(
        100.0, ('A', 'B'), time, 'made up', torque=tau, velocity=w, power=power,
        voltage=24.0, current=power / 24.0,
    )  # fmt: skip


@pytest.mark.parametrize('name', ['winding_heating', 'iron', 'switching', 'load_friction', 'line'])
def test_added_power_has_the_size_that_it_is_given(swinging, name):
    metered = swinging.power.astype(float)
    rms = np.sqrt(np.mean((metered - metered.mean(axis=0)) ** 2))
    power = added_power(name, swinging, 0.05)
    assert np.sqrt(np.mean((power - power.mean(axis=0)) ** 2)) == pytest.approx(0.05 * rms)
    assert (power >= 0.0).all()


def test_blocked_braking_leaves_no_power_below_zero(swinging):
    swinging = with_power(swinging, np.full((2000, 2), -4.0))
    lowest = swinging.power.min()
    assert lowest < -1.0
    blocked = with_power(swinging, added_power('blocked', swinging, 0.0))
    half = with_power(swinging, added_power('half_blocked', swinging, 0.0))
    assert blocked.power.min() == pytest.approx(0.0, abs=1e-6)
    assert half.power.min() == pytest.approx(0.5 * lowest)


def test_voltage_times_current_stays_the_power(swinging):
    more = with_power(swinging, added_power('iron', swinging, 0.1))
    np.testing.assert_allclose(more.voltage * more.current, more.power, rtol=1e-5)


def test_absent_logs_are_skipped_with_the_reason(monkeypatch, tmp_path):
    monkeypatch.setattr(drive_logs, 'LOGS', tmp_path)
    read_log.cache_clear()
    questions, skipped = log_questions()
    assert not questions
    assert len(skipped) == len(DRIVE_LOGS)
    assert 'WATTWALK_REAL_DATA says where logs lie' in skipped[0]


def test_a_stall_that_warms_is_asked_for_its_heating():
    read_log.cache_clear()
    try:
        sealed = OfLog('moteus_warm', left_out='winding_heating').seal()
    except InputError as error:
        pytest.skip(str(error))
    assert 'winding_heating' not in sealed.known
    assert sealed.missing == {'winding_heating'}
    assert not sealed.complete
    assert 'iron_loss' in sealed.impossible
    assert sealed.watts['winding_heating'] > 1.0
