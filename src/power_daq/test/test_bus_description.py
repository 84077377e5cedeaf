import copy
import random

import cantools
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from power_daq.bus.description import (
    DEFAULT_DBC,
    DEFAULT_MAPPING,
    DEVICE_ERROR,
    OVERRANGE,
    UNDERRANGE,
    BusDescription,
)
from wattwalk_core.errors import InputError

LEG = """VERSION ""
BU_: Host
BO_ 2566834688 DRIVES_A: 8 Host
 SG_ t : 0|16@1+ (0.1,0) [0|0] "ms" Host
 SG_ n : 16|8@1+ (1,0) [0|0] "" Host
 SG_ mux M : 24|8@1+ (1,0) [0|0] "" Host
 SG_ hip_mA m0 : 39|16@0- (2,0) [0|0] "mA" Host
 SG_ knee_mA m1 : 39|16@0- (2,0) [0|0] "mA" Host
BO_ 33 DRIVES_B: 8 Host
 SG_ t : 0|16@1+ (0.1,0) [0|0] "ms" Host
 SG_ n : 16|8@1+ (1,0) [0|0] "" Host
 SG_ bus_V : 24|12@1+ (0.02,0) [0|0] "V" Host
 SG_ ankle_A : 36|12@1- (0.01,0) [0|0] "A" Host
BO_ 34 OTHER: 8 Host
 SG_ x : 0|8@1- (1,0) [0|0] "furlong" Host
"""
HEAD = {'time': 't', 'counter': 'n'}


def leg_mapping():
    return {
        'electrical': {
            'rate': 500,
            'frames': [
                {'message': 'DRIVES_A', **HEAD, 'drives': [{'drive': 'hip', 'current': 'hip_mA'}]},
                {
                    'message': 'DRIVES_A',
                    **HEAD,
                    'drives': [{'drive': 'knee', 'current': 'knee_mA'}],
                },
                {
                    'message': 'DRIVES_B',
                    **HEAD,
                    'drives': [
                        {'drive': 'ankle', 'voltage': 'bus_V', 'current': 'ankle_A'},
                        {'drive': 'hip', 'voltage': 'bus_V'},
                        {'drive': 'knee', 'voltage': 'bus_V'},
                    ],
                },
            ],
        }
    }


def load_leg(folder, mapping, dbc=LEG):
    (folder / 'leg.dbc').write_text(dbc)
    text = mapping if isinstance(mapping, str) else yaml.safe_dump(mapping)
    (folder / 'leg.yaml').write_text(text)
    return BusDescription.load(folder / 'leg.dbc', folder / 'leg.yaml')


def test_the_shipped_bus_carries_twelve_drives_in_joint_order():
    bus = BusDescription.load()
    assert bus.drives[:4] == ('LF_HAA', 'LF_HFE', 'LF_KFE', 'RF_HAA')
    assert bus.drives[-1] == 'RH_KFE'
    assert len(bus.drives) == 12
    assert [m.arbitration_id for m in bus.encode('joints', 0, 0, *np.zeros((3, 12)))] == [
        272,
        273,
        274,
        275,
    ]
    assert len(bus.encode('electrical', 0, 0, np.zeros(12), np.zeros(12))[0].data) == 64


def test_each_drive_s_values_lie_in_the_signals_of_its_name():
    bus = BusDescription.load()
    database = cantools.database.load_file(DEFAULT_DBC)
    index = np.arange(12)
    (message,) = bus.encode('electrical', 65537, 2**32 + 7, 40 + index, -3.0 + index, index)
    signals = database.decode_message(message.arbitration_id, message.data)
    assert (signals['DeviceTime'], signals['Counter']) == (7, 1)
    for column, drive in enumerate(bus.drives):
        assert signals[f'{drive}_Voltage'] == pytest.approx(40 + column)
        assert signals[f'{drive}_Current'] == pytest.approx(-3 + column)
        assert signals[f'{drive}_Status'] == column
    for message in bus.encode('joints', 3, 4, 0.1 * index, -0.5 * index, 5.0 * index):
        signals = database.decode_message(message.arbitration_id, message.data)
        for name, value in signals.items():
            drive, _, quantity = name.rpartition('_')
            factor = {'Position': 0.1, 'Velocity': -0.5, 'Torque': 5.0}.get(quantity)
            if factor is not None:
                assert value == pytest.approx(factor * bus.drives.index(drive))
    (message,) = bus.encode('temperature', 0, 0, 20.0 + index)
    assert database.decode_message(512, message.data)['RF_HAA_Temperature'] == pytest.approx(23.0)
    (message,) = bus.encode_sync(9, 8)
    assert database.decode_message(128, message.data) == {'DeviceTime': 8, 'Counter': 9}


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_shipped_frame_decodes_as_cantools_decodes_it(data):
    bus = BusDescription.load()
    database = cantools.database.load_file(DEFAULT_DBC)
    for name, group in bus.groups.items():
        payloads = [data.draw(st.binary(min_size=f.size, max_size=f.size)) for f in group.frames]
        expected = {}
        for frame, payload in zip(group.frames, payloads, strict=True):
            expected |= database.decode_message(frame.message.frame_id, payload)
        values = group.decode(payloads)
        for row, quantity in enumerate(group.quantities):
            for column, drive in enumerate(group.drives):
                signal = f'{drive}_{quantity.capitalize()}'
                assert values[row, column] == pytest.approx(expected[signal], rel=1e-12), name


def test_quantising_gives_what_survives_encoding_and_decoding():
    bus = BusDescription.load()
    rng = np.random.default_rng(0)
    voltage, current = rng.uniform(-5, 90, (20, 12)), rng.uniform(-60, 60, (20, 12))
    joints = rng.uniform(-200, 200, (3, 20, 12))
    v, i = bus.quantise('electrical', voltage, current)
    q = np.stack(bus.quantise('joints', *joints))
    (t,) = bus.quantise('temperature', voltage)
    for k in range(20):
        sent = bus.encode('electrical', k, k, voltage[k], current[k])
        np.testing.assert_array_equal(
            bus.groups['electrical'].decode([m.data for m in sent])[:2], [v[k], i[k]]
        )
        sent = bus.encode('joints', k, k, *joints[:, k])
        np.testing.assert_array_equal(bus.groups['joints'].decode([m.data for m in sent]), q[:, k])
        sent = bus.encode('temperature', k, k, voltage[k])
        np.testing.assert_array_equal(bus.groups['temperature'].decode([sent[0].data])[0], t[k])
    inside = (np.abs(current) < 40) & (voltage > 0) & (voltage < 81)
    assert np.abs((v - voltage)[inside]).max() <= 0.00125 / 2 + 1e-9
    assert np.abs((i - current)[inside]).max() <= 0.00125 / 2 + 1e-9


def test_what_the_wire_cannot_carry_is_clipped_and_flagged():
    bus = BusDescription.load()
    voltage, current = np.full(12, 48.0), np.zeros(12)
    current[1], current[2], voltage[3], voltage[4] = 100.0, -100.0, np.nan, 90.0
    status = np.zeros(12, np.uint8)
    status[5] = 8
    (message,) = bus.encode('electrical', 0, 0, voltage, current, status)
    values = bus.groups['electrical'].decode([bytes(message.data)])
    assert values[2].tolist() == [0, OVERRANGE, UNDERRANGE, DEVICE_ERROR, OVERRANGE, 8] + [0] * 6
    assert values[1, 1:3] == pytest.approx([40.95875, -40.96])
    assert values[0, 3] == 0


def test_another_robot_s_three_drives_over_three_frames_of_its_own_dbc(tmp_path):
    bus = load_leg(tmp_path, leg_mapping())
    assert bus.drives == ('hip', 'knee', 'ankle')
    sent = bus.encode('electrical', 258, 1_000_000, [48.0, 48.0, 48.0], [1.0, -2.0, 3.0])
    assert [(m.arbitration_id, m.is_extended_id, m.is_fd) for m in sent] == [
        (0x18FECA00, True, False),
        (0x18FECA00, True, False),
        (33, False, False),
    ]
    values = bus.groups['electrical'].decode([bytes(m.data) for m in sent])
    np.testing.assert_allclose(values[:2], [[48, 48, 48], [1, -2, 3]])
    first, second = bus.routes[0x18FECA00 | 1 << 31]
    time, counter = first.time_and_counter
    assert time.read(sent[0].data) == 10_000
    assert counter.read(sent[0].data) == 2
    assert [first.selected[0].read(m.data) for m in sent[:2]] == [0, 1]
    assert (first.selected[1], second.selected[1]) == (0, 1)
    assert bus.clocks == {'device': (100_000.0, 16)}
    with pytest.raises(ValueError, match='no joints frames'):
        bus.encode('joints', 0, 0, [0] * 3, [0] * 3, [0] * 3)


def test_bytes_from_one_bus_never_name_a_drive_of_the_other(tmp_path):
    bus = load_leg(tmp_path, leg_mapping())
    v, _ = bus.quantise('electrical', np.full((5, 3), 47.999), np.zeros((5, 3)))
    assert v == pytest.approx(np.full((5, 3), 48.0))


def frames(mapping):
    return mapping['electrical']['frames']


def break_message(m):
    frames(m)[2]['message'] = 'DRIVES_C'


def break_signal(m):
    frames(m)[2]['drives'][0]['current'] = 'ankle_B'


def break_counter(m):
    frames(m)[0]['counter'] = 'm'


def break_twice(m):
    frames(m)[2]['drives'].append({'drive': 'ankle', 'voltage': 'bus_V'})


def break_twice_over_frames(m):
    frames(m)[2]['drives'][1]['current'] = 'ankle_A'


def break_missing_field(m):
    del frames(m)[0]['time']


def break_missing_quantity(m):
    del frames(m)[2]['drives'][1]


def break_unknown_key(m):
    m['electrcal'] = m.pop('electrical')


def break_shared(m):
    frames(m)[0]['drives'].append({'drive': 'toe', 'current': 'hip_mA'})
    frames(m)[2]['drives'].append({'drive': 'toe', 'voltage': 'bus_V'})


def break_same_frame(m):
    frames(m).append({'message': 'DRIVES_B', **HEAD, 'drives': [{'drive': 'hip', 'status': 'n'}]})


def break_mux(m):
    frames(m)[0]['drives'].append({'drive': 'toe', 'current': 'knee_mA'})
    frames(m)[2]['drives'].append({'drive': 'toe', 'voltage': 'bus_V'})


def break_unit(m):
    m['temperature'] = {
        'rate': 1,
        'frames': [{'message': 'OTHER', 'time': 'x', 'counter': 'x', 'drives': []}],
    }


def break_rate(m):
    m['electrical']['rate'] = -3


def break_clock(m):
    frames(m)[0]['counter'] = 'hip_mA'


def break_empty(m):
    m.clear()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (break_message, ['frames[2]', "'DRIVES_C'", 'DRIVES_A, DRIVES_B, OTHER']),
        (break_signal, ['frames[2]', "'ankle_B'", "'DRIVES_B'", 't, n, bus_V, ankle_A']),
        (break_counter, ['frames[0]', "'m'", 'hip_mA']),
        (break_twice, ['frames[2]', 'drives[3]', "'ankle'", 'twice']),
        (break_twice_over_frames, ['frames[2]', 'current', "'hip'", 'twice']),
        (break_missing_field, ['frames[0]', "'time' is missing", "there is 'counter'"]),
        (break_missing_quantity, ['electrical', "'hip' has no 'voltage'", 'current']),
        (break_unknown_key, ["'electrcal'", 'electrical, joints, temperature']),
        (break_shared, ["'hip_mA'", "current of 'hip'", "current of 'toe'"]),
        (break_same_frame, ['frames[3]', "'DRIVES_B' is there twice"]),
        (break_mux, ['frames[0]', 'multiplexed']),
        (break_unit, ['temperature', 'drives', 'expected at least 1 values']),
        (break_rate, ['rate', '-3', '0.1 to 10000 Hz']),
        (break_clock, ["'hip_mA'", 'unsigned integer']),
        (break_empty, ['maps nothing']),
    ],
)
def test_a_wrong_mapping_is_refused_with_file_entry_and_what_is_there(tmp_path, change, words):
    mapping = leg_mapping()
    change(mapping)
    with pytest.raises(InputError) as error:
        load_leg(tmp_path, mapping)
    assert str(error.value).count('\n') == 0
    for word in [str(tmp_path / 'leg.yaml'), *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('electrical: [', 'no valid YAML'),
        ('device: a\ndevice: b\n', "'device' is there twice"),
        ('- 1\n', 'expected keys'),
        ('', 'expected keys'),
        ('electrical: 3\n', 'expected keys'),
        ('device: [x]\nelectrical: {rate: 1}\n', r"expected text, there is \['x'\]"),
        ('electrical: {rate: 1, frames: [1]}\n', 'expected keys'),
    ],
)
def test_a_mapping_that_is_no_mapping_is_refused(tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        load_leg(tmp_path, text)


@pytest.mark.parametrize(
    ('dbc', 'words'),
    [
        ('this is no DBC', 'does not parse'),
        ('VERSION ""', 'holds no CAN messages'),
        (LEG.replace('36|12@1-', '30|12@1-'), 'does not parse'),
        (LEG.replace('39|16@0- (2,0)', '39|16@0- (2,0'), 'does not parse'),
        (LEG.replace('"V"', '"furlong"'), "signal 'bus_V': unit 'furlong' is none of voltage"),
        (LEG.replace('"ms"', '"parsec"'), "time signal 't' has unit 'parsec'"),
        (LEG.replace('SG_ n : 16|8', 'SG_ n : 16|7', 1), 'has 8 bits, those before it have 7'),
        (LEG.replace('(0.1,0)', '(0.2,0)', 1), 'another resolution'),
    ],
)
def test_a_wrong_dbc_is_refused(tmp_path, dbc, words):
    with pytest.raises(InputError) as error:
        load_leg(tmp_path, leg_mapping(), dbc)
    assert words in str(error.value)


def test_files_that_are_not_there_are_named(tmp_path):
    with pytest.raises(InputError, match=r'gone\.dbc'):
        BusDescription.load(tmp_path / 'gone.dbc')
    with pytest.raises(InputError, match=r'gone\.yaml'):
        BusDescription.load(None, tmp_path / 'gone.yaml')
    (tmp_path / 'binary.dbc').write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match=r'binary\.dbc'):
        BusDescription.load(tmp_path / 'binary.dbc')
    with pytest.raises(InputError, match=r'binary\.dbc'):
        BusDescription.load(None, tmp_path / 'binary.dbc')


def test_the_shipped_mapping_is_what_a_user_would_start_from():
    assert set(yaml.safe_load(DEFAULT_MAPPING.read_text())) == {
        'device',
        'sync',
        'electrical',
        'joints',
        'temperature',
    }


STRANGE = [
    *(None, 5, -1, 1e300, 2**70, True, '', 'x' * 5000, '*', '\x1b[31m', [], {}, [1], {'a': 'b'}),
    *({'from': 1}, {'from': 'Torque_Estimate', 'scale': 0}, {'from': 'Vel_Estimate'}),
    *({'from': 'Torque_Estimate', 'at': 'moon'}, {'from': 'Torque', 'unit': 'furlong'}),
]


def places(content, before=()):
    yield before
    if isinstance(content, dict | list):
        for key in content if isinstance(content, dict) else range(len(content)):
            yield from places(content[key], (*before, key))


def refusal(name, mapping):
    """Line of the InputError for a mapping, '' where it works."""
    try:
        BusDescription.ready(name, mapping)
    except InputError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('name', ['odrive', 'moteus'])
def test_a_ready_mapping_with_strange_entries_works_or_is_refused_in_one_line(tmp_path, name):
    whole = yaml.safe_load(DEFAULT_MAPPING.with_name(f'{name}.yaml').read_text())
    rng, refused = random.Random(1), 0
    for _ in range(200):
        mapping = copy.deepcopy(whole)
        *before, last = rng.choice([place for place in places(mapping) if place])
        entry = mapping
        for key in before:
            entry = entry[key]
        if rng.random() < 0.2 and isinstance(entry, dict):
            del entry[last]
        else:
            entry[last] = rng.choice(STRANGE)
        (tmp_path / 'leg.yaml').write_text(yaml.safe_dump(mapping))
        said = refusal(name, tmp_path / 'leg.yaml')
        refused += bool(said)
        assert said.isprintable()
        assert len(said) < 700
    assert refused > 100
