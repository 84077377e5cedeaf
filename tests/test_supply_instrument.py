"""The supply's poller against a simulated instrument, over real TCP on loopback."""

import threading
import time

import pytest
from power_daq.supply.instrument import Instrument, InstrumentSettings
from sim_bridge.instruments.scpi import ScpiInstrument, SupplyState, Terminals, whole
from wattwalk_core.errors import InputError

LINE = '48.00 V, 2.00 A, 96.0 W'


def values_are_true(bench):
    """Each value was measured by the instrument, and came out once."""
    currents = [round(reading.current, 2) for reading in bench.readings]
    assert currents == sorted(set(currents)), 'a value came twice, or out of order'
    assert set(currents) <= set(bench.asked), 'a value that was never measured'
    assert {reading.voltage for reading in bench.readings} == {48.0}


def test_each_measurement_comes_once_with_the_time_between_question_and_answer(bench):
    bench.poll()
    bench.read(50)
    values_are_true(bench)
    for reading in bench.readings:
        measured = bench.asked[round(reading.current, 2)]
        assert abs(reading.stamp - measured) <= 0.5e9 * reading.round_trip + 2e6
    assert bench.said == [
        'reading PSB 9080-120 3U of EA Elektro-Automatik GmbH & Co. KG, serial number 0000000000'
    ]


def test_it_only_asks(bench):
    bench.poll()
    bench.read()
    assert set(bench.state.heard) <= {
        '*IDN?',
        'SYST:NOM:VOLT?',
        'SYST:NOM:CURR?',
        'SYST:ERR?',
        'MEAS:ARR?',
    }
    assert not bench.state.remote


def test_a_connection_that_breaks_is_made_again_and_what_was_missed_is_counted(bench):
    bench.poll(timeout=0.5)
    bench.read()
    bench.instrument.drop()
    bench.until(lambda: bench.counts.connections == 2)
    bench.read()
    values_are_true(bench)
    assert bench.counts.connections_lost == 1
    assert bench.poller.lost > 0
    assert sum('supply lost' in line for line in bench.said) == 1


def test_an_instrument_without_power_is_waited_for_and_said_to_be_absent_once(bench):
    bench.poll(timeout=0.5)
    bench.read()
    bench.instrument.close()
    bench.until(lambda: 'refused' in bench.poller.state.absence)
    before = len(bench.readings)
    time.sleep(0.3)
    assert len(bench.readings) == before
    bench.instrument = ScpiInstrument(SupplyState(bench.terminals), port=bench.port)
    bench.read()
    values_are_true(bench)
    assert bench.poller.state.absence == ''
    assert sum('supply absent' in line for line in bench.said) == 1
    stamps = [reading.stamp for reading in bench.readings]
    assert stamps == sorted(set(stamps))


def test_a_supply_that_is_absent_at_the_start_is_waited_for(bench):
    bench.instrument.close()
    bench.poll(timeout=0.5)
    bench.until(lambda: bench.said)
    assert 'will try again' in bench.said[0]
    assert bench.poller.lost == 0
    bench.instrument = ScpiInstrument(bench.state, port=bench.port)
    bench.read()


def test_slow_answers_are_all_true_and_the_slots_they_take_are_lost(bench):
    bench.spoil(lambda answer: [(0.05, answer.encode() + b'\n')], every=1)
    bench.poll()
    bench.read(10)
    values_are_true(bench)
    assert bench.poller.lost >= 20
    assert bench.counts.not_an_answer == bench.counts.connections_lost == 0


def test_an_answer_that_comes_too_late_is_never_taken_for_the_next_one(bench):
    bench.spoil(lambda answer: [(1.0, answer.encode() + b'\n')], every=10)
    bench.poll(timeout=0.5)
    bench.until(lambda: bench.counts.connections_lost >= 2)
    values_are_true(bench)
    late = [r for r in bench.readings if r.round_trip > 0.9]
    assert not late
    for reading in bench.readings:
        assert abs(reading.stamp - bench.asked[round(reading.current, 2)]) < 0.6e9


def test_an_answer_in_two_pieces_is_put_together(bench):
    bench.spoil(lambda answer: [(0.0, answer[:9].encode()), (0.01, answer[9:].encode() + b'\n')])
    bench.poll()
    bench.read(20)
    values_are_true(bench)
    assert bench.counts.not_an_answer == 0


@pytest.mark.parametrize(
    'garbage',
    [
        b'48.0# V, 2.00 A\n',
        b'\xff\x00\x80\n',
        b'\n',
        b'2.00 A, 48.00 V, 96.0 W\n',
        b'48.00 mV, 2.00 V, 96.0 W\n',
        b'4800.0 V, 2.00 A, 9600.0 W\n',
        b'48.00 V, 2.00 A\n, 96.0 W\n',
    ],
    ids=['cut', 'binary', 'empty', 'swapped', 'units', 'beyond the rating', 'line break'],
)
def test_garbage_is_counted_not_published_and_the_rest_goes_on(bench, garbage):
    bench.spoil(lambda answer: [(0.0, garbage)])
    bench.poll()
    bench.until(lambda: bench.counts.not_an_answer >= 3)
    bench.read(10)
    values_are_true(bench)
    assert bench.counts.connections_lost == 0
    assert 'expected' in bench.poller.state.last_garbage


def test_an_answer_too_many_does_not_shift_those_that_follow(bench):
    extra = f'{LINE}\n'.encode()
    bench.spoil(lambda answer: [(0.0, answer.encode() + b'\n' + extra)], every=7)
    bench.poll()
    bench.read(40)
    for reading in bench.readings:
        assert reading.current != 2.0 or round(reading.current, 2) in bench.asked
    values_are_true(bench)


def test_answers_out_of_step_show_at_the_error_queue_and_are_put_right(bench):
    extra = f'{LINE}\n'.encode()
    bench.spoil(lambda answer: [(0.0, answer.encode() + b'\n'), (0.002, extra)], every=50)
    bench.poll()
    bench.until(lambda: bench.counts.not_an_answer >= 1)
    bench.instrument.send = whole
    resynchronised = len(bench.readings)
    bench.read(10)
    after = bench.readings[resynchronised + 1 :]
    for reading in after:
        measured = bench.asked[round(reading.current, 2)]
        assert abs(reading.stamp - measured) <= 0.5e9 * reading.round_trip + 2e6


def test_errors_of_the_instrument_are_counted_and_named(bench):
    bench.poll()
    bench.read(5)
    bench.state.error(-222)
    bench.state.error(-113)
    bench.until(lambda: bench.counts.instrument_errors == 2)
    assert [str(e) for e in bench.poller.state.last_errors] == [
        '-222 Data out of range',
        '-113 Undefined header',
    ]


def test_a_supply_can_be_asked_for_voltage_and_current_one_by_one(bench):
    bench.poll(separate=True)
    bench.read()
    assert all(reading.power is None for reading in bench.readings)
    assert 'MEAS:ARR?' not in bench.state.heard


def test_a_supply_that_does_not_tell_its_rating_is_read_all_the_same(bench, monkeypatch):
    answer = SupplyState.answer
    monkeypatch.setattr(
        SupplyState, 'answer', lambda s, line: None if ':NOM:' in line else answer(s, line)
    )
    bench.poll(timeout=0.5)
    bench.read(5)
    values_are_true(bench)


def test_power_that_is_not_voltage_times_current_is_counted(bench):
    bench.spoil(lambda answer: [(0.0, b'48.00 V, 90.00 A, 96.0 W\n')], every=4)
    bench.poll()
    bench.until(lambda: bench.counts.power_disagrees >= 2)


def test_an_exception_of_the_sink_comes_out_of_join(bench):
    def refuse(reading):
        raise ZeroDivisionError

    bench.poll()
    bench.read(1)
    bench.poller._sink = refuse
    with pytest.raises(ZeroDivisionError):
        bench.until(lambda: False)
    bench.poller = None


@pytest.mark.parametrize('host', ['', 'a b', '10.0.0.1::5025'])
def test_a_host_that_cannot_be_one_is_refused(host):
    with pytest.raises(InputError, match='give the name or IPv4 address'):
        InstrumentSettings(host)


def test_the_instrument_answers_words_in_full_and_in_any_case():
    state = SupplyState(lambda: Terminals(48.0, 2.0))
    assert state.answer('measure:array?') == LINE
    assert state.answer(':MEAS:ARR?') == LINE
    assert state.answer('SYSTem:ERRor?') == '0,"No error"'
    assert state.answer('FOO:BAR?') is None
    assert state.answer('SYST:ERR?') == '-113,"Undefined header"'


def test_the_instrument_takes_settings_under_remote_control_only():
    state = SupplyState(lambda: Terminals(48.0, 2.0))
    state.answer('VOLT 12')
    assert (state.voltage, state.answer('SYST:ERR?')) == (48.0, '-201,"Invalid while in local"')
    for line in ('SYST:LOCK ON', 'VOLT 12', 'VOLT 900', 'CURR x', 'OUTP OFF'):
        state.answer(line)
    assert state.voltage == 12.0
    assert state.answer('SYST:ERR?') == '-222,"Data out of range"'
    assert state.answer('SYST:ERR?') == '-104,"Data type error"'
    assert state.answer('MEAS:ARR?') == '0.00 V, 0.00 A, 0.0 W'


def test_the_instrument_serves_the_next_client_when_one_has_left(bench):
    settings = InstrumentSettings('127.0.0.1', bench.port, 5.0)
    for _ in range(3):
        instrument = Instrument(settings)
        assert instrument.measure().voltage == 48.0
        instrument.close()
    assert threading.active_count() < 20


def test_a_port_that_is_taken_is_told_in_a_line(bench):
    with pytest.raises(InputError, match=f'cannot listen on 127.0.0.1:{bench.port}'):
        ScpiInstrument(bench.state, port=bench.port)
