from dataclasses import replace
from threading import Event

import can
import numpy as np
import pytest
from power_daq.bus.description import BusDescription
from sim_bridge.live.real_time import FrameEncoder, LivePlant, SimulatedBus, joint_command
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import Simulation
from sim_bridge.plant.world import Stand, stand_world, walking_world
from sim_bridge.sensors.blocks import Instruments
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError

SYNC, ELECTRICAL = 128, 256


class Clock:
    """Time that passes in sleep alone, with jumps where asked for."""

    def __init__(self, stop, end):
        self.time, self.stop, self.end = 100.0, stop, 100.0 + end
        self.stalls = {}
        self.sleeps = 0

    def now(self):
        if self.time >= self.end:
            self.stop.set()
        return self.time

    def sleep(self, duration):
        self.sleeps += 1
        self.time += duration + 1e-5
        for at in [at for at in self.stalls if self.time > 100.0 + at]:
            self.time += self.stalls.pop(at)


def live(duration, *, world=None, plant=None, stalls=None):
    plant = Plant.load('anymal_c') if plant is None else plant
    simulation = Simulation(plant, walking_world() if world is None else world)
    instruments = Instruments(simulation, seed=0)
    encoder = FrameEncoder(BusDescription.load(), simulation.joints, instruments.clock)
    frames, samples, stop = [], [], Event()
    clock = Clock(stop, duration)
    clock.stalls = dict(stalls or {})
    running = LivePlant(
        simulation,
        instruments,
        encoder,
        frames.extend,
        samples.append,
        now=clock.now,
        sleep=clock.sleep,
    )
    return running, frames, samples, stop, clock


def test_the_plant_keeps_the_pace_of_the_clock():
    running, _, samples, stop, clock = live(0.5)
    running.run(stop)
    assert running.simulation.time == pytest.approx(0.5, abs=0.005)
    steps = np.concatenate([s.electrical.step for s in samples])
    np.testing.assert_array_equal(np.diff(steps), 2)
    assert running.take_progress().factor == pytest.approx(1.0, abs=0.02)
    assert clock.sleeps > 100


def test_after_a_stall_every_sample_is_made_up_for():
    running, frames, _, stop, _ = live(0.6, stalls={0.2: 0.15})
    running.run(stop)
    counters = [int.from_bytes(m.data[4:6], 'little') for m in frames if m.arbitration_id == 256]
    assert counters == list(range(len(counters)))
    assert len(counters) == pytest.approx(600, abs=4)
    assert running.take_progress().worst == pytest.approx(0.15, abs=0.01)


def test_frames_are_in_the_order_of_their_instants_and_sync_comes_first():
    running, frames, _, _, _ = live(1.0)
    for _ in range(30):
        running.advance(20)
    times = [int.from_bytes(m.data[:4], 'little') for m in frames]
    assert times == sorted(times)
    kinds = [m.arbitration_id for m in frames]
    assert all(kinds[i - 1] == SYNC for i, kind in enumerate(kinds) if kind == ELECTRICAL)
    assert kinds.count(ELECTRICAL) == 300
    assert all(m.is_fd and m.bitrate_switch for m in frames)
    joint_frames = [kind for kind in kinds if 272 <= kind <= 275]
    assert len(joint_frames) == 4 * 120
    assert kinds.count(512) == 3


def test_what_is_in_the_frames_is_what_was_sampled():
    running, frames, samples, _, _ = live(1.0)
    running.advance(20)
    bus = BusDescription.load()
    sent = [m for m in frames if m.arbitration_id == ELECTRICAL][-1]
    voltage, current, status = bus.groups['electrical'].decode([bytes(sent.data)])
    np.testing.assert_allclose(voltage, samples[-1].electrical.voltage[-1], atol=1e-3)
    np.testing.assert_allclose(current, samples[-1].electrical.current[-1], atol=1e-3)
    assert not status.any()


def test_the_device_clock_in_the_frames_wraps():
    plant = Plant.load('anymal_c')
    late = replace(plant, meter=replace(plant.meter, clock_offset=2**32 * 1e-6 - 0.005))
    running, frames, _, _, _ = live(1.0, plant=late, world=stand_world('LF_KFE'))
    running.advance(40)
    times = [int.from_bytes(m.data[:4], 'little') for m in frames if m.arbitration_id == SYNC]
    steps = np.diff(np.array(times, dtype=np.uint32))
    assert min(times) < 20_000 < max(times)
    np.testing.assert_array_equal(steps, 1000)


def test_drives_hold_the_start_pose_until_the_first_command():
    running, _, _, stop, _ = live(1.0)
    running.run(stop)
    assert running.simulation.fallen is None
    assert not running.stale


def test_drives_damp_when_commands_stop_coming():
    load = Stand(mass=3.0, length=0.4)
    running, _, _, stop, clock = live(2.0, world=stand_world('LF_KFE', load))
    running.command(JointCommand(position=np.array([1.2])))
    clock.end = 100.09
    running.run(stop)
    assert not running.stale
    held = running.simulation.joint_position[0]
    clock.end, clock.time = 102.0, 100.09
    stop.clear()
    running.run(stop)
    assert running.stale
    assert abs(running.simulation.joint_position[0]) < 0.5 * max(held, 0.6)


def test_a_fall_is_counted_once_and_reset_puts_the_robot_back():
    running, _, _, _, _ = live(1.0)
    running.simulation._data.qpos[3:7] = [0.5, 0.8, 0.0, 0.0]
    for _ in range(10):
        running.advance(4)
    assert running.falls == 1
    assert 'tilted' in running.down
    running.reset()
    running.advance(4)
    assert running.down is None


def test_a_push_from_another_thread_moves_the_robot():
    running, _, _, _, _ = live(1.0)
    running.push(np.array([0.0, 0.6, 0.0]))
    for _ in range(20):
        running.advance(20)
    assert running.simulation.base[1] > 0.005


def test_commands_are_matched_by_name_and_what_is_not_named_is_damped():
    command = joint_command(JOINT_NAMES, ['RH_KFE', 'LF_HAA'], [1.0, 2.0], [], [])
    assert command.velocity is command.effort is None
    assert command.position[[11, 0]].tolist() == [1.0, 2.0]
    assert np.isnan(command.position[1:11]).all()


def test_drives_that_the_bus_names_but_the_bench_lacks_may_be_commanded_to_no_effect():
    names = ['LF_HAA', 'RH_KFE', 'LF_KFE']
    command = joint_command(('RH_KFE',), names, [9.0, 1.0, 9.0], [], [], JOINT_NAMES)
    assert command.position.tolist() == [1.0]


@pytest.mark.parametrize(
    ('names', 'position', 'quoted'),
    [
        (['LF_TOE'], [0.0], "no joint 'LF_TOE'"),
        (['LF_HAA', 'LF_HAA'], [0.0, 0.0], 'named twice'),
        (['LF_HAA'], [0.0, 1.0], 'position has 2 values for 1 names'),
    ],
)
def test_a_command_that_cannot_be_matched_is_refused(names, position, quoted):
    with pytest.raises(ValueError, match=quoted):
        joint_command(JOINT_NAMES, names, position, [], [])


def test_frames_cross_to_another_process_by_socket(tmp_path):
    channel = str(tmp_path / 'bus')
    bus = SimulatedBus('unixsocket', channel)
    reader = can.Bus(interface='unixsocket', channel=channel, fd=True)
    try:
        bus.send([can.Message(arbitration_id=5, is_fd=True, data=b'ab', is_extended_id=False)])
        assert bytes(reader.recv(10.0).data) == b'ab'
    finally:
        reader.shutdown()
        bus.close()


@pytest.mark.parametrize(
    ('interface', 'channel', 'quoted'),
    [
        ('telepathy', 'x', "interface is 'telepathy'.*unixsocket, virtual, socketcan"),
        ('unixsocket', '/nonexistent/folder/bus', "cannot open unixsocket bus '/nonexistent"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_named(interface, channel, quoted):
    with pytest.raises(InputError, match=quoted):
        SimulatedBus(interface, channel)
