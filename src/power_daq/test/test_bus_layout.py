import numpy as np
import pytest
from cantools.database.can.message import Message
from cantools.database.can.signal import Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st
from power_daq.bus.signal_layout import Field, LayoutError, SignalLayout, bit_positions


def signal(name, start, length, order='little_endian', signed=False, scale=1, is_float=False):
    conversion = BaseConversion.factory(scale=scale, offset=0, is_float=is_float)
    return Signal(name, start, length, order, signed, conversion=conversion)


@st.composite
def messages(draw):
    """Frames of random signals, wherever they fit without overlap."""
    size = draw(st.sampled_from([1, 8, 12, 64]))
    taken, signals = set(), []
    for index in range(draw(st.integers(1, 12))):
        order = draw(st.sampled_from(['little_endian', 'big_endian']))
        is_float = draw(st.sampled_from([False, False, False, True]))
        length = draw(st.sampled_from([32, 64]) if is_float else st.integers(1, 53))
        byte, bit = draw(st.integers(0, size - 1)), draw(st.integers(0, 7))
        if is_float:
            bit = 7 if order == 'big_endian' else 0
        one = signal(
            f'S{index}',
            8 * byte + bit,
            length,
            order,
            draw(st.booleans()) and not is_float,
            draw(st.sampled_from([1, 0.00125, -2.5, 1000])),
            is_float,
        )
        bits = bit_positions(one)
        if max(bits) < 8 * size and not taken & set(bits):
            taken |= set(bits)
            signals.append(one)
    if not signals:
        signals = [signal('S', 0, 8)]
    return Message(1, 'M', size, signals, is_fd=size > 8)


@settings(max_examples=150, deadline=None)
@given(message=messages(), data=st.data())
def test_any_frame_decodes_as_cantools_decodes_it(message, data):
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    layout = SignalLayout([(s, 0) for s in message.signals], message.length)
    expected = message.decode(payload, decode_choices=False)
    np.testing.assert_allclose(
        layout.decode(payload), [expected[s.name] for s in message.signals], rtol=1e-15
    )


@settings(max_examples=80, deadline=None)
@given(message=messages(), data=st.data())
def test_what_decodes_from_a_frame_encodes_to_the_same_frame(message, data):
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    layout = SignalLayout([(s, 0) for s in message.signals], message.length)
    values = layout.decode(payload)
    again = layout.decode(layout.encode(values))
    np.testing.assert_array_equal(np.nan_to_num(again), np.nan_to_num(values))


@settings(max_examples=80, deadline=None)
@given(message=messages(), data=st.data())
def test_a_field_reads_the_raw_number_that_cantools_reads(message, data):
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    raw = message.decode(payload, decode_choices=False, scaling=False)
    for one in message.signals:
        if not one.is_float and not one.is_signed:
            assert Field.of(one).read(payload) == raw[one.name]


def test_frames_in_a_row_are_read_as_one_payload():
    first = signal('first', 0, 16, scale=0.5)
    second = signal('second', 7, 16, 'big_endian', signed=True)
    layout = SignalLayout([(first, 0), (second, 2)], 4)
    assert layout.decode(bytes([0x02, 0x01, 0xFF, 0xFE])).tolist() == [129.0, -2.0]


def test_values_beyond_the_range_stop_at_its_ends_and_no_number_becomes_zero():
    one = signal('x', 0, 8, signed=True, scale=0.5)
    layout = SignalLayout([(one, 0)], 1)
    assert layout.limits[0].tolist() == [-64.0]
    assert layout.limits[1].tolist() == [63.5]
    assert layout.quantise([[1000.0], [-1000.0], [0.26], [np.nan]])[:, 0].tolist() == [
        63.5,
        -64.0,
        0.5,
        0.0,
    ]


@pytest.mark.parametrize(
    ('bad', 'words'),
    [
        (signal('wide', 0, 64), '64 bits'),
        (signal('late', 40, 16), 'fit'),
        (signal('half', 0, 16, is_float=True), 'float of 16 bits'),
        (signal('odd', 3, 32, is_float=True), 'bit 3'),
    ],
)
def test_a_signal_that_cannot_be_read_is_named(bad, words):
    with pytest.raises(LayoutError, match=words) as error:
        SignalLayout([(bad, 0)], 6)
    assert repr(bad.name) in str(error.value)
