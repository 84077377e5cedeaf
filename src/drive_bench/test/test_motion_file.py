import math

import numpy as np
import pytest
from drive_bench.motion.file import MotionFile, Segment
from drive_bench.motion.joint_limits import JointLimits, limits_of
from drive_bench.motion.plan import JUMPS, Mounting, Plan, Ramps
from drive_bench.run.motion_run import MotionRun
from policy_runner.supervisor.safety import SafetyConfig
from wattwalk_core.errors import InputError

PENDULUM = Mounting(pendulum=20.0)
LIMITS = JointLimits(-3.0, 3.0, 5.0, 25.0)
JOINTS = ('A', 'B', 'C')


def motion(*segments):
    return MotionFile('next', ('B',), tuple(segments))


def turn(speed, seconds, load=0.0):
    return Segment('velocity', seconds, speed=speed, load=load)


def hold(torque, seconds=10.0):
    return Segment('torque', seconds, torque=torque)


def checked(*segments, mounting=PENDULUM, limits=LIMITS, start=0.0):
    Plan(motion(*segments), start, mounting, Ramps()).check('B', limits)


def written(tmp_path, text):
    file = tmp_path / 'next.yaml'
    file.write_text(text)
    return file


def test_a_file_is_read_as_segments_drives_and_supply_voltages(tmp_path):
    file = written(
        tmp_path,
        'format: motion/1\ndrives: [B]\nrepeat_at_supply_voltage: [44.0, 52]\nsegments:\n'
        '- {mode: rest, seconds: 2}\n- {mode: torque, low: -3, high: 9, frequency: 1, seconds: 4}',
    )
    read = MotionFile.load(file)
    assert read.name == 'next'
    assert read.supply == (44.0, 52.0)
    assert read.seconds == 6.0
    assert read.strongest == 9.0
    assert read.segments[1].alternates


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('format: motion/2', "format: expected 'motion/1', there is 'motion/2'"),
        ('format: [', 'is no valid YAML'),
        (
            'format: motion/1\ndrives: B\nsegments: [{mode: rest, seconds: 1}]',
            "drives: expected a list, there is 'B'",
        ),
        ('format: motion/1\nsegments: []', 'needs segments'),
        (
            'format: motion/1\nsegments: [{mode: rest, seconds: .nan}]',
            'segments[0].seconds: expected 0.001 to 36000 s, there is nan',
        ),
        (
            'format: motion/1\nsegments: [{mode: rest, seconds: 0}]',
            'segments[0].seconds: expected 0.001 to 36000 s, there is 0',
        ),
        (
            'format: motion/1\nsegments: [{mode: position, seconds: 1, frequency: 200}]',
            'segments[0].frequency: expected 0 to 100 Hz, there is 200',
        ),
    ],
)
def test_a_file_that_is_no_motion_is_refused_with_the_entry(tmp_path, text, words):
    with pytest.raises(InputError) as refusal:
        MotionFile.load(written(tmp_path, text))
    assert words in str(refusal.value)


def test_a_held_torque_is_the_angle_at_which_gravity_gives_it():
    plan = Plan(motion(hold(10.0)), 0.2, PENDULUM, Ramps(way=1.0))
    assert plan.at(9.9).position == pytest.approx(math.asin(10.0 / 20.0))
    assert plan.at(0.0).position == pytest.approx(0.2)
    way = math.pi / 6 - 0.2
    assert plan.paths[0].way_seconds == pytest.approx(math.pi / 2 * way)
    assert plan.paths[0].seconds == 10.0 + plan.paths[0].way_seconds, 'the hold is whole'
    middle = plan.at(0.5 * plan.paths[0].way_seconds)
    assert middle.position == pytest.approx(0.2 + way / 2)
    assert middle.velocity == pytest.approx(1.0)


def test_a_pendulum_that_hangs_elsewhere_or_after_a_turn_is_held_about_there():
    mounting = Mounting(pendulum=20.0, hanging=0.5)
    plan = Plan(motion(hold(20.0)), 2 * math.pi + 0.4, mounting, JUMPS)
    assert plan.at(1.0).position == pytest.approx(2 * math.pi + 0.5 + math.pi / 2)


def test_without_a_pendulum_everything_is_about_where_the_joint_starts():
    swing = Segment('position', 4.0, frequency=1.0, amplitude=0.3)
    plan = Plan(motion(Segment('rest', 1.0), swing), 1.2, Mounting(), Ramps())
    assert plan.at(0.7).position == 1.2
    assert plan.at(1.0 + 1.25).position == pytest.approx(1.2 + 0.3)
    assert plan.at(1.0 + 0.25).position == pytest.approx(1.2 + 0.25 * 0.3), 'it fades in'
    assert plan.at(1.0 + 3.75).position == pytest.approx(1.2 - 0.25 * 0.3), 'and out'


def test_turning_gains_and_loses_its_speed_and_comes_back_to_where_it_was():
    plan = Plan(motion(turn(2.0, 1.5), turn(-2.0, 1.5)), 0.1, PENDULUM, Ramps(acceleration=40.0))
    ramp = 2.0 / 40.0
    assert plan.paths[0].turn_seconds == ramp
    assert plan.at(ramp / 2).velocity == pytest.approx(1.0)
    assert plan.at(0.7).velocity == 2.0
    assert plan.at(0.7).position == pytest.approx(0.1 + 2.0 * (0.7 - ramp / 2))
    assert plan.at(1.5).position == pytest.approx(0.1 + 2.0 * (1.5 - ramp))
    assert plan.at(3.0).position == pytest.approx(0.1)


@pytest.mark.parametrize('mounting', [PENDULUM, Mounting(pendulum=20.0, hanging=-0.4)])
def test_with_ramps_no_target_jumps_in_place_or_moves_faster_than_asked(mounting):
    segments = (
        Segment('rest', 3.0),
        turn(2.0, 1.5, load=10.0),
        turn(-2.0, 1.5, load=10.0),
        hold(-12.0),
        Segment('torque', 20.0, low=-5.0, high=5.0, frequency=0.1),
        Segment('position', 6.0, frequency=1.0, amplitude=0.3, load=8.0),
    )
    plan = Plan(motion(*segments), 0.3, mounting, Ramps())
    plan.check('B', LIMITS)
    times = np.arange(0.0, plan.seconds, 0.001)
    targets = [plan.at(time) for time in times]
    position = np.array([target.position for target in targets])
    assert np.abs(np.diff(position)).max() <= 1.001 * 0.001 * 2.0
    fed = np.array([target.velocity for target in targets])
    moving = np.abs(fed) > 0.0
    np.testing.assert_allclose(np.gradient(position, 0.001)[moving], fed[moving], atol=0.05)
    for path in plan.paths:
        low, high = path.extent
        inside = [path.at(t).position for t in np.linspace(0.0, path.seconds, 200)]
        assert min(inside) >= low - 1e-9
        assert max(inside) <= high + 1e-9
    assert plan.at(plan.seconds).position == pytest.approx(mounting.hanging), 'back to hanging'


def test_a_locked_joint_stays_and_is_pushed():
    steps = Segment('torque', 4.0, low=-8.0, high=8.0, frequency=1.0)
    plan = Plan(motion(hold(10.0, 5.0), steps), 0.7, Mounting(locked=True), Ramps(torque=40.0))
    assert plan.at(0.125).effort == pytest.approx(5.0)
    assert plan.at(3.0).effort == 10.0
    assert {plan.at(5.25 + 0.2 + t).effort for t in (0.1, 0.4, 1.1)} == {8.0}
    assert {plan.at(5.25 + 0.2 + t).effort for t in (0.6, 0.9)} == {-8.0}
    assert {plan.at(t).position for t in np.linspace(0.0, 9.4, 50)} == {0.7}
    assert plan.seconds == pytest.approx(0.25 + 5.0 + 0.2 + 4.0)


def test_turning_at_no_speed_holds_the_load():
    plan = Plan(motion(turn(0.0, 10.0, load=10.0)), 0.0, PENDULUM, JUMPS)
    assert plan.at(5.0).position == pytest.approx(math.pi / 6)


@pytest.mark.parametrize(
    ('segment', 'mounting', 'words'),
    [
        (turn(6.0, 0.9), PENDULUM, '6 rad/s asked of B; its limits are 0..5 rad/s'),
        (turn(2.0, 2.0), PENDULUM, 'B would go to 3.90 rad; its limits are -3.00..3.00 rad'),
        (hold(26.0), PENDULUM, '26 N·m asked of B; its limits are 0..25 N·m'),
        (hold(22.0), PENDULUM, 'needs a load of up to 22 N·m, given is 20 N·m'),
        (turn(1.0, 1.0, 5.0), Mounting(), 'needs a load of up to 5 N·m, given is none'),
        (turn(1.0, 1.0), Mounting(locked=True), 'a locked joint cannot move'),
        (turn(4.0, 0.2), PENDULUM, 'give it at least 0.25 s'),
        (
            Segment('torque', 20.0, low=-10.0, high=10.0, frequency=1.0),
            PENDULUM,
            'takes 1.64 s from one torque to the other; lock the joint (--locked), or at most',
        ),
        (
            Segment('position', 5.0, frequency=4.0, amplitude=1.5),
            PENDULUM,
            '37.7 rad/s asked of B; its limits are 0..5 rad/s',
        ),
    ],
)
def test_what_leaves_the_limits_is_refused_with_value_and_range(segment, mounting, words):
    with pytest.raises(InputError) as refusal:
        checked(Segment('rest', 1.0), segment, mounting=mounting)
    assert words in str(refusal.value)
    assert str(refusal.value).startswith('segment 2 (')


def test_limits_come_from_a_file_by_pattern_or_are_those_of_the_robot(tmp_path):
    file = written(
        tmp_path,
        'format: joint_limits/1\njoints:\n'
        '  LF_KFE: {position: [-1, 1], speed: 2, torque: 3}\n'
        "  '*_KFE': {position: [-2, 2], speed: 4, torque: 5}\n",
    )
    found = limits_of(('LF_KFE', 'RF_KFE', 'RF_HAA'), file)
    assert found == {
        'LF_KFE': JointLimits(-1.0, 1.0, 2.0, 3.0),
        'RF_KFE': JointLimits(-2.0, 2.0, 4.0, 5.0),
    }
    assert limits_of(('LF_HAA', 'elbow')) == {'LF_HAA': JointLimits(-0.72, 0.49, 8.0, 80.0)}


@pytest.mark.parametrize(
    ('entry', 'words'),
    [
        (
            '{position: [1, -1], speed: 2, torque: 3}',
            'joints.A: position: the lowest angle must be below the highest',
        ),
        ('{position: [-1, 1], speed: 2}', "joints.A: 'torque' is missing"),
        (
            '{position: [-1, .inf], speed: 2, torque: 3}',
            'joints.A.position[1]: expected -1000 to 1000 rad, there is inf',
        ),
        ('{position: 2, speed: 2, torque: 3}', 'joints.A.position: expected a list, there is 2'),
    ],
)
def test_limits_that_make_no_sense_are_refused(tmp_path, entry, words):
    file = written(tmp_path, f'format: joint_limits/1\njoints:\n  A: {entry}\n')
    with pytest.raises(InputError) as refusal:
        limits_of(JOINTS, file)
    assert words in str(refusal.value)


class Rig:
    """Three joints that follow their targets at once, every 5 ms of a clock of its own."""

    def __init__(self, *segments, mounting=PENDULUM):
        self.run = MotionRun(
            motion(*segments), JOINTS, ('B',), mounting, {'B': LIMITS}, SafetyConfig()
        )
        self.now, self.silent = 50.0, False
        self.position, self.velocity, self.effort = (
            np.array([0.4, 0.1, -0.9]),
            [0.0] * 3,
            [0.0] * 3,
        )
        self.sent = []

    def go(self, seconds):
        for _ in range(round(seconds / 0.005)):
            self.now += 0.005
            if not self.silent:
                self.run.inputs.on_joints(
                    round(self.now * 1e9),
                    JOINTS,
                    self.position,
                    self.velocity,
                    self.now,
                    self.effort,
                )
            self.sent.append(self.run.update(self.now))
            if self.sent[-1] is not None and self.sent[-1].position is not None:
                self.position = self.sent[-1].position
        return self.sent[-1]

    def begun(self):
        self.go(0.05)
        started, told = self.run.start(self.now)
        assert started, told
        self.go(0.5)
        assert self.run.active
        return self


def assert_damps(rig, words, code=1):
    command = rig.sent[-1]
    assert command.position is None
    assert command.velocity.tolist() == [0.0] * 3
    assert command.effort is None
    assert words in rig.run.reason
    assert rig.run.code == code


def test_nothing_is_sent_before_the_start_and_then_only_the_named_drive_moves():
    rig = Rig(Segment('rest', 1.0), turn(2.0, 1.0), turn(-2.0, 1.0))
    assert rig.go(0.5) is None
    assert rig.run.reason == 'ready, waits for start'
    assert rig.run.start(rig.now) == (True, '3 s to go')
    rig.go(1.5)
    command = rig.sent[-1]
    assert rig.run.reason == 'segment 2 of 3: +2 rad/s, 1 s'
    assert command.position[[0, 2]].tolist() == [0.4, -0.9]
    assert command.velocity.tolist() == [0.0, 2.0, 0.0]
    first = next(entry for entry in rig.sent if entry is not None)
    assert first.position.tolist() == [0.4, 0.1, -0.9], 'it begins where the joints are'
    rig.go(2.0)
    assert_damps(rig, 'done', code=0)
    assert 'ros2 run power_lab diagnose bags/next' in rig.run.progress(recorded=False)


def test_a_stall_makes_the_motion_longer_and_no_jump():
    rig = Rig(turn(1.0, 2.0)).begun()
    before = rig.sent[-1].position[1]
    rig.now += 0.045
    rig.go(0.005)
    assert rig.sent[-1].position[1] - before == pytest.approx(0.03, abs=1e-9)


def test_silence_damps_after_60_ms():
    rig = Rig(turn(1.0, 2.0)).begun()
    rig.silent = True
    rig.go(0.055)
    assert rig.run.code is None
    rig.go(0.01)
    assert_damps(rig, 'stale input: joint_states is 6')


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'position': np.array([0.4, np.nan, -0.9])}, 'not finite: joint position'),
        ({'velocity': [0.0, 7.0, 0.0]}, 'joint limit: B at 7.00 rad/s, at most 6.25 rad/s'),
        ({'effort': [0.0, -40.0, 0.0]}, 'joint limit: B at 40.00 N·m, at most 31.25 N·m'),
        ({'effort': [0.0, np.nan, 0.0]}, 'joint limit: B at nan N·m'),
        ({'position': np.array([0.4, 3.3, -0.9])}, 'joint limit: B at 3.30 rad'),
        ({'position': np.array([0.4, -1.4, -0.9])}, 'rad from its target, limit 1.5 rad'),
    ],
)
def test_what_is_measured_beyond_the_limits_damps(change, words):
    rig = Rig(turn(1.0, 2.0)).begun()
    for name, value in change.items():
        setattr(rig, name, value)
    rig.go(0.005)
    assert_damps(rig, words)
    rig.position, rig.velocity, rig.effort = np.zeros(3), [0.0] * 3, [0.0] * 3
    rig.go(0.5)
    assert_damps(rig, words)


def test_what_others_do_is_not_judged_by_the_limits_of_the_drive():
    rig = Rig(turn(1.0, 2.0)).begun()
    rig.velocity, rig.effort = [20.0, 0.0, 0.0], [90.0, 0.0, 0.0]
    rig.go(0.1)
    assert rig.run.active


def test_stop_and_emergency_stop_damp_and_end():
    rig = Rig(turn(1.0, 2.0)).begun()
    rig.run.stop(rig.now)
    rig.go(0.01)
    assert_damps(rig, 'stop: asked for', code=130)
    rig = Rig(turn(1.0, 2.0)).begun()
    rig.run.emergency_stop(rig.now)
    rig.go(0.01)
    assert_damps(rig, 'emergency stop: asked for')


def test_a_second_publisher_damps_and_keeps_it_from_starting():
    rig = Rig(turn(1.0, 2.0)).begun()
    rig.run.count_publishers(2)
    rig.go(0.005)
    assert_damps(rig, '2 nodes publish joint_commands; stop all but this one')
    rig = Rig(turn(1.0, 2.0))
    rig.run.count_publishers(2)
    rig.go(0.05)
    assert not rig.run.start(rig.now)[0]


def test_a_motion_that_leaves_the_limits_from_where_the_joint_stands_is_refused_before_the_start():
    rig = Rig(turn(2.0, 1.4), mounting=Mounting())
    rig.position = np.array([0.4, 0.5, -0.9])
    with pytest.raises(InputError, match=r'B would go to 3\.20 rad; its limits are -3\.00\.\.3'):
        rig.go(0.005)


def test_a_drive_that_is_not_there_or_has_no_limits_is_refused():
    with pytest.raises(InputError, match="no drive 'D' in joint_states; it has A, B, C"):
        MotionRun(motion(hold(1.0)), JOINTS, ('D',), PENDULUM, {}, SafetyConfig())
    with pytest.raises(InputError, match='no limits are known for B'):
        MotionRun(motion(hold(1.0)), JOINTS, ('B',), PENDULUM, {}, SafetyConfig())


def test_a_motion_under_way_is_not_planned_anew():
    rig = Rig(turn(1.0, 2.0)).begun()
    left = rig.run.policy.left
    with pytest.raises(InputError, match='next is under way; stop it before planning it anew'):
        rig.run.plan()
    assert rig.run.policy.left == left
    rig.go(0.1)
    assert rig.run.policy.left == pytest.approx(left - 0.1)


def test_a_start_before_the_first_step_plans_once():
    rig = Rig(turn(1.0, 2.0))
    rig.run.inputs.on_joints(1, JOINTS, rig.position, rig.velocity, rig.now, rig.effort)
    assert rig.run.start(rig.now)[0]
    left = rig.run.policy.left
    rig.go(0.5)
    assert rig.run.policy.left == pytest.approx(left - 0.5, abs=0.02)
