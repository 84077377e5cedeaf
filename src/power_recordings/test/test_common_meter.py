"""Two drives on one meter, that of the robot's supply."""

from dataclasses import replace

import numpy as np
import pytest
from power_recordings.commands.info import print_quality
from power_recordings.index.kept_quality import Checked
from power_recordings.messages.samples import JointSamples, SupplySamples
from power_recordings.quality.check import check_recording
from power_recordings.quality.physics import drive_slopes
from power_recordings.reading.reader import Recording

TIME = np.arange(0, 60.0, 0.01)
STAMPS = (TIME * 1e9).astype(np.int64)
TORQUE = np.stack([15.0 * np.sin(1.3 * TIME), 5.0 * np.cos(0.9 * TIME)], axis=1)
SPEED = np.stack([2.0 * np.cos(3.0 * TIME), 3.0 * np.sin(2.1 * TIME)], axis=1)
NOISE = 0.5 * np.random.default_rng(0).normal(size=len(TIME))


def robot(**of):
    """Return the quality of its recording."""
    return check_recording(recording(**of))


def recording(torque=TORQUE, speed=SPEED, drawn=1.0, scales=(1.0, 1.0)):
    """Return a robot of which 48 V supply shaft power, 0.05 W/(N·m)² of heat and 8 W."""
    power = drawn * ((torque * speed + 0.05 * torque**2).sum(axis=1) + 8.0 + NOISE)
    motion = (np.cumsum(speed, axis=0) * 0.01, speed, torque * scales)
    joints = JointSamples(STAMPS, ('HIP', 'KNEE'), *np.float32(motion))
    volts = np.full(len(TIME), 48.0, np.float32)
    supply = SupplySamples(STAMPS, volts, -np.float32(power / 48.0))
    return Recording.in_memory('log', {'joint_states': joints, 'supply': supply})


def errors(quality):
    return [(f.drive, f.mend) for f in quality.findings if f.severity == 'error']


def test_each_drive_on_a_common_meter_has_its_slope():
    quality = robot()
    assert errors(quality) == []
    for drive in quality.drives.values():
        assert drive.power_slope == pytest.approx(1.0, abs=0.02)
        assert drive.power_share > 0.02


@pytest.mark.parametrize('drive', [0, 1])
def test_a_drive_on_a_common_meter_whose_sign_is_wrong_is_told_by_its_name(drive):
    scales = np.where(np.arange(2) == drive, -1.0, 1.0)
    quality = robot(scales=scales)
    name = ('HIP', 'KNEE')[drive]
    assert errors(quality) == [(name, 'torque: {scale: -1}')]
    (text,) = [f.text for f in quality.findings if f.drive == name and f.severity == 'error']
    assert 'W with each W of its torque × speed: a sign is wrong' in text


def test_of_drives_that_move_as_one_none_is_blamed():
    """They turn one shaft, to which the knee gives 0.8 of the hip's torque."""
    torque = np.stack([TORQUE[:, 0], 0.8 * TORQUE[:, 0]], axis=1)
    speed = np.repeat(SPEED[:, :1], 2, axis=1)
    for scales in ((1.0, 1.0), (1.0, -1.0)):
        quality = robot(torque=torque, speed=speed, scales=scales)
        assert not {'HIP', 'KNEE'} & {drive for drive, _ in errors(quality)}
        assert all(np.isnan(drive.power_slope) for drive in quality.drives.values())


def test_a_drive_that_hardly_works_is_not_blamed():
    idle = np.stack([TORQUE[:, 0], 0.01 * TORQUE[:, 1]], axis=1)
    quality = robot(torque=idle, scales=(1.0, -1.0))
    assert errors(quality) == []
    assert np.isnan(quality.drives['KNEE'].power_slope)


def test_a_common_meter_that_counts_the_other_way_is_turned_and_not_the_drives():
    assert errors(robot(drawn=-1.0)) == [('', 'supply: {current: {positive: fed}}')]


@pytest.mark.parametrize(
    ('milli', 'mend'),
    [
        ({'drawn': 1000.0}, ('', 'supply: {current: {unit: mA}}')),
        ({'scales': (1000.0, 1.0)}, ('HIP', 'torque: {unit: mN*m}')),
    ],
    ids=['mA', 'mN·m'],
)
def test_a_slope_of_a_thousand_is_of_milliamperes_and_of_a_thousandth_of_millinewtons(milli, mend):
    """A gear that rubs makes a slope of 1.5, which is no nearer to 1 than 1,500 to 1,000."""
    for heavier in (1.0, 1.5):
        torque = TORQUE * heavier
        scales = np.asarray(milli.get('scales', (1.0, 1.0))) / heavier
        quality = robot(torque=torque, drawn=milli.get('drawn', 1.0), scales=scales)
        assert errors(quality) == [mend]


def test_the_ranges_and_updates_of_a_common_meter_are_shown(capsys):
    """0, 48 and 96 W at 48 V, each for 40 ms."""
    bag = recording()
    supply = bag.supply()
    watts = 48.0 * (supply.stamp_ns // 40_000_000 % 3).astype(np.float32)
    joints = {'joint_states': bag.joint_states(), 'supply': replace(supply, current=-watts / 48)}
    checked = Checked.of(Recording.in_memory('log', joints))
    found = checked.quality.supply
    assert found.updates_hz == pytest.approx({'power': 25, 'voltage': 0, 'current': 25}, rel=0.01)
    assert found.ranges['power'] == pytest.approx((0.0, 96.0))
    assert np.isnan(found.slope)
    print_quality(checked)
    text = 'supply: power 0…96 W (25 Hz), voltage 48 V (0 Hz), current 0…2 A (25 Hz)'
    assert text in capsys.readouterr().out


def test_a_zero_with_a_sign_is_shown_as_zero(capsys):
    print_quality(Checked.of(recording(scales=(-0.0, 1.0))))
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.strip().startswith('HIP')]
    assert ' 0 ' in line
    assert '-0 ' not in line


def test_a_slope_is_not_shown_that_the_heat_of_friction_may_have_made():
    """Two joints that move slowly and rub by 25 N·m: 2.6 W per W beside other losses, not 1."""
    slow = 0.03 * SPEED
    load = 45.0 + 0.7 * TORQUE
    motor = load + 25.0 * np.sign(slow)
    power = (motor * slow + 0.004 * motor**2).sum(axis=1) + 0.1 * NOISE
    found = drive_slopes(power, load, slow)
    assert min(found.slopes) > 2.0
    assert np.isnan([*found.figures, *found.shares]).all()
