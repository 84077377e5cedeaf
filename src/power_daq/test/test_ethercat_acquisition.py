"""The acquisition on a segment made of Python, whose every frame a test decides on."""

import struct
import threading
import time

import numpy as np
import pytest
from kept_log import KeptLog
from power_daq.acquisition.bus_acquisition import SampleQueue
from power_daq.clock.mapping import RosTime
from power_daq.ethercat.acquisition import SegmentAcquisition, SegmentHealth, SegmentPatience
from power_daq.ethercat.mapping import SegmentMapping
from power_daq.ethercat.soem import longest_call
from power_daq.ethercat.terminals import SegmentError, SlaveIdentity
from power_recordings.calibration import Calibration
from wattwalk_core.nodes.diagnostics import Level

from drive_power_msgs.msg import DriveSupply

CONTENT = """
device: terminals
cycle: 0.002
segment: [EK1100, EL3102]
electrical:
  drives:
    - drive: LF_KFE
      voltage: {terminal: 1, channel: 1, ratio: 10.0}
      current: {terminal: 1, channel: 2, ratio: 5.0, offset: 0.5}
"""
GONE = DriveSupply.STALE | DriveSupply.DEVICE_ERROR


class Frames:
    """A coupler and an EL3102; `script` is asked for each frame, counted over all openings."""

    def __init__(self, script):
        self.script = script
        self.frame = 0
        self.toggle = 0
        self.image = bytes(8)
        self.found = [SlaveIdentity(2, 0x044C2C52), SlaveIdentity(2, 0x0C1E3052)]
        self.opened = self.closed = 0
        self.threads = set()
        self.entered, self.left = [], []

    def __call__(self):
        self.opened += 1
        return self

    def find(self):
        self.threads.add(threading.current_thread().name)
        return self.found

    def read(self, slave, index, subindex):
        return b'\0'

    def operate(self):
        return 1

    def exchange(self):
        self.entered.append(time.monotonic_ns())
        counter, status, turn = self.script(self.frame)
        self.frame += 1
        if counter >= 0 and turn:
            self.toggle ^= 0x8000
            word = self.toggle | status
            self.image = struct.pack('<HhHh', word, 0x4000, word, -0x2000)
        self.left.append(time.monotonic_ns())
        return counter

    def inputs(self, slave):
        return self.image if slave else b''

    def close(self):
        self.closed += 1


def good(frame):
    return 1, 0, True


class Run:
    def __init__(self, tmp_path, script, patience=None, calibration=None, ros_time=None):
        path = tmp_path / 'ethercat.yaml'
        path.write_text(CONTENT)
        self.mapping = SegmentMapping.load(path)
        self.frames = Frames(script)
        self.samples, self.said = [], KeptLog()
        self.acquisition = SegmentAcquisition(
            self.mapping,
            self.frames,
            self.samples.append,
            self.said,
            calibration,
            patience or SegmentPatience(0.01, 0.05, 20),
            ros_time,
        )
        self.health = SegmentHealth(self.acquisition, SampleQueue(10), 'eth9')

    def until(self, condition):
        end = time.monotonic() + 120.0
        while not condition():
            assert time.monotonic() < end, f'waited in vain; it said {self.said}'
            time.sleep(0.005)

    def __enter__(self):
        self.acquisition.start()
        return self

    def __exit__(self, *_):
        self.acquisition.stop()
        self.acquisition.join(60.0)
        assert self.frames.closed == self.frames.opened


def test_samples_are_volts_times_ratio_plus_offset_at_the_time_of_the_frame_before(tmp_path):
    with Run(tmp_path, good) as run:
        run.until(lambda: len(run.samples) > 10)
    voltage, current, status = run.samples[0].values
    assert voltage == pytest.approx(10.0 * 10.0 * 0x4000 / 0x7FFF)
    assert current == pytest.approx(0.5 - 5.0 * 10.0 * 0x2000 / 0x7FFF)
    assert status == DriveSupply.OK
    offset = run.acquisition.ros_time.offset
    ended = [0, *run.frames.left]
    for number, sample in enumerate(run.samples[:10]):
        assert ended[number] <= sample.device_time <= run.frames.entered[number + 1]
        assert abs(sample.stamp - offset - sample.device_time) < 5e6
    stamps = [sample.stamp for sample in run.samples]
    assert stamps == sorted(set(stamps))
    assert run.said[-1] == 'EtherCAT: operating EK1100, EL3102'


def test_a_calibration_corrects_the_quantities_not_the_volts(tmp_path):
    calibration = Calibration(np.array([[1.1], [2.0]]), np.array([[0.3], [-0.1]]))
    with Run(tmp_path, good, calibration=calibration) as run:
        run.until(lambda: run.samples)
    voltage, current, _ = run.samples[0].values
    assert voltage == pytest.approx(0.3 + 1.1 * 100.0 * 0x4000 / 0x7FFF)
    assert current == pytest.approx(-0.1 + 2.0 * (0.5 - 50.0 * 0x2000 / 0x7FFF))


def test_the_status_of_the_terminal_goes_along(tmp_path):
    with Run(tmp_path, lambda frame: (1, 0x0042 if frame == 5 else 0, True)) as run:
        run.until(lambda: len(run.samples) > 8)
    flags = [int(sample.values[2, 0]) for sample in run.samples[:8]]
    assert flags == [0, 0, 0, 0, DriveSupply.OVERRANGE | DriveSupply.DEVICE_ERROR, 0, 0, 0]
    assert run.acquisition.counts.overrange == 1
    assert np.isfinite(run.samples[4].values).all()


def test_data_that_the_terminal_calls_invalid_are_no_numbers(tmp_path):
    with Run(tmp_path, lambda frame: (1, 0x4000 if frame == 5 else 0, True)) as run:
        run.until(lambda: len(run.samples) > 8)
    assert np.isnan(run.samples[4].values[:2]).all()
    assert run.samples[4].values[2] == DriveSupply.DEVICE_ERROR


def test_a_value_whose_toggle_stands_still_is_not_published_again(tmp_path):
    with Run(tmp_path, lambda frame: (1, 0, frame not in (5, 6))) as run:
        run.until(lambda: len(run.samples) > 8)
    known = [bool(np.isfinite(sample.values[:2]).all()) for sample in run.samples[:8]]
    assert known == [True, True, True, True, False, False, True, True]
    assert run.samples[4].values[2] == DriveSupply.STALE
    assert run.acquisition.counts.stale == 2


def test_a_frame_that_does_not_come_back_is_a_gap_in_the_sequence_and_nothing_is_stale(tmp_path):
    with Run(tmp_path, lambda frame: (-1 if frame == 5 else 1, 0, True)) as run:
        run.until(lambda: len(run.samples) > 10)
    assert run.acquisition.counts.frames_lost == 1
    assert run.acquisition.counts.stale == 0
    assert run.samples[4].sequence - run.samples[3].sequence >= 3
    assert run.acquisition.lost >= 2


def test_a_slave_that_drops_out_is_flagged_then_the_segment_is_opened_again(tmp_path):
    def script(frame):
        out = 10 <= frame < 30
        return (0, 0, False) if out else (1, 0, True)

    with Run(tmp_path, script) as run:
        run.until(lambda: run.acquisition.counts.times_operating == 2)
        more = len(run.samples)
        run.until(lambda: len(run.samples) > more + 3)
    flagged = [sample for sample in run.samples if sample.values[2, 0]]
    assert len(flagged) == 20
    assert all(sample.values[2, 0] == GONE for sample in flagged)
    assert all(np.isnan(sample.values[:2]).all() for sample in flagged)
    assert run.acquisition.counts.slaves_missing == 20
    assert sum('working counter 0 instead of 1 for 20 cycles' in line for line in run.said) == 1


def test_a_cable_that_is_pulled_is_told_and_what_is_missed_is_counted(tmp_path):
    with Run(tmp_path, lambda frame: (-1 if 10 <= frame < 30 else 1, 0, True)) as run:
        run.until(lambda: run.acquisition.counts.times_operating == 2)
        more = len(run.samples)
        run.until(lambda: len(run.samples) > more + 3)
    assert run.acquisition.counts.frames_lost == 20
    assert run.acquisition.lost >= 20
    assert any('no frame came back for 20 cycles: check the cable' in line for line in run.said)


def test_a_wrong_segment_is_told_once_tried_again_and_taken_when_it_is_right(tmp_path):
    run = Run(tmp_path, good)
    right = run.frames.found
    run.frames.found = right[:1]
    with run:
        run.until(lambda: run.frames.opened > 5)
        assert run.samples == []
        assert run.acquisition.lost == 0
        report = run.health.report(time.monotonic())
        assert report.level is Level.ERROR
        assert 'segment absent: EL3102' in report.sentence
        run.frames.found = right
        run.until(lambda: run.samples)
    assert sum('should be at position 1' in line for line in run.said) == 1


def test_the_report_names_the_faults_of_the_last_second(tmp_path):
    with Run(tmp_path, lambda frame: (1, 0x0001 if frame == 5 else 0, True)) as run:
        run.health.report(time.monotonic())
        run.until(lambda: len(run.samples) > 8)
        report = run.health.report(time.monotonic())
    assert report.level is Level.WARN
    assert '1 underrange' in report.sentence
    assert report.figures['segment'] == 'EK1100, EL3102'
    assert report.figures['segment state'] == 'operating'


def test_one_thread_owns_the_segment_and_its_exceptions_come_out_of_join(tmp_path):
    def script(frame):
        if frame == 3:
            raise ZeroDivisionError
        return good(frame)

    run = Run(tmp_path, script)
    run.acquisition.start()
    run.until(lambda: run.acquisition.failed)
    with pytest.raises(ZeroDivisionError):
        run.acquisition.join()
    assert run.frames.threads == {'ethercat'}
    assert run.frames.closed == 1


def test_a_mailbox_that_does_not_answer_is_tried_again(tmp_path):
    run = Run(tmp_path, good)
    failures = iter([True, True])

    def read(slave, index, subindex):
        if next(failures, False):
            raise SegmentError('0x8000:01 of the slave at position 1 cannot be read')
        return b'\0'

    run.frames.read = read
    with run:
        run.until(lambda: run.samples)
    assert sum('cannot be read' in line for line in run.said) == 1


@pytest.mark.parametrize('step', [-700_000_000, 700_000_000])
def test_stamps_follow_a_system_clock_that_is_stepped(tmp_path, step):
    moved = [0]
    clock = RosTime(lambda: time.time_ns() + moved[0], period=10_000_000)
    with Run(tmp_path, good, ros_time=clock) as run:
        run.until(lambda: len(run.samples) > 10)
        moved[0] = step
        run.until(lambda: clock.steps)
        more = len(run.samples) + 2
        run.until(lambda: len(run.samples) > more + 20)
    samples = run.samples[more : more + 20]
    system = time.time_ns() - time.monotonic_ns() + step
    for sample in samples:
        assert abs(sample.stamp - sample.device_time - system) < 5e6
    stamps = [sample.stamp for sample in samples]
    assert stamps == sorted(set(stamps))
    assert clock.steps == 1


def test_a_stop_while_the_segment_comes_up_ends_it_at_the_call_under_way_and_closes(tmp_path):
    run = Run(tmp_path, good)
    reached, go_on, calls = threading.Event(), threading.Event(), []

    def read(slave, index, subindex):
        calls.append(index)
        reached.set()
        go_on.wait(60.0)
        return b'\0'

    run.frames.read = read
    run.acquisition.start()
    assert reached.wait(60.0)
    run.acquisition.stop()
    assert not run.acquisition.join(0.05), 'it is still inside of the call'
    assert run.frames.closed == 0
    go_on.set()
    assert run.acquisition.join(60.0)
    assert run.frames.closed == 1
    assert len(calls) == 1
    assert run.acquisition.counts.times_operating == 0


def test_the_longest_call_covers_what_soem_waits_for_each_slave():
    assert longest_call(2, 0.002) == pytest.approx(2 * (2.0 + 2 * 0.7) + 2 * 2.0 + 402 * 0.002)
    assert longest_call(1, 0.5) == pytest.approx((10.0 + 2 * 10.0) + 2 * 10.0 + 402 * 0.5)
