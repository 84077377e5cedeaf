import numpy as np
import pytest
from policy_runner.policies.by_name import load_policy
from policy_runner.supervisor.safety import FaultKind, SafetyConfig, SafetyMonitor
from policy_runner.supervisor.supervisor import State, Supervisor
from wattwalk_core.anymal import DEFAULT_POSE, JOINT_NAMES
from wattwalk_core.errors import InputError

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STILL = (0.0, 0.0, 0.0)


class Holding:
    """A policy that holds the default pose and says with what it was called."""

    rate = 200.0
    ramp = 0.1

    def __init__(self):
        self.targets = np.array(DEFAULT_POSE)
        self.commands = []
        self.velocities = []
        self.resets = 0

    def reset(self):
        self.resets += 1

    def step(self, time, command, inputs, base_velocity):
        self.commands.append(np.array(command))
        self.velocities.append(base_velocity)
        return self.targets


class Rig:
    """A supervisor whose robot answers every 5 ms of a clock of its own."""

    def __init__(self, **options):
        self.policy = Holding()
        self.supervisor = Supervisor(self.policy, **options)
        self.now = 100.0
        self.position = np.array(DEFAULT_POSE)
        self.orientation = UPRIGHT
        self.silent = set()

    def feed(self):
        stamp, inputs = round(self.now * 1e9), self.supervisor.inputs
        if 'joint_states' not in self.silent:
            inputs.on_joints(stamp, JOINT_NAMES, self.position, np.zeros(12), self.now)
        if 'imu' not in self.silent:
            inputs.on_imu(stamp, self.orientation, STILL, self.now)
        if 'odom' not in self.silent:
            inputs.on_odom(stamp, (0.1, 0.0, 0.0), self.now)

    def go(self, seconds):
        output = None
        for _ in range(round(seconds / 0.005)):
            self.now += 0.005
            self.feed()
            output = self.supervisor.update(self.now)
        return output

    def running(self):
        self.go(0.01)
        assert self.supervisor.start(self.now)[0]
        self.go(0.2)
        assert self.supervisor.state is State.RUNNING
        return self


def assert_damping(rig, kind, words):
    output = rig.go(0.1)
    assert rig.supervisor.state is State.DAMPING
    assert output.targets is None
    assert rig.supervisor.fault.kind is kind
    assert words in rig.supervisor.reason


def test_idle_sends_nothing_until_started():
    rig = Rig()
    assert rig.go(1.0) is None
    assert rig.supervisor.state is State.IDLE
    assert rig.policy.resets == 0


def test_it_stands_up_for_the_ramp_without_commands_and_then_runs():
    rig = Rig(source=lambda time: np.array([0.4, 0.0, 0.0]))
    rig.go(0.01)
    assert rig.supervisor.start(rig.now) == (True, 'standing up')
    rig.go(0.05)
    assert rig.supervisor.state is State.STANDING_UP
    assert not np.any(rig.policy.commands)
    output = rig.go(0.1)
    assert rig.supervisor.state is State.RUNNING
    assert output.targets is not None
    assert rig.policy.commands[-1].tolist() == [0.4, 0.0, 0.0]
    assert rig.policy.resets == 1


def test_it_does_not_start_before_the_robot_speaks():
    supervisor = Supervisor(Holding())
    started, reason = supervisor.start(1.0)
    assert not started
    assert 'joint_states never came' in reason
    assert supervisor.state is State.IDLE


def test_it_does_not_start_on_its_side():
    rig = Rig()
    rig.orientation = (np.sin(0.75), 0.0, 0.0, np.cos(0.75))
    rig.go(0.01)
    started, reason = rig.supervisor.start(rig.now)
    assert not started
    assert 'tilt: 1.50 rad' in reason


@pytest.mark.parametrize('topic', ['joint_states', 'imu'])
def test_silence_of_an_input_damps_and_names_the_topic(topic):
    rig = Rig().running()
    rig.silent.add(topic)
    assert_damping(rig, FaultKind.STALE, f'{topic} is 65 ms old, limit 60 ms')


def test_silence_shorter_than_the_limit_is_borne():
    rig = Rig().running()
    rig.silent = {'joint_states', 'imu'}
    rig.go(0.055)
    rig.silent = set()
    assert rig.go(0.1).targets is not None


def test_after_a_stall_of_the_runner_itself_waiting_messages_are_read_before_judging():
    rig = Rig().running()
    rig.now += 0.2
    assert rig.supervisor.update(rig.now) is None
    rig.feed()
    assert rig.go(0.005).targets is not None
    assert rig.supervisor.state is State.RUNNING


def test_a_runner_that_stalls_again_and_again_damps_for_lack_of_fresh_input():
    rig = Rig().running()
    rig.now += 0.2
    assert rig.supervisor.update(rig.now) is None
    rig.now += 0.2
    assert rig.supervisor.update(rig.now).targets is None
    assert rig.supervisor.fault.kind is FaultKind.STALE


def test_messages_whose_stamp_stands_still_count_as_silence():
    rig = Rig().running()
    frozen = rig.now
    rig.silent.add('joint_states')
    for _ in range(20):
        rig.now += 0.005
        rig.feed()
        rig.supervisor.inputs.on_joints(
            round(frozen * 1e9), JOINT_NAMES, rig.position, np.zeros(12), rig.now
        )
        rig.supervisor.update(rig.now)
    assert rig.supervisor.fault.kind is FaultKind.STALE


def test_nan_in_a_joint_position_damps():
    rig = Rig().running()
    rig.position = rig.position.copy()
    rig.position[5] = np.nan
    assert_damping(rig, FaultKind.NOT_FINITE, 'joint position')


def test_nan_in_a_velocity_command_damps():
    rig = Rig().running()
    rig.supervisor.inputs.on_command((np.nan, 0.0, 0.0), rig.now)
    assert_damping(rig, FaultKind.NOT_FINITE, 'velocity command')


def test_a_velocity_command_beyond_all_reason_damps():
    rig = Rig().running()
    rig.supervisor.inputs.on_command((0.0, 50.0, 0.0), rig.now)
    assert_damping(rig, FaultKind.COMMAND_RANGE, '50.0')


def test_an_imu_without_orientation_damps():
    rig = Rig().running()
    rig.orientation = (0.0, 0.0, 0.0, 0.0)
    assert_damping(rig, FaultKind.MALFORMED, 'no unit quaternion')


def test_a_tilted_body_damps():
    rig = Rig().running()
    rig.orientation = (0.0, np.sin(0.5), 0.0, np.cos(0.5))
    assert_damping(rig, FaultKind.TILT, '1.00 rad, limit 0.90 rad')


@pytest.mark.parametrize(('joint', 'angle'), [(0, 0.7), (3, -0.7), (1, 10.0), (11, -9.7)])
def test_a_joint_beyond_its_limit_damps_and_is_named(joint, angle):
    rig = Rig().running()
    rig.position = rig.position.copy()
    rig.position[joint] = angle
    assert_damping(rig, FaultKind.JOINT_LIMIT, JOINT_NAMES[joint])


def test_a_missing_joint_damps_and_is_named():
    rig = Rig().running()
    rig.silent.add('joint_states')
    rig.supervisor.inputs.on_joints(
        round(rig.now * 1e9) + 1, JOINT_NAMES[:-1], np.zeros(11), np.zeros(11), rig.now
    )
    assert_damping(rig, FaultKind.MALFORMED, 'joint_states lacks RH_KFE')


def test_joint_states_of_the_wrong_length_damp():
    rig = Rig().running()
    rig.silent.add('joint_states')
    rig.supervisor.inputs.on_joints(
        round(rig.now * 1e9) + 1, JOINT_NAMES, np.zeros(7), np.zeros(12), rig.now
    )
    assert_damping(rig, FaultKind.MALFORMED, '12 names, 7 positions')


@pytest.mark.parametrize('count', [0, 11])
def test_joint_states_without_all_velocities_damp(count):
    rig = Rig().running()
    rig.silent.add('joint_states')
    rig.supervisor.inputs.on_joints(
        round(rig.now * 1e9) + 1, JOINT_NAMES, rig.position, np.zeros(count), rig.now
    )
    assert_damping(rig, FaultKind.MALFORMED, f'12 names, 12 positions and {count} velocities')


def test_a_policy_that_gives_nan_is_cut_off():
    rig = Rig().running()
    rig.policy.targets = np.full(12, np.nan)
    assert_damping(rig, FaultKind.NOT_FINITE, 'joint targets')


def test_a_policy_that_gives_absurd_targets_is_cut_off():
    rig = Rig().running()
    rig.policy.targets = np.array(DEFAULT_POSE)
    rig.policy.targets[3] = 30.0
    assert_damping(rig, FaultKind.TARGET_RANGE, 'RF_HAA wanted at 30.00 rad')


def test_damping_lasts_after_the_fault_has_gone():
    rig = Rig().running()
    rig.silent.add('imu')
    rig.go(0.2)
    rig.silent.clear()
    rig.go(5.0)
    assert rig.supervisor.state is State.DAMPING
    assert rig.supervisor.start(rig.now)[0]
    assert rig.go(0.2).targets is not None


def test_it_starts_again_by_itself_only_when_told_to_and_inputs_are_sound():
    rig = Rig(restart_after=1.0).running()
    rig.orientation = (1.0, 0.0, 0.0, 0.0)
    rig.go(3.0)
    assert rig.supervisor.state is State.DAMPING
    rig.orientation = UPRIGHT
    rig.go(0.9)
    assert rig.supervisor.state is State.DAMPING
    rig.go(0.3)
    assert rig.supervisor.state in (State.STANDING_UP, State.RUNNING)
    assert rig.supervisor.faults == 1


def test_a_stop_is_not_undone_by_the_automatic_restart():
    rig = Rig(restart_after=0.5).running()
    rig.supervisor.stop(rig.now)
    rig.go(3.0)
    assert rig.supervisor.state is State.DAMPING
    assert rig.supervisor.faults == 0


def test_random_commands_go_on_after_a_restart_where_they_were():
    asked = []

    def source(time):
        asked.append(time)
        return np.zeros(3)

    rig = Rig(restart_after=0.5, source=source).running()
    rig.go(1.0)
    before = asked[-1]
    rig.silent.add('imu')
    rig.go(0.2)
    rig.silent.clear()
    rig.go(0.7)
    assert rig.supervisor.state is State.RUNNING
    assert before < asked[-1] < before + 0.3


def test_a_stop_while_idle_changes_nothing():
    rig = Rig()
    assert rig.supervisor.stop(rig.now) == (True, 'idle')
    assert rig.go(0.1) is None


def test_an_emergency_stop_holds_until_it_is_released():
    rig = Rig(restart_after=0.5).running()
    rig.supervisor.emergency_stop(rig.now)
    rig.go(2.0)
    started, reason = rig.supervisor.start(rig.now)
    assert not started
    assert 'call stop first' in reason
    rig.supervisor.stop(rig.now)
    assert rig.supervisor.start(rig.now)[0]


def test_an_emergency_stop_works_while_idle():
    rig = Rig()
    rig.go(0.01)
    rig.supervisor.emergency_stop(rig.now)
    assert rig.go(0.01).targets is None
    assert not rig.supervisor.start(rig.now)[0]


def test_a_fault_does_not_hide_an_emergency_stop():
    rig = Rig().running()
    rig.supervisor.emergency_stop(rig.now)
    rig.silent.add('imu')
    rig.go(0.5)
    assert rig.supervisor.fault.kind is FaultKind.EMERGENCY_STOP


def test_a_velocity_command_runs_out_when_nobody_repeats_it():
    rig = Rig().running()
    rig.supervisor.inputs.on_command((0.3, 0.0, 0.1), rig.now)
    rig.go(0.2)
    assert rig.policy.commands[-1].tolist() == [0.3, 0.0, 0.1]
    rig.go(0.5)
    assert rig.policy.commands[-1].tolist() == [0.0, 0.0, 0.0]


def test_odometry_is_used_while_it_is_fresh_and_its_loss_is_no_fault():
    rig = Rig().running()
    assert rig.policy.velocities[-1].tolist() == [0.1, 0.0, 0.0]
    rig.silent.add('odom')
    rig.go(0.2)
    assert rig.policy.velocities[-1] is None
    assert rig.supervisor.state is State.RUNNING


def test_the_first_targets_after_a_start_begin_at_the_measured_pose():
    rig = Rig()
    rig.position = np.array(DEFAULT_POSE) + 0.4
    rig.go(0.01)
    rig.supervisor.start(rig.now)
    output = rig.go(0.005)
    assert np.abs(output.targets - rig.position).max() <= 40.0 * 0.005 + 1e-9


@pytest.mark.parametrize('field', ['stale_after', 'tilt', 'target_rate'])
@pytest.mark.parametrize('value', [0.0, -1.0, float('nan')])
def test_limits_that_would_switch_safety_off_are_refused(field, value):
    with pytest.raises(InputError, match=f'{field} is'):
        SafetyConfig(**{field: value})


def test_unknown_policies_are_refused_with_those_there_are():
    with pytest.raises(InputError, match="no policy 'gallop'; there are trot, trot_slow"):
        load_policy('gallop')


def test_sound_inputs_and_targets_have_no_fault():
    rig = Rig()
    rig.go(0.01)
    monitor = SafetyMonitor(SafetyConfig())
    assert monitor.inputs(rig.supervisor.inputs, rig.now) is None
    assert monitor.targets(np.array(DEFAULT_POSE)) is None
