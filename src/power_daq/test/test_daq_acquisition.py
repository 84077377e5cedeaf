import socket
import threading
import time

import can
import numpy as np
import pytest
from kept_log import KeptLog
from power_daq.acquisition.bus_acquisition import (
    Acquisition,
    Arrivals,
    BusHealth,
    BusState,
    Level,
    Patience,
    SampleQueue,
)
from power_daq.acquisition.receiver import Receiver, Sample
from power_daq.bus.connection import BusSettings
from power_daq.bus.description import BusDescription
from power_daq.bus.unix_socket import pack
from power_daq.clock.mapping import RosTime
from signal_generator import SignalGenerator
from wattwalk_core.errors import InputError

BUS = BusDescription.load()
PATIENCE = Patience(first_retry=0.01, last_retry=0.02, silence=0.3, read=0.02)


def until(condition, deadline=30.0):
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end, 'never happened'
        time.sleep(0.005)


class Robot:
    """A signal generator in a thread, as host of a Unix socket or on a virtual bus."""

    def __init__(self, **bus):
        self.bus = can.Bus(**bus)
        self.generator = SignalGenerator(BUS, self.bus)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.generator.run, args=(self._stop,))
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self.bus.shutdown()


class Measurement:
    """An acquisition with all that it needs, and what it gave."""

    def __init__(self, settings, sink=None):
        self.samples = []
        self.reports = KeptLog()
        self.receiver = Receiver(BUS, RosTime())
        self.queue = SampleQueue(100_000)
        self.acquisition = Acquisition(
            self.receiver,
            settings.open,
            sink or self.samples.append,
            self.reports,
            PATIENCE,
        )
        self.health = BusHealth(self.acquisition, self.queue, BUS, settings)

    def __enter__(self):
        self.acquisition.start()
        return self

    def __exit__(self, *_):
        self.acquisition.stop()
        self.acquisition.join()

    def of(self, group):
        return [sample for sample in self.samples if sample.group == group]

    def await_more(self, count=50):
        enough = len(self.samples) + count
        until(lambda: len(self.samples) > enough)


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / 'bus')


@pytest.fixture
def settings(path):
    return BusSettings('unixsocket', path)


def host(path):
    return Robot(interface='unixsocket', channel=path, host=True)


def test_samples_of_all_groups_come_in_order_over_a_virtual_bus():
    settings = BusSettings('virtual', 'test_daq_acquisition')
    with (
        Measurement(settings) as measurement,
        Robot(interface='virtual', channel=settings.channel),
    ):
        until(lambda: {s.group for s in measurement.samples} == set(BUS.groups))
        until(lambda: len(measurement.of('joints')) > 100)
        assert measurement.acquisition.state is BusState.ACTIVE
    for group in BUS.groups:
        samples = measurement.of(group)
        assert (np.diff([s.sequence for s in samples]) == 1).all()
        assert (np.diff([s.stamp for s in samples]) > 0).all()
        assert samples[0].values.shape == BUS.groups[group].shape
    assert set(measurement.receiver.losses.values()) == {0}
    assert abs(measurement.of('electrical')[-1].stamp - time.time_ns()) < 60e9


def test_stamps_are_those_of_the_robot_s_own_truth(path, settings):
    with host(path) as robot, Measurement(settings) as measurement:
        measurement.await_more(400)
        ros = measurement.receiver.ros_time
        errors = [
            s.stamp - ros.of(robot.generator.true_time(s.device_time // 1000))
            for s in measurement.of('electrical')
        ]
    assert min(errors) > -1_000_000
    assert np.median(errors) < 5_000_000


def test_a_bus_that_is_absent_is_waited_for_and_read_again_after_it_went(path, settings):
    with Measurement(settings) as measurement:
        until(lambda: 'No such file' in measurement.acquisition.absence)
        assert measurement.acquisition.state is BusState.ABSENT
        assert measurement.health.report(0.0).level is Level.ERROR
        for opened in (1, 2):
            with host(path):
                measurement.await_more()
                assert measurement.acquisition.opened == opened
            until(lambda: measurement.acquisition.state is BusState.ABSENT)
        assert 'bus absent' in measurement.health.report(1.0).sentence
    assert len([line for line in measurement.reports if line.startswith('reading')]) == 2


def test_a_bus_on_which_nothing_comes_is_silent_until_something_does(path, settings):
    with host(path) as robot, Measurement(settings) as measurement:
        measurement.await_more()
        everything = set(range(2048))
        robot.generator.silenced = everything
        until(lambda: measurement.acquisition.state is BusState.SILENT)
        assert 'silent' in measurement.health.report(0.0).sentence
        robot.generator.silenced = set()
        measurement.await_more()
        assert measurement.acquisition.state is BusState.ACTIVE
    assert measurement.receiver.losses['electrical'] > 100


def test_faults_on_the_bus_are_counted_and_measuring_goes_on(path, settings):
    with host(path), Measurement(settings) as measurement, can.Bus(path, 'unixsocket') as rogue:
        measurement.await_more()
        measurement.health.report(0.0)
        wrong = can.Message(arbitration_id=256, is_extended_id=False, is_fd=True, data=bytes(48))
        error = can.Message(is_error_frame=True, dlc=8, data=bytes(8))
        for k in range(3000):
            rogue.send(can.Message(arbitration_id=0x600 + k % 100, is_extended_id=False), 10.0)
        for _ in range(5):
            rogue.send(wrong, 10.0)
            rogue.send(error, 10.0)
        counts = measurement.receiver.counts
        until(lambda: counts.error_frames == 5 and counts.wrong_length == 5)
        measurement.await_more()
        report = measurement.health.report(1.0)
    assert counts.unknown == 3000
    assert len(measurement.receiver.unknown_ids) == 16
    assert report.level is Level.WARN
    for words in ('3000 unknown', '5 error frames', '5 wrong length'):
        assert words in report.sentence
    assert report.figures['bus state'] == 'active'
    assert report.figures['wrong length DRIVE_SUPPLY: 48 bytes, not 64'] == '5'
    assert sum(name.startswith('unknown id 0x6') for name in report.figures) == 4
    assert float(report.figures['bus load [%]']) > 0


def test_malformed_packets_are_counted_on_a_bus_that_stays_open(path, settings):
    foreign = pack([can.Message(arbitration_id=0x600, is_extended_id=False)])
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener,
        Measurement(settings) as measurement,
    ):
        listener.bind(path)
        listener.listen(1)
        peer, _ = listener.accept()
        with peer:
            for k in range(1000):
                peer.send((b'junk', bytes(8 + 3), foreign[:-1] + b'\xff' * 9)[k % 3])
            peer.send(foreign)
            counts = measurement.receiver.counts
            until(lambda: counts.unknown == 1)
            measurement.health.report(0.0)
            report = measurement.health.report(1.0)
            assert measurement.acquisition.opened == 1
    assert counts.malformed_packets == 1000
    assert report.level is Level.ERROR
    assert report.figures['malformed packets'] == '1000'


def test_malformed_packets_are_said_where_the_bus_is_silent(settings):
    measurement = Measurement(settings)
    measurement.acquisition._bus = object()
    measurement.health.report(0.0)
    measurement.receiver.counts.malformed_packets += 12
    sentence = measurement.health.report(1.0).sentence
    assert sentence == 'bus silent: no frame of the mapping comes, but 12 malformed packets'


class Waits:
    """A stop event whose waits pass at once and are kept; set after some of them."""

    def __init__(self, most):
        self.kept, self._most = [], most

    def is_set(self):
        return len(self.kept) >= self._most

    def wait(self, timeout):
        self.kept.append(timeout)


class Unsteady:
    """A bus that gives some frames and is then lost."""

    channel_info = 'unsteady'

    def __init__(self, *frames):
        self.frames = list(frames)

    def recv(self, timeout):
        if self.frames:
            return self.frames.pop()
        raise can.CanOperationError('gone')

    def shutdown(self):
        pass


def test_a_bus_that_is_lost_at_once_is_opened_again_with_growing_pauses_until_a_frame_comes():
    (good,) = BUS.encode('electrical', 1, 1000, np.zeros(12), np.zeros(12))
    buses = [Unsteady(), Unsteady(), Unsteady(), Unsteady(good), Unsteady()]
    acquisition = Acquisition(
        Receiver(BUS, RosTime()),
        lambda: buses.pop(0),
        lambda sample: None,
        KeptLog(),
        Patience(first_retry=0.5, last_retry=100.0),
    )
    acquisition._stop = waits = Waits(5)
    acquisition._work()
    assert waits.kept == [0.5, 1.0, 2.0, 0.5, 1.0]


def test_a_leg_that_stops_sending_is_named(path, settings):
    with host(path) as robot, Measurement(settings) as measurement:
        measurement.await_more()
        measurement.health.report(0.0)
        robot.generator.silenced = {273}
        until(lambda: measurement.receiver.losses['joints'] > 20)
        joints = len(measurement.of('joints'))
        measurement.await_more(100)
        report = measurement.health.report(1.0)
        assert len(measurement.of('joints')) == joints
    assert 'RF_JOINTS missing' in report.sentence
    assert 'LF_JOINTS missing' not in report.figures


def test_a_device_that_starts_again_is_measured_again(path, settings):
    with host(path) as robot, Measurement(settings) as measurement:
        measurement.await_more()
        robot.generator.start_us += 3_000_000_000
        robot.generator.counter_offset = 777
        until(lambda: measurement.receiver.clocks['device'].epoch > 0)
        measurement.await_more(300)
    assert measurement.receiver.clocks['device'].settled
    assert (np.diff([s.sequence for s in measurement.of('electrical')]) > 0).all()


def test_whatever_ends_the_thread_comes_out_of_join(path, settings):
    def sink(sample):
        raise ZeroDivisionError('no sink')

    measurement = Measurement(settings, sink)
    with host(path):
        measurement.acquisition.start()
        until(lambda: measurement.acquisition.failed)
    with pytest.raises(ZeroDivisionError, match='no sink'):
        measurement.acquisition.join()
    assert measurement.acquisition.state is BusState.ABSENT


def test_an_acquisition_that_never_started_can_be_stopped(settings):
    acquisition = Measurement(settings).acquisition
    acquisition.stop()
    acquisition.join()


def test_a_full_queue_drops_new_samples_and_counts_them():
    queue = SampleQueue(3)
    samples = [Sample('joints', k, k, k, np.zeros((3, 1))) for k in range(5)]
    for sample in samples:
        queue.put(sample)
    assert queue.dropped == 2
    assert [queue.get(0.0).sequence for _ in range(3)] == [0, 1, 2]
    assert queue.get(0.0) is None


@pytest.mark.parametrize(
    ('interface', 'channel', 'words'),
    [('sockatcan', 'can0', "'sockatcan'"), ('virtual', '', 'channel is empty')],
)
def test_a_bus_that_can_never_be_there_is_refused(interface, channel, words):
    with pytest.raises(InputError, match=words):
        BusSettings(interface, channel).open()


def test_bus_load_is_the_share_of_time_on_the_wire():
    settings = BusSettings('virtual', 'x', bitrate=1_000_000, data_bitrate=5_000_000)
    frames, payload = 1000, 64_000
    seconds = 1.1 * frames * (29e-6 + (34 + 512) / 5e6)
    assert settings.load(frames, payload) == pytest.approx(seconds)


class Clocks:
    """A steady clock that is set by hand, and a system clock that is stepped."""

    def __init__(self):
        self.steady, self.offset = 5_000_000_000, 1_700_000_000_000_000_000

    def arrivals(self):
        return Arrivals(0.05, lambda: self.steady + self.offset, lambda: self.steady)

    def stamp(self):
        return (self.steady + self.offset) * 1e-9


def test_a_frame_arrived_when_it_was_stamped_even_if_it_is_read_later():
    clocks = Clocks()
    arrivals = clocks.arrivals()
    arrivals.of(clocks.stamp())
    clocks.steady += 100_000_000
    stamped, arrived = clocks.stamp(), clocks.steady
    clocks.steady += 8_000_000
    assert abs(arrivals.of(stamped) - arrived) < 1000
    clocks.steady += 60_000_000
    assert arrivals.of(stamped) == clocks.steady, 'as old as that it cannot be'


@pytest.mark.parametrize('step', [20_000_000, -20_000_000, 1_500_000_000, -700_000_000])
def test_a_step_of_the_system_clock_never_makes_a_frame_arrive_before_it_was_sent(step):
    clocks = Clocks()
    arrivals = clocks.arrivals()
    waiting, worst = [], 0
    for count in range(400):
        clocks.steady += 1_000_000
        if count == 200:
            clocks.offset += step
        waiting.append((clocks.steady, clocks.stamp()))
        if count % 10 == 0:
            for sent, stamp in waiting:
                worst = max(worst, sent - arrivals.of(stamp))
            waiting.clear()
    assert worst < 1000, 'ns before it was sent, but for the rounding of stamps'
