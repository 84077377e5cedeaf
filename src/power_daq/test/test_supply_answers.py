import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from power_daq.supply.answers import (
    AnswerError,
    SupplyMeasurement,
    identity,
    measured,
    quantity,
    scpi_error,
    switch,
)


def test_three_numbers_with_units_are_voltage_current_and_power():
    assert measured('48.02 V, 3.14 A, 150.8 W') == SupplyMeasurement(48.02, 3.14, 150.8)
    assert measured('48.02V,-3.14A,-150.8W\r') == SupplyMeasurement(48.02, -3.14, -150.8)


def test_prefixes_are_part_of_the_number():
    assert quantity('1.5 kW', 'W') == 1500.0
    assert quantity('-20 mA', 'A') == -0.02
    assert quantity('4.8E1 V', 'V') == 48.0


@pytest.mark.parametrize(
    'answer',
    [
        '',
        '48.02 V, 3.14 A',
        '48.02 V, 3.14 A, 150.8',
        '3.14 A, 48.02 V, 150.8 W',
        '48.02 V, 3.14 V, 150.8 W',
        '48.02 V, 3.14 A, 150.8 W, 0',
        '48,02 V, 3.14 A, 150.8 W',
        '48.02 V, 3.\x00 A, 150.8 W',
        'nan V, 3.14 A, 150.8 W',
        'inf V, 3.14 A, 150.8 W',
        '0,"No error"',
        '٤٨ V, 3 A, 144 W',
    ],
)
def test_anything_else_is_refused_and_quoted(answer):
    with pytest.raises(AnswerError) as caught:
        measured(answer)
    assert repr(answer) in str(caught.value)


def test_a_long_answer_is_quoted_from_its_beginning():
    with pytest.raises(AnswerError, match=r'x{40}…'):
        measured('x' * 500)


@settings(deadline=None)
@given(st.text(max_size=60))
def test_whatever_is_answered_gives_finite_numbers_or_is_refused(answer):
    try:
        found = measured(answer)
    except AnswerError:
        return
    assert all(math.isfinite(value) for value in found)


@settings(deadline=None)
@given(*(st.floats(-1e4, 1e4) for _ in range(3)), st.integers(0, 4))
def test_numbers_come_back_as_they_were_written(voltage, current, power, digits):
    answer = f'{voltage:.{digits}f} V, {current:.{digits}f} A, {power:.{digits}f} W'
    assert measured(answer) == pytest.approx((voltage, current, power), abs=10**-digits)


@settings(deadline=None)
@given(st.integers(0, 25))
def test_an_answer_cut_off_anywhere_is_refused(length):
    whole = '48.02 V, 3.14 A, 150.8 W'
    if length < len(whole):
        with pytest.raises(AnswerError):
            measured(whole[:length])


def test_errors_have_a_number_and_a_text():
    assert scpi_error('-113,"Undefined header"') == (-113, 'Undefined header')
    assert scpi_error('0, No error').code == 0
    with pytest.raises(AnswerError):
        scpi_error('48.02 V, 3.14 A, 150.8 W')


def test_the_identity_may_lack_serial_number_and_firmware():
    assert identity('EA, PSB 9080-120, 123, V3.0, V2').firmware == 'V3.0, V2'
    assert identity('EA, PSB').serial == ''
    with pytest.raises(AnswerError):
        identity('0.00 V')


def test_an_output_is_on_or_off():
    assert [switch(word) for word in ('ON', '1', 'OFF', ' 0 ')] == [True, True, False, False]
    with pytest.raises(AnswerError):
        switch('maybe')
