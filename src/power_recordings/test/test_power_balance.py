from dataclasses import replace

import numpy as np
import pytest
from power_recordings.card import Card
from power_recordings.commands.info import print_quality
from power_recordings.index.kept_quality import Checked
from power_recordings.messages.samples import DriveSamples, JointSamples, SupplySamples
from power_recordings.quality.check import check_recording
from power_recordings.quality.findings import power_finding
from power_recordings.quality.physics import power_balance, rate_of
from power_recordings.quality.refusal import refuse_wrong_units
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

TIME = np.arange(0, 60.0, 0.01)
STAMPS = (TIME * 1e9).astype(np.int64)
TORQUE = 15.0 * np.sin(1.3 * TIME) + 3.0 * np.sin(5.1 * TIME)
SPEED = 2.0 * np.cos(3.0 * TIME)


def lossy_leg(copper=0.12):
    """Power of a leg whose gear rubs: 12 % of load, 1.5 N·m, and 2.5 N·m·s/rad."""
    friction = (0.12 * np.abs(TORQUE) + 1.5) * np.sign(SPEED) + 2.5 * SPEED
    motor = TORQUE + friction
    return motor * SPEED + copper * motor**2 + 8.0


def recording(power, torque=1.0, speed=1.0, whole=False):
    def column(values):
        return np.asarray(values, np.float32)[:, None]

    motion = (column(np.cumsum(speed * SPEED) * 0.01), column(speed * SPEED))
    joints = JointSamples(STAMPS, ('KNEE',), *motion, column(torque * TORQUE))
    size = len(TIME)
    if whole:
        supply = SupplySamples(STAMPS, np.full(size, 48.0, np.float32), -np.float32(power / 48.0))
        return Recording.in_memory('log', {'joint_states': joints, 'supply': supply})
    index = np.arange(size, dtype=np.uint64)
    unknown = np.full((size, 1), np.nan, np.float32)
    flags = np.zeros((size, 1), np.uint8)
    electric = (column(np.full(size, 48.0)), column(power / 48.0))
    drives = DriveSamples(STAMPS, ('KNEE',), index, index, *electric, unknown, flags)
    return Recording.in_memory('log', {'joint_states': joints, 'drive_supply': drives})


def test_a_sound_leg_with_a_lossy_gear_is_warned_of_and_not_refused():
    leg = recording(lossy_leg())
    found = check_recording(leg)
    balance = power_balance(lossy_leg(), TORQUE, SPEED)
    assert balance.slope - 2 * balance.error > 1.6
    assert balance.share > 0.3
    assert [f.severity for f in found.findings if f.code.startswith('power')] == ['warning']
    refuse_wrong_units(leg)
    (text,) = [f.text for f in found.findings if f.code == 'power_slope']
    assert f'power grows by {balance.slope:.3g} W with each W of torque × speed' in text
    assert f'{balance.share:.0%} of its variance' in text


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'torque': -1.0}, 'a sign is wrong'),
        ({'torque': 1e3}, 'torque'),  # N·mm
        ({'torque': 1 / 9}, 'a gear between'),
        ({'speed': 180 / np.pi}, 'speed'),
        ({'speed': 60 / (2 * np.pi)}, 'torque, speed'),
        ({'speed': 1 / (2 * np.pi)}, 'two units at once'),
    ],
    ids=['sign', 'N·mm', 'gear', 'deg/s', 'rpm', 'rev/s'],
)
def test_units_and_signs_are_refused_on_a_lossy_leg_too(wrong, words):
    with pytest.raises(InputError, match=words):
        refuse_wrong_units(recording(lossy_leg(), **wrong))


def test_a_drive_whose_gear_takes_most_of_its_power_is_warned_of_and_not_refused():
    """A telescope's mount: 33 N·m and 250 N·m·s/rad where the load is 15 N·m at 0.02 rad/s."""
    speed = 0.01 * SPEED
    friction = 33.0 * np.sign(speed) + 250.0 * speed
    motor = TORQUE + friction
    power = motor * speed + 0.005 * motor**2 + 4.0
    assert power_balance(power, TORQUE, speed).slope > 3.0
    mount = recording(power, speed=0.01)
    (found,) = [f for f in check_recording(mount).findings if f.code.startswith('power')]
    assert found.severity == 'warning'
    assert 'losses that grow with load and speed' in found.text


@pytest.mark.parametrize('ripple', [0.0, 0.01, 0.03])
@pytest.mark.parametrize('gear', [9.0, 20.0])
def test_a_wrong_gear_is_refused_at_a_constant_speed_too(gear, ripple):
    """A meter that reads far below 0 at rest would explain any slope there."""
    random = np.random.default_rng(0)
    speed = 3.0 * (1.0 + ripple * np.sin(TIME))
    power = TORQUE * speed + 0.05 * TORQUE**2 + 6.0 + random.normal(0.0, 3.0, len(TIME))
    found = power_finding('KNEE', power_balance(power, TORQUE / gear, speed), Card())
    assert found.severity == 'error'


def test_a_scaled_torque_at_one_speed_is_not_said_to_have_two_wrong_signs():
    steady = 100.0 + 0.01 * np.sin(TIME)
    power = 0.4 * steady + 4.0 + np.random.default_rng(0).normal(0.0, 0.1, len(TIME))
    found = power_finding('KNEE', power_balance(power, np.full(len(TIME), 2.0), steady), Card())
    assert 'is a sign, a gear or a unit wrong' in found.text


def test_a_brake_whose_torque_and_power_both_count_the_other_way_is_told():
    speed = 20.0 + SPEED
    torque = -12.0 - 0.2 * TORQUE
    power = torque * speed + 0.7 * torque**2 + 6.0  # of 240 W it gives back 130 W
    good = power_balance(power, torque, speed)
    wrong = power_balance(-power, -torque, speed)
    assert 0.9 < good.slope < 1.2
    assert 0.9 < wrong.slope < 1.2
    assert power_finding('KNEE', good, Card()) is None
    found = power_finding('KNEE', wrong, Card())
    assert found.severity == 'warning'
    assert 'the signs of both torque and power' in found.text


def test_milliamperes_of_a_lossy_leg_are_refused():
    small = 0.1 * 1e3 * lossy_leg()  # no current beyond what a drive can draw
    with pytest.raises(InputError, match='power grows by'):
        refuse_wrong_units(recording(small, torque=0.1**0.5, speed=0.1**0.5))


@pytest.mark.parametrize('whole', [False, True], ids=['drive', 'robot'])
def test_a_shaft_that_gives_a_hundred_times_what_is_metered_is_refused(whole):
    noise = 300.0 + np.random.default_rng(0).normal(0.0, 30.0, len(TIME))
    with pytest.raises(InputError, match=r'torque × speed is 1.54e\+04 W \(rms\) where 301 W'):
        refuse_wrong_units(recording(noise, torque=1e3, whole=whole))


def test_slope_and_share_of_the_variance_are_printed_also_where_they_decide_nothing(capsys):
    heat = 0.5 * TORQUE**2 + 8.0
    loud = np.random.default_rng(0).normal(0.0, 30.0, len(TIME))
    leg = recording(heat + loud)
    quality = check_recording(leg)
    drive = quality.drives['KNEE']
    assert abs(drive.power_slope) < 0.2
    assert drive.power_share < 0.01
    print_quality(Checked.of(leg))
    assert '–' not in next(
        line for line in capsys.readouterr().out.splitlines() if line.strip().startswith('KNEE')
    )


def test_a_robot_without_meters_at_its_drives_has_a_balance_too(capsys):
    robot = recording(TORQUE * SPEED + 0.05 * TORQUE**2 + 8.0, whole=True)
    print_quality(Checked.of(robot))
    assert 'power of the robot: 1 ± ' in capsys.readouterr().out
    with pytest.raises(InputError, match='a sign is wrong'):
        refuse_wrong_units(recording(TORQUE * SPEED + 0.05 * TORQUE**2 + 8.0, -1.0, whole=True))


def geared(folder, torque, speed, ratio=60.0):
    """A gripper that holds: heat for most of its power; and its card with a gear ratio."""
    Card.of({'torque': {'KNEE': 'motor'}, 'gear_ratio': {'KNEE': ratio}}).save(folder)
    bag = recording(TORQUE * SPEED + 0.5 * TORQUE**2 + 8.0, torque, speed)
    return replace(bag, folder=folder)


def test_a_torque_of_the_motors_shaft_is_told_with_the_scale_to_write(tmp_path):
    balance = power_balance(TORQUE * SPEED + 0.5 * TORQUE**2 + 8.0, TORQUE / 60, SPEED)
    assert balance.share < 0.3  # too little to decide by itself
    with pytest.raises(InputError, match=r'by 60 W .* gear_ratio 60') as raised:
        refuse_wrong_units(geared(tmp_path, 1 / 60, 1.0))
    assert 'in the map: torque: {scale: 60}' in str(raised.value)
    refuse_wrong_units(geared(tmp_path, 1.0, 1.0))
    refuse_wrong_units(geared(tmp_path, 1 / 60, 60.0))  # both of the shaft


def test_a_speed_of_the_motor_beside_a_torque_of_the_joint_is_told_where_no_position_is(tmp_path):
    bag = geared(tmp_path, 1.0, 45.0, 45.0)
    joints = bag.joint_states()
    still = replace(joints, position=np.full_like(joints.position, np.nan))
    unplaced = {'joint_states': still, 'drive_supply': bag.drive_supply()}
    bag = replace(Recording.in_memory('log', unplaced), folder=tmp_path)
    with pytest.raises(InputError, match=r'in the map: velocity: \{at: motor\}'):
        refuse_wrong_units(bag)


@pytest.mark.parametrize(('torque', 'speed'), [(60.0, 1.0), (1.0, 60.0)])
def test_where_speed_and_position_agree_the_torque_is_suspected_before_them(
    tmp_path, torque, speed
):
    with pytest.raises(InputError, match='1 / gear_ratio 60: torque multiplied by it') as raised:
        refuse_wrong_units(geared(tmp_path, torque, speed))
    assert 'Or position and speed, which agree, both at: motor?' in str(raised.value)
    assert 'Or the position is in degrees and speed is in degrees per second?' in str(raised.value)
    assert 'in the map' not in str(raised.value)  # the log alone does not tell which


def test_a_far_slope_of_a_small_share_of_the_power_is_warned_of_without_a_gear_ratio(
    tmp_path,
):
    found = check_recording(geared(tmp_path, 1 / 63, 1.0, 1.0)).findings
    (text,) = [f.text for f in found if f.code == 'power_slope' and f.severity == 'warning']
    assert 'power grows by 63 W with each W of torque × speed, which stands for' in text
    assert "not by about 1: another unit, or torque of the motor's shaft?" in text


def test_a_far_slope_is_not_warned_of_where_more_of_the_power_is_left_unexplained(tmp_path):
    """A drive that holds a load: what its power follows but torque and speed hides the slope."""
    loud = 2.0 * np.random.default_rng(0).normal(size=len(TIME))
    power = 7.0 * 0.01 * TORQUE * SPEED + 0.06 * TORQUE**2 + 8.0
    for noise, expected in ((0.0, ['power_slope']), (loud, [])):
        bag = recording(power + noise, 0.1, 0.1)
        codes = [f.code for f in check_recording(bag).findings if f.code == 'power_slope']
        assert codes == expected


@pytest.mark.parametrize('scale', [1e2, 1e3])
def test_a_shaft_of_many_times_the_power_that_hardly_moves_it_is_warned_of(scale):
    """N·cm or mN·m taken for N·m, of a drive whose power goes into heat."""
    power = TORQUE * SPEED / scale + 0.02 * TORQUE**2 + 0.3
    balance = power_balance(power, TORQUE, SPEED)
    assert 3 < balance.shaft / balance.power < 10
    (found,) = [power_finding('KNEE', balance, Card())]
    assert found.severity == 'warning'
    assert 'another unit of torque or speed (N·cm, mN·m?)' in found.text


def test_friction_that_heats_the_winding_in_slow_motion_is_no_error_of_units():
    slow = 0.03 * SPEED * (1 + 0.3 * np.sin(0.11 * TIME))
    load = 45.0 + 10.0 * np.sin(1.3 * TIME)
    motor = load + 25.0 * np.sign(slow)
    power = motor * slow + 0.004 * motor**2 + 3.0
    balance = power_balance(power, load, slow)
    assert balance.slope > 2.6 > 1.3 > balance.rubbed > 0.7
    assert balance.share > 0.3
    (found,) = [power_finding('J2', balance, Card())]
    assert found.severity == 'warning'
    assert 'losses that grow with load and speed' in found.text


def test_a_long_finding_is_printed_to_its_end(capsys):
    noise = 50.0 + np.random.default_rng(0).normal(0.0, 5.0, len(TIME))
    print_quality(Checked.of(recording(noise)))
    out = capsys.readouterr().out
    assert "the winding's current, if the log has it; in the map: torque: {from: …" in out


def test_torque_that_comes_late_is_no_torque_of_the_wrong_sign():
    """A mass that swings: most power is heat, which falls as the late torque's product rises."""
    speed = np.sin(9.0 * TIME) + 0.5 * np.sin(14.0 * TIME)

    def torque(time):
        return 0.3 * (9.0 * np.cos(9.0 * time) + 7.0 * np.cos(14.0 * time))

    power, late = torque(TIME) * speed + 5.0 * torque(TIME) ** 2 + 5.0, torque(TIME - 0.006)
    balance = power_balance(power, late, speed, rate_of(TIME, late))
    assert balance.slope < -0.6
    assert balance.delayed > 0.6
    assert power_finding('KNEE', balance, Card()) is None


@pytest.mark.parametrize(('sign', 'found'), [(1.0, 0), (-1.0, 1)])
def test_a_wrong_sign_is_an_error_also_where_nearly_all_power_is_heat(sign, found):
    power = TORQUE * SPEED + 0.9 * TORQUE**2 + 8.0
    assert power_balance(power, TORQUE, SPEED).share < 0.05
    errors = [f for f in check_recording(recording(power, sign)).findings if f.severity == 'error']
    assert len(errors) == found
    assert all('a sign is wrong' in f.text for f in errors)


@pytest.mark.parametrize(
    ('noted', 'mend'),
    [
        ({}, 'current: {positive: fed}'),
        ({'KNEE': {'current': 'fed'}}, 'current: {positive: drawn}'),
        ({'KNEE': {'power': 'drawn'}}, 'power: {positive: fed}'),
    ],
    ids=['unknown', 'current', 'power'],
)
def test_where_a_drive_would_have_losses_below_zero_the_sign_of_its_meter_is_turned(
    tmp_path, noted, mend
):
    Card.of({'imported': {'positive': noted}}).save(tmp_path)
    fed = replace(recording(-(TORQUE * SPEED + 8.0)), folder=tmp_path)
    (found,) = [f for f in check_recording(fed).findings if f.severity == 'error']
    assert "and the losses would be -8 W: the meter's sign is wrong" in found.text
    assert found.mend == mend


def sprung(gear=1.0):
    """A joint of 30 N·m that swings behind a spring of 100 N·m/rad; heat of 0.01 W/(N·m)²."""
    torque = 30.0 * np.sin(6.0 * TIME) + 5.0 * np.sin(1.7 * TIME)
    rate = 180.0 * np.cos(6.0 * TIME) + 8.5 * np.cos(1.7 * TIME)
    speed = 0.7 * rate / 100.0 + 0.3 * np.cos(2.9 * TIME)
    power = torque * (speed + rate / 100.0) + 0.01 * torque**2 + 5.0
    return power, torque / gear, speed


@pytest.mark.parametrize(('gear', 'severity'), [(1.0, 'warning'), (9.0, 'error')])
def test_what_a_series_spring_takes_up_is_no_error_of_units_and_a_gear_is_one(gear, severity):
    power, torque, speed = sprung(gear)
    balance = power_balance(power, torque, speed, rate_of(TIME, torque))
    assert balance.slope > 2.2 * gear
    assert balance.sprung == pytest.approx(gear, rel=0.05)
    found = power_finding('ANKLE', balance, Card())
    assert found.severity == severity
    assert ('a series spring?' in found.text) == (gear == 1.0)


# A drive that mostly holds: torque × speed makes less than 2 % of the power's variance.
HOLDS = 0.15 * TORQUE * SPEED + 0.2 * TORQUE**2 + 8.0
HOLDS += 4.0 * np.random.default_rng(0).normal(size=len(TIME))


def test_a_meter_that_counts_the_other_way_is_told_by_its_losses_where_nearly_all_is_heat():
    bag = recording(-HOLDS, 1.0, 0.15)
    (error,) = [f for f in check_recording(bag).findings if f.code == 'power_units']
    assert "the meter's sign is wrong" in error.text


def test_a_torque_that_counts_the_other_way_is_warned_of_where_nearly_all_is_heat():
    for sign, expected in ((1.0, []), (-1.0, ['is a sign wrong?'])):
        bag = recording(HOLDS, sign, 0.15)
        found = [f for f in check_recording(bag).findings if f.code.startswith('power')]
        assert [f.text.rpartition(': ')[2] for f in found] == expected
        assert all(f.severity == 'warning' for f in found)


def imported(folder, bag, **notes):
    """A recording with what its import noted of a drive: units, and what the meter gives."""
    Card.of({'imported': {what: {'KNEE': own} for what, own in notes.items()}}).save(folder)
    return replace(bag, folder=folder)


@pytest.mark.parametrize('slope', [0.8, 1.0, 1.3])
def test_kilowatts_are_told_beside_the_other_unit_that_makes_the_same_slope(tmp_path, slope):
    bag = recording(1e-3 * (slope * TORQUE * SPEED + 0.05 * TORQUE**2 + 8.0))
    for notes, words in (
        ({'positive': {'power': 'drawn'}}, 'torque is in mN·m or power is in kW?'),
        ({'positive': {'current': 'drawn'}}, 'torque is in mN·m?'),
        ({'positive': {}, 'columns': {'efficiency': 'eta'}}, 'torque is in mN·m?'),
    ):
        with pytest.raises(InputError, match=words) as raised:
            refuse_wrong_units(imported(tmp_path, bag, **notes))
        assert ('in the map' in str(raised.value)) == ('kW' not in words)


def test_position_and_speed_that_agree_are_wrong_together(tmp_path):
    turn = 180 / np.pi
    bag = recording(TORQUE * SPEED + 0.5 * TORQUE**2 + 8.0, 1.0, turn)
    with pytest.raises(
        InputError, match='position is in degrees and speed is in degrees'
    ) as raised:
        refuse_wrong_units(imported(tmp_path, bag, units={'position': 'rad', 'velocity': 'rad/s'}))
    assert 'position: {unit: deg}, velocity: {unit: deg/s}' in str(raised.value)
    notes = {'velocity': {'KNEE': 'rate of position'}}  # the map has no column for it
    Card.of({'imported': notes}).save(tmp_path)
    with pytest.raises(InputError, match=r'in the map: position: .unit: deg.; --ignore'):
        refuse_wrong_units(replace(bag, folder=tmp_path))


def test_a_slope_beyond_any_loss_is_refused_with_the_unit_that_makes_it():
    """A small gripper that holds: its shaft stands for 4 % of the variance of its power."""
    power = 1e-3 * (TORQUE * SPEED + 0.5 * TORQUE**2 + 8.0)
    assert 0.02 < power_balance(power, TORQUE, 1e-3 * SPEED).share < 0.3
    with pytest.raises(InputError, match=r'grows by 1e\+03 W .* current is in mA'):
        refuse_wrong_units(recording(1e3 * power, 1.0, 1e-3))


def test_a_slow_drive_whose_friction_heats_it_is_not_refused():
    """Copper loss of friction grows with torque × sign of speed: 144 W for each W of the shaft."""
    speed = 0.02 * np.cos(0.9 * TIME)
    motor = TORQUE + (0.15 * np.abs(TORQUE) + 1.5) * np.tanh(speed / 0.02)
    power = motor * speed + 0.5 * motor**2 + 8.0
    assert power_balance(power, TORQUE, speed).slope > 100.0
    bag = recording(power, 1.0, speed / SPEED)
    assert 'error' not in {f.severity for f in check_recording(bag).findings}


def test_a_power_that_is_far_too_large_is_told_as_what_the_map_has(tmp_path):
    bag = recording(1e3 * (TORQUE * SPEED + 2 * TORQUE**2 + 8.0))
    for metered, words in (
        ('power', 'power reaches .* W: mW'),
        ('current', 'current reaches .* A: mA'),
    ):
        with pytest.raises(InputError, match=words):
            refuse_wrong_units(imported(tmp_path, bag, positive={metered: 'drawn'}))
