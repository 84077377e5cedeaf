import math

import numpy as np
import pytest
from drive_bench.motion.file import MOTIONS, Load, MotionFile, find_motion, listing
from drive_bench.motion.fitting import fitted
from drive_bench.motion.joint_limits import JointLimits, limits_of
from drive_bench.motion.plan import Plan, SegmentPlayer, WavePath
from drive_bench.motion.segment_path import Mounting, Ramps
from drive_bench.motion.segments import Segment
from drive_bench.run.motion_run import MotionRun
from drive_bench.run.options import resolve
from hypothesis import example, given, settings
from hypothesis import strategies as st
from policy_runner.supervisor.safety import SafetyConfig
from wattwalk_core.errors import InputError
from wattwalk_core.schema import parse

KFE = limits_of(('LF_KFE',))['LF_KFE']
LOAD = Load.of('4kg@0.3m')
MODES = [
    (name, mode)
    for name in MOTIONS
    for mode in ('position', 'velocity', 'torque')
    if f'{mode}' in next(line for line in listing().splitlines() if line.split()[0] == name)[:40]
]


def motion(*segments):
    return MotionFile('next', ('LF_KFE',), tuple(segments))


def wave(shape, mode='velocity', amplitude=2.0, seconds=10.0, **more):
    return Segment(mode, seconds, shape=shape, amplitude=amplitude, **more)


def test_each_kind_of_motion_that_is_asked_for_is_shipped_in_each_mode_it_has():
    assert {'sine', 'square', 'chirp', 'ladder', 'holds', 'hot_soak'} <= set(MOTIONS)
    for name in ('sine', 'square', 'chirp', 'ladder'):
        assert {mode for found, mode in MODES if found == name} == {
            'position',
            'velocity',
            'torque',
        }


@pytest.mark.parametrize(('name', 'mode'), MODES)
def test_a_shipped_motion_keeps_to_the_limits_of_a_knee_with_and_without_load(name, mode):
    plain = find_motion(name, mode)
    for mounting in (Mounting(), Mounting(LOAD.pull)):
        if plain.shares and not mounting.pendulum:
            continue
        if mode == 'torque' and mounting.pendulum and plain.strongest > mounting.pendulum:
            continue
        plan = Plan(plain.with_pull(mounting.pendulum), 0.0, mounting, Ramps())
        plan.check('LF_KFE', KFE)


def test_the_sine_of_the_paper_is_four_hertz_and_one_and_a_half_radians():
    sine = find_motion('sine').segments[-1]
    assert (sine.mode, sine.shape, sine.frequency, sine.amplitude) == ('position', 'sine', 4, 1.5)
    assert sine.saturate
    with pytest.raises(InputError, match=r'37\.7 rad/s asked'):
        Plan(motion(wave('sine', 'position', 1.5, frequency=4.0)), 0.0, Mounting(), Ramps()).check(
            'LF_KFE', KFE
        )


def test_a_chirp_ends_at_its_frequency():
    chirp = wave('chirp', 'position', 0.3, 20.0, lowest=0.2, frequency=4.0)
    path = WavePath(chirp, 0.0, Mounting(), Ramps())
    late = np.array([path.at(t).position for t in np.arange(18.5, 19.5, 1e-3)])
    assert np.count_nonzero(np.diff(np.sign(late))) / 2 == pytest.approx(3.6, abs=0.5)
    early = np.array([path.at(t).position for t in np.arange(0.0, 5.0, 1e-3)])
    assert np.count_nonzero(np.diff(np.sign(early))) / 2 <= 2


def test_steps_of_speed_are_ramped_and_their_place_is_the_integral_of_them():
    path = WavePath(
        wave('square', amplitude=2.0, seconds=4.0, frequency=0.5),
        0.3,
        Mounting(),
        Ramps(acceleration=40.0),
    )
    ramp = 2.0 / 40.0
    assert path.at(0.5 * ramp).velocity == pytest.approx(1.0)
    assert path.at(0.9).velocity == 2.0
    assert path.at(0.9).position == pytest.approx(0.3 + 2.0 * (0.9 - ramp / 2), abs=1e-3)
    assert path.at(1.0 + ramp).velocity == pytest.approx(0.0)
    assert path.at(4.0).velocity == pytest.approx(0.0), 'it comes to a stand at the end'
    assert path.at(0.9).mode == 'velocity'
    assert path.extent[1] == pytest.approx(0.3 + 2.0, abs=0.01)


def test_a_ladder_of_position_is_led_from_rung_to_rung():
    path = WavePath(wave('ladder', 'position', 0.3, 18.0), 0.1, Mounting(), Ramps(way=1.0))
    position = np.array([path.at(t).position for t in np.arange(0.0, 18.0, 1e-3)])
    assert np.abs(np.diff(position)).max() <= 1.001e-3
    assert path.at(1.9).position == pytest.approx(0.1 + 0.25 * 0.3)
    assert path.at(13.9).position == pytest.approx(0.1 + 0.3)
    assert path.at(15.9).position == pytest.approx(0.1 - 0.3)


def test_after_torque_mode_the_rest_is_planned_from_where_the_joint_has_got_to():
    segments = (wave('hold', 'torque', 5.0, 2.0), Segment('rest', 1.0))
    player = SegmentPlayer(motion(*segments), 0.0, Mounting(), Ramps())
    targets = [player.step(0.01, 0.004 * count) for count in range(199)]
    assert {target.mode for target in targets} == {'torque'}
    assert targets[100].effort == 5.0
    after = player.step(0.02, 0.8)
    assert (after.mode, after.position) == ('position', 0.8)
    assert player.left > 0.9


def test_a_soak_ends_once_the_winding_is_warm_without_a_jump_and_then_cools():
    soak = Segment('position', 600.0, frequency=2.0, amplitude=0.4, until_warmer=5.0)
    player = SegmentPlayer(
        motion(Segment('rest', 1.0), soak, Segment('rest', 30.0)), 0.0, Mounting(), Ramps()
    )
    positions, seconds, temperature = [], 0.0, 30.0
    while player.left > 0.0:
        seconds += 0.005
        temperature = 30.0 + 0.5 * min(max(seconds - 1.0, 0.0), 12.0)
        positions.append(player.step(0.005, 0.0, temperature).position)
    assert 1.0 + 10.0 + 30.0 <= seconds < 1.0 + 10.0 + 30.0 + 1.6
    assert np.abs(np.diff(positions)).max() < 0.005 * 1.2 * 2.0 * math.pi * 2.0 * 0.4


def test_a_soak_that_gets_too_hot_ends_however_warm_it_was_to_get():
    soak = Segment(
        'position', 600.0, frequency=2.0, amplitude=0.4, until_warmer=50.0, hottest=60.0
    )
    player = SegmentPlayer(motion(soak), 0.0, Mounting(), Ramps())
    for _ in range(400):
        player.step(0.005, 0.0, 55.0)
    assert player.left > 590.0
    player.step(0.005, 0.0, 60.0)
    assert player.left < 2.0


def test_shares_of_a_load_become_torques():
    holds = find_motion('holds').with_pull(LOAD.pull)
    assert LOAD.pull == pytest.approx(9.81 * 4.0 * 0.3)
    assert holds.strongest == pytest.approx(0.8 * LOAD.pull)
    with pytest.raises(InputError, match=r'give --load 4kg@0\.3m'):
        find_motion('holds').with_pull(0.0)


@pytest.mark.parametrize('text', ['4kg', '4@0.3', '0kg@0.3m', '4kg@30m', '4kg@..m', ''])
def test_a_load_that_is_none_is_refused(text):
    with pytest.raises(InputError, match=r'give such as 4kg@0\.3m'):
        Load.of(text)


@pytest.mark.parametrize(
    ('entry', 'words'),
    [
        (
            {'shape': 'saw', 'frequency': 1},
            "shape: expected .*'sine', .*, there is 'saw'",
        ),
        ({'shape': 'hold'}, "shape is 'hold'; in mode position there is sine, "),
        ({'shape': 'sine'}, 'a sine needs a frequency above 0 Hz'),
        ({'shape': 'chirp', 'frequency': 2, 'lowest': 3}, 'lowest is 3; a chirp rises'),
        ({'shape': 'ladder', 'until_warmer': 3}, 'goes with rest, holds and sines only'),
        ({'saturate': 'yes'}, "saturate: expected true or false, there is 'yes'"),
        ({'until_warmer': 20, 'hottest': 500}, 'hottest: expected 0 to 120 °C, there is 500'),
        ({'hottest': 60}, 'hottest goes with until_warmer only'),
    ],
)
def test_a_shape_that_makes_no_sense_is_refused(entry, words):
    with pytest.raises(InputError, match=words):
        parse(Segment, {'mode': 'position', 'amplitude': 1, 'seconds': 5, **entry}, 'here')


def test_a_drive_goes_by_the_end_of_its_name_where_only_one_is_there():
    joints = ('LF_HAA', 'LF_KFE', 'RF_KFE')
    assert resolve(['KFE'], joints, [False, False, True]) == ('RF_KFE',)
    assert resolve(['RF_KFE'], joints, [True, True, True]) == ('RF_KFE',)
    with pytest.raises(InputError, match='may be LF_KFE, RF_KFE'):
        resolve(['KFE'], joints, [True, True, True])
    with pytest.raises(InputError, match="no drive 'TAIL'"):
        resolve(['TAIL'], joints, [True, True, True])


def test_passes_that_leave_the_range_are_cut_into_more_and_shorter_ones():
    asked = motion(Segment('velocity', 3.0, speed=2.0), Segment('velocity', 3.0, speed=-2.0))
    narrow = JointLimits(-1.0, 2.0, 8.0, 80.0)
    fit, notes = fitted(asked, 0.0, Mounting(), narrow)
    assert [segment.seconds for segment in fit.segments] == [1.0] * 6
    assert [segment.speed for segment in fit.segments] == [2.0, -2.0] * 3
    assert notes == ('+2 rad/s, 3 s and back: 3 times 1.00 s, first to +2 rad/s',)
    Plan(fit, 0.0, Mounting(), Ramps()).check('LF_KFE', narrow)
    turned, _ = fitted(asked, 1.9, Mounting(), narrow)
    assert turned.segments[0].speed == -2.0, 'it begins where there is room'


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.2, 8.0),
    st.floats(0.5, 6.0),
    st.floats(0.1, 2.0),
    st.floats(0.1, 3.0),
    st.floats(-0.8, 0.8),
)
@example(speed=1.0, seconds=1.0, amplitude=1.8665886659870081, reach=1.0, start=0.0)
def test_what_is_fitted_is_not_refused(speed, seconds, amplitude, reach, start):
    limits = JointLimits(-reach - 0.9, reach + 0.9, 5.0, 20.0)
    asked = motion(
        Segment('velocity', seconds, speed=speed),
        Segment('velocity', seconds, speed=-speed),
        Segment('position', 4.0, frequency=1.0, amplitude=amplitude),
        Segment('torque', 2.0, torque=30.0),
    )
    mounting = Mounting(25.0)
    fit, _ = fitted(asked, start, mounting, limits)
    Plan(fit, start, mounting, Ramps()).check('LF_KFE', limits)
    assert fitted(fit, start, mounting, limits) == (fit, ()), 'what fits is left as it is'


class Rig:
    """Three joints that do what they are told, every 5 ms of a clock of its own."""

    joints = ('A', 'B', 'C')

    def __init__(self, *segments, others=(0.0, 0.0), **options):
        limits = {'B': JointLimits(-2.0, 2.0, 5.0, 25.0)}
        self.run = MotionRun(
            motion(*segments), self.joints, ('B',), Mounting(), limits, SafetyConfig(), **options
        )
        self.now, self.sent = 50.0, []
        self.position = np.array([others[0], 0.2, others[1]])
        self.velocity = np.zeros(3)
        self.supply = None

    def go(self, seconds):
        for _ in range(round(seconds / 0.005)):
            self.now += 0.005
            self.run.inputs.on_joints(
                round(self.now * 1e9),
                self.joints,
                self.position,
                self.velocity,
                self.now,
                [0.1] * 3,
            )
            if self.supply is not None:
                self.run.policy.windings.on_supply(('B',), self.supply, self.now)
            self.sent.append(self.run.update(self.now))
            command = self.sent[-1]
            if command is not None and command.position is not None:
                self.position = np.array(command.position)
            elif command is not None and command.velocity is not None:
                for name, speed in zip(command.names, command.velocity, strict=True):
                    self.velocity[self.joints.index(name)] = speed
                self.position = self.position + 0.005 * self.velocity
        return self.sent[-1]


def test_in_velocity_mode_only_the_drive_is_named_and_afterwards_all_hold():
    rig = Rig(
        wave('square', amplitude=1.0, seconds=4.0, frequency=0.5),
        Segment('rest', 1.0),
        damp_others=True,
        others=(0.4, -0.9),
    )
    rig.go(0.05)
    assert rig.run.start(rig.now)[0]
    command = rig.go(0.5)
    assert (command.names, command.position, command.effort) == (('B',), None, None)
    assert command.velocity.tolist() == [1.0]
    command = rig.go(3.8)
    assert command.names == rig.joints
    np.testing.assert_allclose(command.position, [0.4, rig.position[1], -0.9], atol=0.02)
    rig.go(2.0)
    assert rig.run.code == 0


def test_other_joints_that_are_there_keep_a_drive_in_position_mode_unless_they_may_be_damped():
    rig = Rig(wave('square', amplitude=1.0, frequency=0.5), others=(0.4, -0.9))
    with pytest.raises(InputError, match='A, C could not hold while B is not in position mode'):
        rig.go(0.05)


def test_a_joint_that_is_about_to_pass_its_limit_in_velocity_mode_is_damped_before_it():
    rig = Rig(wave('hold', amplitude=1.0, seconds=1.5), damp_others=True)
    rig.go(0.05)
    rig.run.start(rig.now)
    rig.position[1] = 1.5
    rig.go(0.6)
    assert 'B at 1.9' in rig.run.reason
    assert 'about to pass its limits -2.00..2.00 rad in velocity mode' in rig.run.reason
    assert rig.run.code == 1
    assert rig.position[1] < 2.0


def test_an_interlock_damps_with_its_reason():
    rig = Rig(Segment('rest', 5.0))
    rig.go(0.05)
    rig.run.start(rig.now)
    rig.go(0.5)
    rig.run.monitor.interlock = 'the recorder ended: the disk is full'
    rig.go(0.01)
    assert rig.run.reason == 'recording: the recorder ended: the disk is full'
    assert rig.run.code == 1
    assert rig.sent[-1].position is None


def test_a_run_that_may_fit_tells_what_it_changed():
    rig = Rig(Segment('velocity', 2.0, speed=3.0), Segment('velocity', 2.0, speed=-3.0), fit=True)
    rig.go(0.05)
    assert rig.run.notes[0].startswith('+3 rad/s, 2 s and back: 3 times')
    assert rig.run.start(rig.now)[0]


@pytest.mark.parametrize('mode', ['torque', 'position'])
def test_a_motion_that_saturates_may_ask_for_any_speed_but_for_no_more_torque(mode):
    strong = {'amplitude': 300.0} if mode == 'torque' else {'amplitude': 0.1, 'load': 300.0}
    square = wave('square', mode, frequency=1.0, saturate=True, **strong)
    with pytest.raises(InputError, match=r'300 N·m asked of LF_KFE; its limits are 0\.\.80 N·m'):
        Plan(motion(square), 0.0, Mounting(), Ramps()).check('LF_KFE', KFE)


def test_no_command_holds_more_torque_than_the_limit_even_if_the_plan_does(monkeypatch):
    monkeypatch.setattr(Plan, 'check', lambda *_: None)
    rig = Rig(wave('square', 'torque', 300.0, 4.0, frequency=0.5), damp_others=True)
    rig.go(0.05)
    assert rig.run.start(rig.now)[0]
    assert rig.go(0.5).effort.tolist() == [25.0]
    assert rig.go(1.0).effort.tolist() == [-25.0]


SOAK = Segment('position', 60.0, frequency=2.0, amplitude=0.3, until_warmer=5.0)


@pytest.mark.parametrize(
    ('supply', 'words'),
    [
        (None, 'stale input: drive_supply has no winding temperature of B'),
        ([], 'stale input: drive_supply has no winding temperature of B'),
        ([math.nan], 'not finite: winding temperature of B: nan °C'),
    ],
)
def test_a_soak_does_not_begin_without_a_winding_temperature(supply, words):
    rig = Rig(SOAK)
    rig.supply = supply
    rig.go(0.1)
    assert rig.run.start(rig.now) == (False, words)
    rig.supply = [30.0]
    rig.go(0.1)
    assert rig.run.start(rig.now)[0]


@pytest.mark.parametrize(
    ('supply', 'seconds', 'words'),
    [
        (None, 2.1, 'stale input: the winding temperature of B is 2.0 s old, limit 2 s'),
        ([], 0.01, 'stale input: drive_supply has no winding temperature of B'),
        ([math.nan], 0.01, 'not finite: winding temperature of B: nan °C'),
    ],
)
def test_a_soak_is_damped_once_nobody_knows_how_warm_the_winding_is(supply, seconds, words):
    rig = Rig(Segment('rest', 1.0), SOAK)
    rig.supply = [30.0]
    rig.go(0.1)
    assert rig.run.start(rig.now)[0]
    rig.go(3.0)
    rig.supply = supply
    rig.go(seconds)
    assert rig.run.reason == words
    assert rig.run.code == 1
    assert rig.sent[-1].position is None


def test_while_a_drive_rests_or_cools_nobody_asks_for_its_temperature():
    rig = Rig(Segment('rest', 5.0), SOAK, Segment('rest', 5.0))
    rig.supply = [30.0]
    rig.go(0.1)
    assert rig.run.start(rig.now)[0]
    rig.supply = None
    rig.go(4.0)
    assert rig.run.active
    rig.supply = [30.0]
    rig.go(3.0)
    rig.supply = [35.0]
    rig.go(0.01)
    rig.supply = [math.nan]
    rig.go(8.0)
    assert rig.run.code == 0
