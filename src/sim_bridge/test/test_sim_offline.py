import signal
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from drive_bench.motion.file import find_motion
from policy_runner.policies.by_name import load_policy
from policy_runner.policies.velocity_commands import SteadyCommand
from power_daq.bus.description import BusDescription
from power_recordings.card import Card
from power_recordings.reading.reader import Recording
from sim_bridge.commands.arguments import bench as bench_command
from sim_bridge.commands.arguments import sim as sim_command
from sim_bridge.offline.controllers import PolicyWalk, SensedWalk
from sim_bridge.offline.run import run_offline, simulate_recording, walking_run
from sim_bridge.offline.session import Pushes, SimulatedSession
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import PlantBlock, Simulation
from sim_bridge.plant.world import walking_world
from sim_bridge.sensors.blocks import Instruments
from wattwalk_core.anymal import FOOT_NAMES, JOINT_NAMES
from wattwalk_core.errors import InputError
from wattwalk_core.processes import find_program, wait_until

TYPES = {
    '/drive_supply': 'drive_power_msgs/msg/DriveSupply',
    '/joint_states': 'sensor_msgs/msg/JointState',
    '/joint_commands': 'sensor_msgs/msg/JointState',
    '/supply': 'sensor_msgs/msg/BatteryState',
    '/imu': 'sensor_msgs/msg/Imu',
    '/odom': 'nav_msgs/msg/Odometry',
    '/cmd_vel': 'geometry_msgs/msg/TwistStamped',
    '/foot_force': 'sensor_msgs/msg/JointState',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'walk'
    return run_offline(path, duration=3.0, seed=5, terrain='rough', pushes=True)


def test_a_bag_has_the_live_systems_topics_types_and_rates(walk):
    recording = Recording.open(walk)
    assert {name: info.type_name for name, info in recording.topics.items()} == TYPES
    counts = {name: info.count for name, info in recording.topics.items()}
    assert counts['/drive_supply'] == 3000
    assert counts['/joint_states'] == counts['/imu'] == counts['/foot_force'] == 1200
    assert counts['/supply'] == counts['/odom'] == 300
    assert counts['/diagnostics'] in (2, 3)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_closes_the_bag_with_its_metadata_and_card(node_process, tmp_path, number):
    bag = tmp_path / 'walk'
    run = ('sim_bridge', 'sim', '--offline', '--duration', '3600', '-o', str(bag))
    process = node_process(*run)
    process.ended_by_interrupt = (130,)
    assert wait_until((bag / 'walk_0.mcap').exists)
    process.send_signal(number)
    assert process.wait_after(number) in (128 + number, None)
    assert wait_until(lambda: (bag / 'metadata.yaml').exists())
    ending = f'sim: ended by {number.name} after '
    assert wait_until(lambda: process.own_lines[-1].startswith(ending))
    assert 'Traceback' not in process.output
    assert (bag / 'metadata.yaml').exists()
    recording = Recording.open(bag)
    assert recording.problems == ()
    seconds = len(recording.supply()) / 100
    assert recording.card.other['complete'] is False
    assert recording.card.other['ended'] == f'{number.name} after {seconds:g} s'


def test_a_full_disk_leaves_no_folder(node_process, tmp_path):
    sim = f'{find_program("ros2")} run sim_bridge sim --offline --duration 1'
    process = node_process.command('bash', '-c', f'ulimit -f 1024; exec {sim} -o {tmp_path}/walk')
    assert process.wait() == 2
    assert 'may not grow further' in process.own_lines[-1]
    assert 'Traceback' not in process.output
    assert not list(tmp_path.iterdir())


def test_samples_are_complete_in_order_and_on_the_devices_clock(walk):
    supply = Recording.open(walk).drive_supply()
    assert supply.names == JOINT_NAMES
    np.testing.assert_array_equal(np.diff(supply.sequence.astype(int)), 1)
    np.testing.assert_array_equal(np.diff(supply.device_time.astype(int)), 1_000_000)
    span = supply.stamp_ns[-1] - supply.stamp_ns[0]
    device = int(supply.device_time[-1] - supply.device_time[0])
    assert device / span - 1.0 == pytest.approx(18e-6, abs=1e-6)


def test_values_are_those_that_survive_the_wire(walk):
    recording, bus = Recording.open(walk), BusDescription.load()
    supply, joints = recording.drive_supply(), recording.joint_states()
    voltage, current = bus.quantise('electrical', supply.voltage, supply.current)
    np.testing.assert_allclose(voltage, supply.voltage, atol=1e-5)
    np.testing.assert_allclose(current, supply.current, atol=1e-5)
    position, _, torque = bus.quantise('joints', joints.position, joints.velocity, joints.effort)
    np.testing.assert_allclose(position, joints.position, atol=1e-6)
    np.testing.assert_allclose(torque, joints.effort, atol=1e-5)


def test_the_whole_robot_draws_what_its_drives_and_electronics_draw(walk):
    recording = Recording.open(walk)
    supply = recording.supply()
    assert (supply.current < 0.0).all()
    drives = recording.drive_supply().power.sum(axis=1).mean()
    lost_before_the_meter = supply.power.mean() - drives - 192.0
    assert abs(lost_before_the_meter) < 20.0


def test_the_card_says_what_was_simulated(walk):
    card = Card.load(walk)
    assert (card.robot, card.unit, card.seed) == ('anymal_c', '0', 5)
    assert (card.controller, card.terrain, card.drives) == ('trot', 'rough', JOINT_NAMES)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    folders = [tmp_path / name / 'bag' for name in 'abc']
    for folder, seed in zip(folders, (1, 1, 2), strict=True):
        folder.parent.mkdir()
        run_offline(folder, duration=1.0, seed=seed)
    contents = [
        {file.name: file.read_bytes() for file in sorted(folder.iterdir())} for folder in folders
    ]
    assert contents[0] == contents[1]
    assert contents[0] != contents[2]
    assert set(contents[0]) == {'bag_0.mcap', 'card.yaml', 'metadata.yaml'}


def test_a_run_in_memory_is_the_run_in_the_bag(walk):
    run = walking_run(Plant.load('anymal_c'), duration=3.0, seed=5, terrain='rough', pushes=True)
    memory, bag = simulate_recording(run), Recording.open(walk)
    topics = ('drive_supply', 'joint_states', 'joint_commands', 'supply', 'cmd_vel', 'imu', 'odom')
    for topic in topics:
        kept, read = getattr(memory, topic)(), getattr(bag, topic)()
        np.testing.assert_array_equal(kept.stamp_ns, read.stamp_ns)
        for field in ('current', 'position', 'velocity', 'effort', 'temperature'):
            if hasattr(kept, field):
                np.testing.assert_allclose(getattr(kept, field), getattr(read, field))
    assert memory.foot_force().names == FOOT_NAMES


def test_another_unit_draws_another_power_in_the_same_walk():
    powers = [
        simulate_recording(walking_run(Plant.load('anymal_c').unit(unit), duration=2.5, seed=1))
        .drive_supply()
        .power.mean()
        for unit in (0, 4)
    ]
    assert 0.002 < abs(powers[1] / powers[0] - 1.0) < 0.3


def test_only_the_asked_drives_are_metered():
    run = walking_run(Plant.load('anymal_c'), duration=0.5, seed=0, drives=('RH_KFE', 'LF_HAA'))
    recording = simulate_recording(run)
    assert recording.drive_supply().names == ('RH_KFE', 'LF_HAA')
    assert recording.joint_states().names == JOINT_NAMES


@pytest.mark.parametrize(
    ('arguments', 'quoted'),
    [
        ({'duration': 0.0}, 'duration is 0.0'),
        ({'seed': -1}, 'seed is -1'),
        ({'drives': ('LF_TOE',)}, "no drive 'LF_TOE'"),
        ({'controller': 'gallop'}, "no controller 'gallop'.*trot"),
        ({'terrain': 'moon'}, "terrain is 'moon'.*flat, rough"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_written(tmp_path, arguments, quoted):
    with pytest.raises(InputError, match=quoted):
        run_offline(tmp_path / 'bag', **{'duration': 1.0, 'seed': 0, **arguments})
    assert not (tmp_path / 'bag').exists()


def test_the_command_writes_a_bag_and_refuses_to_replace_one(tmp_path, capsys):
    arguments = ['--offline', '--seed', '3', '--duration', '0.5', '-o', str(tmp_path / 'bag')]
    assert sim_command([*arguments, '--drives', 'LF_KFE', '--controller', 'stand']) == 0
    assert Recording.open(tmp_path / 'bag').card.drives == ('LF_KFE',)
    assert sim_command(arguments) == 2
    assert 'exists already' in capsys.readouterr().err
    assert sim_command(['--offline']) == 2


class Topple:
    """Pulls all legs in, which a standing robot does not survive."""

    name, period, velocity = 'topple', 20, None
    resets = 0

    def command(self, simulation):
        return JointCommand(position=np.tile([0.4, 2.0, 2.0], 4))

    def reset(self):
        self.resets += 1


def test_a_fall_is_told_once_and_the_robot_stands_again_after_a_second():
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    controller = Topple()
    session = SimulatedSession(simulation, Instruments(simulation, 0), controller)
    events = [event for stretch in session.run(3.0) for event in stretch.events]
    falls = [event for event in events if event.kind == 'fall']
    assert falls
    assert all(later.step - first.step >= 2000 for first, later in pairwise(falls))
    assert controller.resets >= 1


def test_what_is_sensed_in_pieces_is_what_is_read_of_the_whole():
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    whole, pieces = Instruments(simulation, 3), Instruments(simulation, 3)
    blocks = [simulation.advance(steps) for steps in (40, 40, 20)]
    for block in blocks:
        pieces.sense(block)
    wanted, found = (one.read(PlantBlock.join(blocks)) for one in (whole, pieces))
    for part in ('joints', 'body'):
        for name, values in vars(getattr(wanted, part)).items():
            sensed = getattr(getattr(found, part), name)
            np.testing.assert_allclose(sensed, values, rtol=1e-12, atol=1e-12)  # filters round


def test_a_policy_on_sensors_walks_and_leaves_as_many_readings():
    """The scripted trot walks at 0.4 m/s; 200 joint samples come in each half second."""
    speeds, sums = [], []
    for walk in (PolicyWalk, SensedWalk):
        simulation = Simulation(Plant.load('anymal_c'), walking_world())
        controller = walk('trot', load_policy('trot'), SteadyCommand((0.4, 0.0, 0.0)))
        instruments = Instruments(simulation, 0)
        session = SimulatedSession(simulation, instruments, controller)
        parts = [stretch.samples for stretch in session.run(6.0)]
        speeds.append(np.mean([part.odometry.velocity[:, 0].mean() for part in parts[8:]]))
        sums.append([len(part.joints.step) for part in parts])
    np.testing.assert_allclose(speeds, 0.4, atol=0.15)  # a trot alone does not see its speed
    assert sums[0] == sums[1] == [200] * 12


def test_a_policy_at_400_hz_acts_on_the_sample_before_the_last_too():
    simulation = Simulation(Plant.load('anymal_c'), walking_world())
    instruments, walks = Instruments(simulation, 0), []
    readings = [instruments.sense(simulation.advance(5)) for _ in range(3)]
    for given in (readings[1:], readings):
        walks.append(SensedWalk('trot', load_policy('trot'), SteadyCommand((0.4, 0.0, 0.0))))
        for reading in given:
            walks[-1].sense(*reading)
    before_last = readings[1][0]
    for walk in walks:
        np.testing.assert_array_equal(walk._inputs.position, before_last.position[0])
        np.testing.assert_array_equal(walk._inputs.effort, before_last.torque[0])
    walks[0].reset()
    assert not len(walks[0]._inputs.effort)


def test_pushes_come_from_all_sides_with_moderate_strength():
    pushes = Pushes(3)
    found = [push for t in np.arange(0.0, 600.0, 0.1) if (push := pushes.due(t)) is not None]
    speeds = np.linalg.norm(found, axis=1)
    assert 75 < len(found) < 200
    assert speeds.min() >= 0.2
    assert speeds.max() <= 0.6
    assert {tuple(np.sign(push[:2])) for push in found} == {(1, 1), (1, -1), (-1, 1), (-1, -1)}


def test_a_push_in_the_air_gives_the_whole_robot_the_velocity_asked_for():
    simulation = Simulation(Plant.load('ideal'), walking_world())
    model, data = simulation.world.model, simulation._data
    data.qpos[2] += 2.0
    simulation.push(np.array([0.3, -0.4, 0.0]))
    simulation.advance(250)
    mujoco.mj_subtreeVel(model, data)
    np.testing.assert_allclose(data.subtree_linvel[0][:2], [0.3, -0.4], atol=1e-3)


@pytest.mark.parametrize('mode', ['position', 'velocity', 'torque'])
def test_the_bench_command_records_one_drive_in_each_mode(tmp_path, mode):
    bag = tmp_path / mode
    arguments = ['sine', '-o', str(bag), '--mode', mode, '--duration', '1', '--drive', 'RF_HFE']
    assert bench_command(arguments) == 0
    recording = Recording.open(bag)
    commands = recording.joint_commands()
    given = {
        'position': commands.position,
        'velocity': commands.velocity,
        'torque': commands.effort,
    }
    assert recording.drive_supply().names == recording.joint_states().names == ('RF_HFE',)
    wave = commands.stamp_ns > commands.stamp_ns[0] + int(2.01e9)
    back = commands.stamp_ns > commands.stamp_ns[0] + int(2.99e9)
    assert np.isfinite(given.pop(mode)[wave & ~back]).all()
    if mode == 'position':
        given.pop('velocity')
    assert all(np.isnan(other[wave & ~back]).all() for other in given.values())
    assert '/imu' not in recording.topics


@pytest.mark.parametrize(
    ('arguments', 'quoted'),
    [
        (('jump',), "no motion 'jump'; there are chirp, "),
        (('passes', 'torque'), 'one way only'),
        (('holds', 'velocity'), "no mode 'velocity'; it has position, torque"),
        (('holds',), 'holds shares of a load, and there is none'),
    ],
)
def test_a_wrong_bench_motion_is_refused(arguments, quoted):
    with pytest.raises(InputError, match=quoted):
        find_motion(*arguments).with_pull(0.0)


def test_a_frequency_beyond_all_reason_is_refused():
    with pytest.raises(InputError, match='frequency: expected 0 to 100 Hz, there is 200'):
        find_motion('sine').changed(frequency=200.0)


def test_a_soak_on_the_stand_ends_once_the_winding_is_warm(tmp_path):
    file = tmp_path / 'soak.yaml'
    file.write_text(
        'format: motion/1\nsegments:\n'
        '- {mode: position, shape: sine, amplitude: 1.5, frequency: 4.0, saturate: true, '
        'until_warmer: 0.5, seconds: 6}\n- {mode: rest, seconds: 1}\n'
    )
    assert bench_command([str(file), '-o', str(tmp_path / 'soak')]) == 0
    recording = Recording.open(tmp_path / 'soak')
    joints, supply = recording.joint_states(), recording.drive_supply()
    since = (joints.stamp_ns - joints.stamp_ns[0]) * 1e-9
    moving = np.abs(joints.velocity[:, 0]) > 1.0
    assert 0.3 < since[moving].max() < 3.0
    rise = supply.temperature[:, 0].max() - supply.temperature[0, 0]
    assert 0.4 < rise < 1.5
