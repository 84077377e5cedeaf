import numpy as np
import pytest
from power_daq.acquisition.assembly import Assembler
from power_daq.bus.description import BusDescription

PERIOD = 2_500_000


class Joints:
    """The four joint frames of the shipped bus into an assembler."""

    def __init__(self):
        self.bus = BusDescription.load()
        self.assembler = Assembler(self.bus.groups['joints'])

    def send(self, count, slots=(0, 1, 2, 3), at=None, raw=None):
        """Frames of sample number count; the indices of what became complete."""
        time = PERIOD * count if at is None else at
        messages = self.bus.encode(
            'joints', count if raw is None else raw, time // 1000, *np.full((3, 12), 0.001 * count)
        )
        done = []
        for slot in slots:
            sample = self.assembler.add(
                slot, (count if raw is None else raw) % 65536, time, time, messages[slot].data
            )
            if sample is not None:
                done.append(sample)
        return done


@pytest.fixture
def joints():
    return Joints()


def test_a_sample_is_complete_with_its_last_frame_in_whatever_order(joints):
    assert joints.send(7, (2, 0, 3)) == []
    (sample,) = joints.send(7, (1,))
    assert (sample.number, sample.device_time) == (0, 7 * PERIOD)
    np.testing.assert_allclose(sample.values[0], 0.007, atol=2e-6)
    assert joints.assembler.lost == 0


def test_a_missing_frame_loses_its_sample_and_no_other(joints):
    indices = []
    for count in range(10):
        slots = (0, 1, 3) if count == 4 else (0, 1, 2, 3)
        indices += [sample.number for sample in joints.send(count, slots)]
    assert indices == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert joints.assembler.lost == 1
    assert joints.assembler.missing == [0, 0, 1, 0]


def test_values_of_an_earlier_sample_never_fill_a_gap(joints):
    joints.send(0)
    joints.send(1, (0, 1, 2))
    (sample,) = joints.send(2)
    np.testing.assert_allclose(sample.values[1], 0.002, atol=3e-4)


def test_a_leg_that_is_gone_for_good_is_counted_while_it_is_gone(joints):
    joints.send(0)
    for count in range(1, 101):
        assert joints.send(count, (0, 1, 2)) == []
    assert 90 <= joints.assembler.lost <= 100
    assert joints.assembler.missing[3] == joints.assembler.lost
    assert [s.number for s in joints.send(101)] == [101]
    assert joints.assembler.lost == 100


def test_joining_in_the_middle_of_a_sample_is_no_loss(joints):
    assert joints.send(0, (2, 3)) == []
    assert [s.number for s in joints.send(1)] == [1]
    assert joints.assembler.lost == 0
    assert joints.assembler.missing == [0, 0, 0, 0]


def test_frames_of_two_samples_may_interleave(joints):
    joints.send(0)
    assert joints.send(1, (0, 1)) == []
    assert joints.send(2, (0, 1)) == []
    assert [s.number for s in joints.send(1, (2, 3))] == [1]
    assert [s.number for s in joints.send(2, (2, 3))] == [2]
    assert joints.assembler.lost == 0


def test_a_frame_that_comes_twice_counts_once(joints):
    joints.send(0)
    assert joints.send(0) == []
    assert joints.send(1, (0, 0, 1, 2)) == []
    assert len(joints.send(1, (3,))) == 1
    assert joints.assembler.duplicates == 5
    assert joints.assembler.lost == 0


def test_counters_that_wrap_are_followed_and_long_silences_counted_in_full(joints):
    for count in range(65530, 65540):
        joints.send(count)
    assert joints.assembler.lost == 0
    (sample,) = joints.send(65540 + 200_000)
    assert sample.number == 10 + 200_000
    assert joints.assembler.lost == 200_000
    assert joints.assembler.counter_jumps == 0


def test_a_counter_that_jumps_ahead_is_a_loss_and_is_told(joints):
    joints.send(0)
    joints.send(1)
    (sample,) = joints.send(102, at=2 * PERIOD)
    assert sample.number == 102
    assert joints.assembler.lost == 100
    assert joints.assembler.counter_jumps == 4


def test_a_counter_that_goes_back_is_told_and_samples_go_on(joints):
    for count in range(500, 510):
        joints.send(count)
    indices = [s.number for k in range(10, 20) for s in joints.send(500 + k, raw=k - 10)]
    assert indices == list(range(11, 21))
    assert joints.assembler.counter_jumps == 1
    assert joints.assembler.lost == 1


def test_after_a_restart_of_the_device_the_gap_is_as_long_as_it_lasted(joints):
    for count in range(100):
        joints.send(count)
    joints.assembler.restart()
    (sample,) = joints.send(100 + 400, raw=3)
    assert sample.number == 99 + 401
    assert joints.assembler.lost == 400


def test_single_frames_need_no_waiting():
    bus = BusDescription.load()
    assembler = Assembler(bus.groups['electrical'])
    indices = []
    for count in [65534, 65535, 65536, 65540]:
        (message,) = bus.encode('electrical', count, 1000 * count, np.full(12, 48.0), np.zeros(12))
        time = count * 1_000_000
        indices.append(assembler.add(0, count % 65536, time, time, message.data).number)
    assert indices == [0, 1, 2, 6]
    assert assembler.lost == 3
