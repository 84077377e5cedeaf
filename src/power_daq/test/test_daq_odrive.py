"""An emulated ODrive is measured: units, stamps, faults, and what diagnostics say."""

import math
import threading
import time

import can
import numpy as np
import pytest
from kept_log import KeptLog
from odrive_emulator import BUS, ENCODER, TEMPERATURE, TORQUES, ODriveEmulator
from power_daq.acquisition.bus_acquisition import (
    Acquisition,
    BusHealth,
    Level,
    Patience,
    SampleQueue,
)
from power_daq.acquisition.receiver import Receiver
from power_daq.bus.connection import BusSettings
from power_daq.bus.description import DEVICE_ERROR, STALE, BusDescription
from power_daq.clock.mapping import RosTime
from wattwalk_core.errors import InputError

S = 1_000_000_000
SYSTEM_MINUS_STEADY = 1_700_000_000 * S


class Rig:
    """A receiver of the ready description; frames arrive when they were sent."""

    def __init__(self, nodes, **kwargs):
        self.bus = BusDescription.ready('odrive', nodes=nodes)
        self.steady = 0
        ros = RosTime(lambda: self.steady + SYSTEM_MINUS_STEADY, lambda: self.steady)
        self.receiver = Receiver(self.bus, ros, **kwargs)
        self.samples = []

    def take(self, *schedules):
        for t, message in sorted((p for s in schedules for p in s), key=lambda pair: pair[0]):
            self.steady = round((t + 10) * S)
            self.samples += self.receiver.take(message, self.steady)
        return self

    def of(self, group):
        """Times [N] in s, sequences [N] and values [N, Q, D] of the samples of a group."""
        chosen = [s for s in self.samples if s.group == group]
        times = np.array([s.stamp - SYSTEM_MINUS_STEADY for s in chosen]) / S - 10
        return times, [s.sequence for s in chosen], np.array([s.values for s in chosen])


def curve(function, times):
    return np.array([function(t) for t in times])


def test_values_come_in_si_units_at_the_times_at_which_the_frames_came():
    hip, knee = ODriveEmulator(0), ODriveEmulator(3)
    rig = Rig({'hip': 0, 'knee': 3}).take(hip.schedule(2.0), knee.schedule(2.0, 0.004))
    times, sequence, values = rig.of('joints')
    assert sequence == list(range(len(times)))
    assert len(times) >= 195
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.01), abs=1e-6)
    for column, drive in enumerate((hip, knee)):
        turns, speed = curve(drive.turns, times), curve(drive.turns_per_second, times)
        assert values[:, 0, column] == pytest.approx(2 * math.pi * turns, abs=2e-3)
        assert values[:, 1, column] == pytest.approx(2 * math.pi * speed, abs=1e-2)
        assert values[:, 2, column] == pytest.approx(curve(drive.torque, times), abs=1e-4)
    times, sequence, values = rig.of('electrical')
    assert sequence == list(range(len(times)))
    for column, drive in enumerate((hip, knee)):
        assert values[:, 0, column] == pytest.approx(curve(drive.volts, times), abs=1e-4)
        assert values[:, 1, column] == pytest.approx(curve(drive.amperes, times), abs=1e-3)
    assert not values[:, 2].any()
    assert rig.receiver.losses == {'electrical': 0, 'joints': 0, 'temperature': 0}
    assert rig.receiver.counts.unknown == 0


def test_the_card_is_told_that_the_torque_is_the_motor_s():
    assert BusDescription.ready('odrive').torque_at == {'AXIS_0': 'motor'}
    assert BusDescription.ready('odrive').torque_unit == {}


def test_the_winding_s_temperature_goes_with_the_supply():
    drive = ODriveEmulator(0, offsets={TEMPERATURE: 0.0}, cycle=1.0)
    _, _, values = Rig({'hip': 0}).take(drive.schedule(3.0)).of('temperature')
    assert values.ravel() == pytest.approx([55.0] * 3)


def test_a_lost_frame_is_interpolated_over_and_lost_samples_are_gaps_of_the_sequence():
    drive = ODriveEmulator(0)
    sent = drive.schedule(1.0)
    torques = [i for i, (_, m) in enumerate(sent) if m.arbitration_id == TORQUES]
    encoder = [i for i, (_, m) in enumerate(sent) if m.arbitration_id == ENCODER]
    gone = {torques[30], encoder[50], encoder[51]}
    rig = Rig({'hip': 0}).take([p for i, p in enumerate(sent) if i not in gone])
    times, sequence, values = rig.of('joints')
    assert np.isfinite(values).all()
    assert values[:, 2, 0] == pytest.approx(curve(drive.torque, times), abs=1e-3)
    # The first encoder frame comes before the first torque and is left out.
    assert np.flatnonzero(np.diff(sequence) > 1).tolist() == [48]
    assert sequence[49] == 51
    joints = rig.receiver.assemblers['joints']
    assert (joints.lost, joints.missing) == (2, [2, 1])


def test_a_drive_that_falls_silent_is_flagged_and_the_others_go_on():
    hip, knee = ODriveEmulator(0), ODriveEmulator(3)
    rig = Rig({'hip': 0, 'knee': 3}).take(hip.schedule(1.0), knee.schedule(3.0, 0.001))
    rig.take(hip.schedule(1.0, 3.0), knee.schedule(1.0, 3.001))
    times, _, values = rig.of('electrical')
    silent = (times > 1.0) & (times < 3.0)
    assert silent.sum() == pytest.approx(200, abs=3)
    assert np.isnan(values[silent, :2, 0]).all()
    assert (values[silent, 2, 0] == STALE).all()
    assert not values[:, 2, 1].any()
    assert values[:, 1, 1] == pytest.approx(curve(knee.amperes, times), abs=1e-3)
    assert not values[times > 3.01, 2].any()
    times, _, values = rig.of('joints')
    assert (np.diff(times) > 0).all()
    assert np.isfinite(values[:, :, 1]).all()
    assert rig.receiver.not_finite.total() == 0, 'silence is said, numbers are not blamed'


def test_numbers_that_are_none_are_flagged_as_the_device_s_error_and_counted():
    hip, knee = ODriveEmulator(0), ODriveEmulator(3)
    hip.broken = {BUS: (24.0, math.nan), ENCODER: (math.nan, 0.0)}
    rig = Rig({'hip': 0, 'knee': 3}).take(hip.schedule(1.0), knee.schedule(1.0))
    _, _, values = rig.of('electrical')
    assert (values[:, 2, 0] == DEVICE_ERROR).all()
    assert not values[:, 2, 1].any()
    assert rig.receiver.not_finite['electrical'] == len(values)
    _, _, values = rig.of('joints')
    assert np.isnan(values[:, 0, 0]).all()
    assert np.isfinite(values[:, 1:, 0]).all()


class Axes(threading.Thread):
    """Emulated axes that send on a bus in real time."""

    def __init__(self, bus, *axes):
        super().__init__(daemon=True)
        self.bus, self.axes = bus, axes
        self.stop = threading.Event()

    def run(self):
        start = time.monotonic()
        sent = sorted(
            (p for axis in self.axes for p in axis.schedule(60.0)), key=lambda pair: pair[0]
        )
        for t, message in sent:
            if self.stop.wait(start + t - time.monotonic()):
                return
            self.bus.send(message)


class Measurement:
    """The ready description read from a bus of python-can."""

    def __init__(self, settings, nodes):
        self.samples = []
        bus = BusDescription.ready('odrive', nodes=nodes)
        self.receiver = Receiver(bus, RosTime())
        patience = Patience(0.01, 0.02, silence=0.3, read=0.02)
        self.acquisition = Acquisition(
            self.receiver, settings.open, self.samples.append, KeptLog(), patience
        )
        self.health = BusHealth(self.acquisition, SampleQueue(10), bus, settings)

    def __enter__(self):
        self.acquisition.start()
        return self

    def __exit__(self, *_):
        self.acquisition.stop()
        self.acquisition.join()

    def until(self, words):
        """Return the first report whose sentence has the words."""
        end = time.monotonic() + 30
        while True:
            report = self.health.report(time.monotonic())
            if words in report.sentence:
                return report
            assert time.monotonic() < end, report.sentence
            time.sleep(0.3)


@pytest.fixture
def settings(request):
    return BusSettings('virtual', request.node.name, 250_000, fd=False)


def measured(settings, nodes, *axes):
    class Both:
        def __enter__(self):
            self.measurement = Measurement(settings, nodes).__enter__()
            self.bus = can.Bus(interface='virtual', channel=settings.channel)
            self.axes = Axes(self.bus, *axes)
            self.axes.start()
            return self.measurement

        def __exit__(self, *_):
            self.axes.stop.set()
            self.axes.join()
            self.bus.shutdown()
            self.measurement.__exit__()

    return Both()


def test_diagnostics_say_that_stamps_are_those_of_receipt(settings):
    with measured(settings, {'hip': 0}, ODriveEmulator(0)) as measurement:
        report = measurement.until('measuring, stamped on receipt')
        assert len(measurement.samples) > 20
    assert report.level is Level.OK
    assert report.figures['stamps'].startswith('electrical, joints, temperature: on receipt')
    assert 0 < float(report.figures['bus load [%]']) < 100


def test_messages_that_the_drive_was_not_told_to_send_are_named_with_its_setting(settings):
    axis = ODriveEmulator(0, offsets={ENCODER: 0.0})
    with measured(settings, {'hip': 0}, axis) as measurement:
        report = measurement.until('no frames of')
    assert report.level is Level.WARN
    assert 'hip Get_Torques (axis0.config.can.torques_msg_rate_ms)' in report.sentence
    assert 'axis0.config.can.bus_voltage_msg_rate_ms' in report.sentence
    assert 'Get_Temperature' not in report.sentence


def test_a_wrong_node_number_is_told_with_the_one_that_is_heard(settings):
    with measured(settings, {'hip': 0}, ODriveEmulator(5)) as measurement:
        report = measurement.until('frames come from node 5')
    assert report.level is Level.ERROR
    assert 'bus silent' in report.sentence
    assert 'the drives are hip=0' in report.sentence
    assert measurement.samples == []


def test_a_bus_on_which_nothing_is_sent_is_silent(settings):
    with measured(settings, {'hip': 0}) as measurement:
        report = measurement.until('bus silent')
    assert report.sentence == 'bus silent: no frame of the mapping comes'


@pytest.mark.parametrize(
    ('nodes', 'words'),
    [
        ({'hip': 64}, 'drives.hip: expected a node from 0 to 63, there is 64'),
        ({'hip': 1, 'knee': 1}, "node 1 is both 'hip' and 'knee'"),
    ],
)
def test_node_numbers_that_cannot_be_are_refused(nodes, words):
    with pytest.raises(InputError, match=words):
        BusDescription.ready('odrive', nodes=nodes)


def test_a_name_without_a_ready_description_is_refused():
    with pytest.raises(InputError, match="no bus 'odrivw': expected one of odrive"):
        BusDescription.ready('odrivw')
