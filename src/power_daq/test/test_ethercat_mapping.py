import math
import struct

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from power_daq.ethercat.acquisition import assert_settings, check_inputs, check_order
from power_daq.ethercat.mapping import ChannelMapping, SegmentMapping
from power_daq.ethercat.terminals import TYPES, SegmentError, SlaveIdentity
from wattwalk_core.errors import InputError

from drive_power_msgs.msg import DriveSupply

EK1100, EL3102 = TYPES['EK1100'], TYPES['EL3102']
COUPLER, INPUTS = SlaveIdentity(2, 0x044C2C52), SlaveIdentity(2, 0x0C1E3052)
UNKNOWN = SlaveIdentity(2, 0x03F03052, 0, 'EL1008')

CONTENT = {
    'device': 'terminals',
    'segment': ['EK1100', 'EL3102', 'EL3102'],
    'electrical': {
        'drives': [
            {
                'drive': 'LF_HFE',
                'voltage': {'terminal': 1, 'channel': 1, 'ratio': 10.0},
                'current': {'terminal': 1, 'channel': 2, 'ratio': 5.0, 'offset': -0.02},
            },
            {
                'drive': 'LF_KFE',
                'voltage': {'terminal': 1, 'channel': 1, 'ratio': 10.0},
                'current': {'terminal': 2, 'channel': 1, 'ratio': 5.0},
            },
        ]
    },
}


def channel(status, count, number=1):
    inputs = bytes(4 * (number - 1)) + struct.pack('<Hh', status, count)
    return EL3102.channel(inputs.ljust(8, b'\0'), number)


@pytest.mark.parametrize('number', [1, 2])
def test_the_whole_range_is_ten_volts_either_way(number):
    assert channel(0, 0x7FFF, number).volts == pytest.approx(10.0)
    assert channel(0, -0x7FFF, number).volts == pytest.approx(-10.0)
    assert channel(0, 0, number).volts == 0.0
    assert channel(0, 1, number).volts == pytest.approx(305.185e-6, rel=1e-4)


@pytest.mark.parametrize(
    ('status', 'flags'),
    [
        (0x0000, DriveSupply.OK),
        (0x0001, DriveSupply.UNDERRANGE),
        (0x0002, DriveSupply.OVERRANGE),
        (0x0042, DriveSupply.OVERRANGE | DriveSupply.DEVICE_ERROR),
        (0x0040, DriveSupply.DEVICE_ERROR),
        (0x4000, DriveSupply.DEVICE_ERROR),
        (0x4040, DriveSupply.DEVICE_ERROR),
        (0x803C, DriveSupply.OK),
    ],
)
def test_bits_of_the_status_word_become_flags(status, flags):
    found = channel(status, 0)
    assert found.flags == flags
    assert found.toggle == bool(status & 0x8000)
    assert found.valid == (not status & 0x4000)


@settings(deadline=None)
@given(st.binary(min_size=8, max_size=8), st.sampled_from([1, 2]))
def test_whatever_comes_is_a_voltage_in_range_with_known_flags(inputs, number):
    found = EL3102.channel(inputs, number)
    assert abs(found.volts) <= 10.001
    assert math.isfinite(found.volts)
    assert found.flags & ~0x07 == 0


def load(tmp_path, content=CONTENT):
    path = tmp_path / 'ethercat.yaml'
    path.write_text(yaml.safe_dump(content))
    return SegmentMapping.load(path)


def test_a_mapping_says_what_each_channel_measures(tmp_path):
    mapping = load(tmp_path)
    assert mapping.names == ('LF_HFE', 'LF_KFE')
    assert mapping.segment == (EK1100, EL3102, EL3102)
    assert (mapping.device, mapping.cycle, mapping.frame_timeout) == ('terminals', 1e-3, 2e-3)
    assert list(mapping.channels()) == [
        ChannelMapping(1, 1, 10.0),
        ChannelMapping(1, 1, 10.0),
        ChannelMapping(1, 2, 5.0, -0.02),
        ChannelMapping(2, 1, 5.0),
    ]


def changed(*path, value):
    content = yaml.safe_load(yaml.safe_dump(CONTENT))
    place = content
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return content


DRIVE = ('electrical', 'drives', 0)


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (changed('segment', 1, value='EL9999'), "segment[1]: unknown terminal 'EL9999'; there"),
        (changed('segment', value=[]), 'segment: expected at least 1 values, there are 0'),
        (changed('cycle', value=5), 'cycle: expected 0.00025 to 0.1 s, there is 5'),
        (changed('frame_timeout', value='x'), "expected 0.0001 to 1 s, there is 'x'"),
        (changed('speed', value=5), "unknown key 'speed'"),
        (
            changed(*DRIVE, 'voltage', 'terminal', value=3),
            'number from 0 to 2, there is 3',
        ),
        (changed(*DRIVE, 'voltage', 'terminal', value=0), 'EK1100 at 0 measures nothing'),
        (changed(*DRIVE, 'voltage', 'channel', value=3), 'number from 1 to 2, there is 3'),
        (changed(*DRIVE, 'current', 'ratio', value=0), 'a number other than 0, there is 0'),
        (changed(*DRIVE, 'current', 'ratio', value=2e4), '-10000 to 10000 per V, there is 20000'),
        (changed(*DRIVE, 'current', 'offset', value=True), 'there is True'),
        (changed(*DRIVE, 'current', value=None), "'current' is missing"),
        (changed(*DRIVE, 'drive', value='LF_KFE'), "drive 'LF_KFE' is there twice"),
        (
            changed(*DRIVE, 'current', 'channel', value=1),
            'channel 1 of terminal 1 is already the voltage of LF_HFE',
        ),
        (
            changed(*DRIVE, 'voltage', value={'terminal': 2, 'channel': 1, 'ratio': 1}),
            'channel 1 of terminal 2 is already the voltage of LF_HFE',
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place_and_value(tmp_path, content, words):
    with pytest.raises(InputError) as caught:
        load(tmp_path, content)
    assert words in str(caught.value)
    assert 'ethercat.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('found', 'words'),
    [
        ([], 'EK1100 (vendor 0x2, product 0x044c2c52) should be at position 0, but the segment'),
        ([COUPLER], 'should be at position 1, but the segment ends after 1 of 2 slaves'),
        (
            [COUPLER, UNKNOWN],
            'EL3102 (vendor 0x2, product 0x0c1e3052) should be at position 1, there is EL1008 '
            '(vendor 0x2, product 0x03f03052)',
        ),
        ([INPUTS, COUPLER], 'should be at position 0, there is EL3102'),
        ([COUPLER, INPUTS, UNKNOWN], 'EL1008 (vendor 0x2, product 0x03f03052) at position 2 is'),
    ],
)
def test_missing_and_unexpected_slaves_are_told_in_a_line(found, words):
    with pytest.raises(SegmentError) as caught:
        check_order((EK1100, EL3102), found)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_the_segment_of_the_mapping_is_accepted():
    check_order((EK1100, EL3102), [COUPLER, INPUTS])


class Objects:
    """The mailboxes of a segment."""

    def __init__(self, stuck=False, size=8):
        self.values = {(0x8000 + 0x10 * n, s): 0 for n in range(2) for s in (1, 2, 6, 10)}
        self.stuck, self.size = stuck, size
        self.written = []

    def read(self, slave, index, subindex):
        assert slave == 1
        return bytes([self.values[index, subindex]])

    def write(self, slave, index, subindex, value):
        self.written.append((slave, index, subindex))
        if not self.stuck:
            self.values[index, subindex] = value[0]

    def inputs(self, slave):
        return bytes(self.size if slave else 0)


def test_a_filter_that_is_on_is_switched_off_and_read_back():
    objects = Objects()
    objects.values[0x8000, 6] = objects.values[0x8010, 6] = 1
    said = assert_settings(objects, (EK1100, EL3102))
    assert objects.written == [(1, 0x8000, 6), (1, 0x8010, 6)]
    assert said == [
        'filter of EL3102 at 1 (0x8000) switched off',
        'filter of EL3102 at 1 (0x8010) switched off',
    ]
    assert assert_settings(objects, (EK1100, EL3102)) == []


def test_a_filter_that_stays_on_is_refused():
    objects = Objects(stuck=True)
    objects.values[0x8010, 6] = 1
    with pytest.raises(SegmentError, match='filter of EL3102 at position 1 cannot be switched'):
        assert_settings(objects, (EK1100, EL3102))


def test_process_data_without_status_are_refused():
    check_inputs(Objects(), (EK1100, EL3102))
    with pytest.raises(SegmentError, match='has 4 bytes of inputs, not 8'):
        check_inputs(Objects(size=4), (EK1100, EL3102))
