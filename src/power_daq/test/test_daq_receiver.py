import can
import numpy as np
import pytest
from power_daq.acquisition.receiver import Receiver
from power_daq.bus.description import BusDescription
from power_daq.clock.mapping import RosTime
from power_recordings.calibration import Calibration
from wattwalk_core.errors import InputError

US = 1000
SYSTEM_MINUS_STEADY = 1_700_000_000_000_000_000


class Rig:
    """The shipped bus with a device that started 5 s before the steady clock."""

    def __init__(self, **kwargs):
        self.bus = BusDescription.load()
        self.steady = 0
        self.step = 0
        ros = RosTime(lambda: self.steady + SYSTEM_MINUS_STEADY + self.step, lambda: self.steady)
        self.receiver = Receiver(self.bus, ros, **kwargs)
        self.restarted_at = -5_000_000
        self.counter_offset = 0

    def device(self, us):
        return us - self.restarted_at

    def electrical(self, millisecond, current=1.0, length=64):
        us = 1000 * millisecond
        (message,) = self.bus.encode(
            'electrical',
            millisecond - self.counter_offset,
            self.device(us),
            np.full(12, 48.0),
            np.full(12, current),
        )
        message.data = message.data[:length]
        message.dlc = length
        return self.take(message, us + 100)

    def joints(self, index, slots=(0, 1, 2, 3)):
        us = 2500 * index
        messages = self.bus.encode(
            'joints', index - self.counter_offset, self.device(us), *np.ones((3, 12))
        )
        return [s for slot in slots for s in self.take(messages[slot], us + 100)]

    def take(self, message, us):
        self.steady = us * US
        return self.receiver.take(message, self.steady)

    def settle(self, begin=0):
        for millisecond in range(begin, begin + 500):
            self.electrical(millisecond)
        return begin + 500


def test_samples_carry_the_time_at_which_they_were_measured():
    rig = Rig()
    now = rig.settle()
    (sample,) = rig.electrical(now)
    assert sample.group == 'electrical'
    assert sample.sequence == now
    assert sample.device_time == rig.device(1000 * now) * US
    assert sample.stamp == pytest.approx(
        SYSTEM_MINUS_STEADY + (1000 * now + 100) * US, abs=1000, rel=0
    )
    np.testing.assert_allclose(sample.values[:2], [[48.0] * 12, [1.0] * 12])


def test_a_known_transport_delay_is_taken_off_the_stamps():
    rig = Rig(transport_delay=100 * US)
    now = rig.settle()
    (sample,) = rig.electrical(now)
    assert sample.stamp - SYSTEM_MINUS_STEADY == pytest.approx(1000 * now * US, abs=1000)


def test_nothing_is_given_out_before_the_clock_has_settled():
    rig = Rig()
    assert [rig.electrical(k) for k in range(200)] == [[]] * 200
    assert rig.receiver.counts.unsettled == 200
    assert rig.receiver.losses['electrical'] == 0


def test_frames_of_other_kinds_are_counted_by_kind():
    rig = Rig()
    now = rig.settle()
    before = rig.receiver.counts.frames
    for identifier in [0x7FF, 0x7FF, 0x300]:
        assert rig.take(can.Message(arbitration_id=identifier, is_extended_id=False), 1) == []
    rig.take(can.Message(arbitration_id=256, is_extended_id=True, data=bytes(64), is_fd=True), 1)
    rig.take(can.Message(is_error_frame=True, dlc=8, data=bytes(8)), 1)
    rig.take(can.Message(arbitration_id=256, is_extended_id=False, is_remote_frame=True), 1)
    counts = rig.receiver.counts
    assert (counts.unknown, counts.error_frames, counts.remote_frames) == (4, 1, 1)
    assert counts.frames == before + 6
    assert rig.receiver.unknown_ids[0x7FF] == 2
    assert len(rig.electrical(now)) == 1


def test_a_flood_of_foreign_identifiers_takes_no_memory():
    rig = Rig()
    for identifier in range(2000):
        rig.take(can.Message(arbitration_id=identifier | 1 << 20, is_extended_id=True), 1)
    assert rig.receiver.counts.unknown == 2000
    assert len(rig.receiver.unknown_ids) == 16


def test_a_frame_of_the_wrong_length_is_dropped_and_named():
    rig = Rig()
    now = rig.settle()
    assert rig.electrical(now, length=48) == []
    (sample,) = rig.electrical(now + 1)
    assert sample.sequence == now + 1
    assert rig.receiver.losses['electrical'] == 1
    assert rig.receiver.counts.wrong_length == 1
    assert dict(rig.receiver.wrong_lengths) == {'DRIVE_SUPPLY: 48 bytes, not 64': 1}


def test_a_gap_in_the_counter_is_a_gap_in_the_sequence():
    rig = Rig()
    now = rig.settle()
    sequences = [s.sequence for k in [0, 1, 5, 6] for s in rig.electrical(now + k)]
    assert sequences == [now, now + 1, now + 5, now + 6]
    assert rig.receiver.losses == {'electrical': 3, 'joints': 0, 'temperature': 0}


def test_joint_samples_with_a_missing_leg_are_skipped():
    rig = Rig()
    rig.settle()
    first = rig.joints(200)
    assert [s.sequence for s in first] == [0]
    assert rig.joints(201, (0, 1, 3)) == []
    assert [s.sequence for s in rig.joints(202)] == [2]
    assert rig.receiver.losses['joints'] == 1


def test_a_device_that_starts_again_is_stamped_anew_once_its_clock_has_settled():
    rig = Rig()
    now = rig.settle()
    (before,) = rig.electrical(now)
    rig.restarted_at, rig.counter_offset = 1000 * (now + 1000), now + 1000
    samples = [s for k in range(now + 1000, now + 1600) for s in rig.electrical(k)]
    assert rig.receiver.clocks['device'].epoch == 1
    assert samples[0].sequence > before.sequence + 1000
    assert samples[0].device_time < 400_000_000
    for sample in samples:
        truth = sample.device_time + (now + 1000) * 1_000_000 + 100 * US
        assert sample.stamp - SYSTEM_MINUS_STEADY == pytest.approx(truth, abs=1000)


def test_a_step_of_the_system_clock_moves_stamps_and_nothing_else():
    rig = Rig()
    now = rig.settle()
    (before,) = rig.electrical(now)
    rig.step = -3_000_000_000
    samples = [s for k in range(now + 1, now + 300) for s in rig.electrical(k)]
    assert len(samples) == 299
    assert rig.receiver.ros_time.steps == 1
    assert samples[-1].stamp - before.stamp == pytest.approx(
        299 * 1_000_000 - 3_000_000_000, abs=1000
    )
    assert samples[-1].sequence - before.sequence == 299


def test_stamps_within_an_epoch_only_go_forward():
    rig = Rig()
    rng = np.random.default_rng(3)
    stamps = []
    for millisecond in range(3000):
        us = 1000 * millisecond
        (message,) = rig.bus.encode(
            'electrical', millisecond, rig.device(us), np.full(12, 48.0), np.zeros(12)
        )
        late = rng.exponential(500.0) + (20_000 if 1000 < millisecond < 1020 else 0)
        stamps += [s.stamp for s in rig.take(message, us + int(late))]
    assert len(stamps) > 2500
    assert (np.diff(stamps) > 0).all()


def test_calibration_corrects_each_channel(tmp_path):
    path = tmp_path / 'calibration.yaml'
    path.write_text(
        'channels: {LF_HFE.current: {gain: 2.0, offset: 0.5}, RH_KFE.voltage: {offset: -1}}'
    )
    bus = BusDescription.load()
    rig = Rig(calibration=Calibration.load(path, bus.groups['electrical'].drives))
    now = rig.settle()
    (sample,) = rig.electrical(now, current=3.0)
    voltage, current, _ = sample.values
    assert current.tolist() == pytest.approx([3.0, 6.5] + [3.0] * 10)
    assert voltage.tolist() == pytest.approx([48.0] * 11 + [47.0])


ARM_DBC = """VERSION ""
BU_: Host
BO_ 10 SHOULDER: 8 Host
 SG_ t : 7|16@0+ (0.1,0) [0|0] "ms" Host
 SG_ n : 16|8@1+ (1,0) [0|0] "" Host
 SG_ which M : 24|8@1+ (1,0) [0|0] "" Host
 SG_ pitch_I m1 : 32|16@1- (0.01,0) [0|0] "A" Host
 SG_ roll_I m2 : 32|16@1- (0.01,0) [0|0] "A" Host
BO_ 11 ELBOW: 8 Host
 SG_ t : 7|16@0+ (0.1,0) [0|0] "ms" Host
 SG_ n : 16|8@1+ (1,0) [0|0] "" Host
 SG_ volts : 24|12@1+ (0.02,0) [0|0] "V" Host
 SG_ elbow_I : 36|12@1- (0.01,0) [0|0] "A" Host
"""
ARM_MAPPING = """
electrical:
  rate: 500
  frames:
    - {message: SHOULDER, time: t, counter: n, drives: [{drive: pitch, current: pitch_I}]}
    - {message: SHOULDER, time: t, counter: n, drives: [{drive: roll, current: roll_I}]}
    - message: ELBOW
      time: t
      counter: n
      drives:
        - {drive: elbow, voltage: volts, current: elbow_I}
        - {drive: pitch, voltage: volts}
        - {drive: roll, voltage: volts}
"""


def test_three_drives_over_multiplexed_frames_with_small_counters_are_measured(tmp_path):
    (tmp_path / 'arm.dbc').write_text(ARM_DBC)
    (tmp_path / 'arm.yaml').write_text(ARM_MAPPING)
    bus = BusDescription.load(tmp_path / 'arm.dbc', tmp_path / 'arm.yaml')
    receiver = Receiver(bus, RosTime(lambda: 0, lambda: 0))
    samples = []
    for count in range(10_000):
        us = 2000 * count
        frames = bus.encode('electrical', count, us, [24.0] * 3, [0.01 * (count % 100), 1.0, -2.0])
        if count in (5000, 5001):
            del frames[1]
        for message in frames:
            samples += receiver.take(message, (us + 80) * US)
    assert bus.drives == ('pitch', 'roll', 'elbow')
    assert receiver.clocks['device'].epoch == 0
    assert receiver.losses == {'electrical': 2}
    assert receiver.assemblers['electrical'].missing == [0, 2, 0]
    sequences = [s.sequence for s in samples]
    assert sequences == [k for k in range(sequences[0], 10_000) if k not in (5000, 5001)]
    for sample in samples[::97]:
        assert sample.stamp == pytest.approx((2000 * sample.sequence + 80) * US, abs=2000)
        pitch = 0.01 * (sample.sequence % 100)
        np.testing.assert_allclose(sample.values[1], [pitch, 1.0, -2.0], atol=1e-9)
        np.testing.assert_allclose(sample.values[0], 24.0)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('channels: {LF.current: {gain: 1}}', ["'LF.current'", 'LF_HAA.voltage']),
        ('channels: {LF_HAA.current: {gain: big}}', ["'big'", '0.1 to 10']),
        ('channels: {LF_HAA.current: {gain: .nan}}', ['nan', '0.1 to 10']),
        (
            'channels: {LF_HAA.current: 3}',
            ['LF_HAA.current', 'expected keys with values, there is 3'],
        ),
        ('gain: 3', ["'channels'"]),
        ('[', ['no valid YAML']),
    ],
)
def test_a_wrong_calibration_is_refused(tmp_path, text, words):
    path = tmp_path / 'calibration.yaml'
    path.write_text(text)
    with pytest.raises(InputError) as error:
        Calibration.load(path, ['LF_HAA'])
    for word in [str(path), *words]:
        assert word in str(error.value)
    with pytest.raises(InputError, match='cannot read'):
        Calibration.load(tmp_path / 'gone.yaml', ['LF_HAA'])
