"""Switching a simulated instrument's output on, and all that can go wrong meanwhile."""

import time

import pytest
from power_daq.supply.instrument import Instrument, InstrumentSettings, LostError, OutputRequest
from sim_bridge.instruments.scpi import SupplyState, whole
from supply_bench import PATIENCE
from wattwalk_core.errors import InputError


def assert_panel_has_control(bench):
    """Giving it back has no answer: the instrument may read it after the caller has gone on."""
    deadline = time.monotonic() + PATIENCE
    while bench.state.remote:
        assert time.monotonic() < deadline, 'the panel never got control back'
        time.sleep(0.01)


def test_an_output_is_switched_on_only_when_asked_and_once(bench):
    bench.state.output = False
    done = []
    bench.poll(
        timeout=0.5,
        prepare=lambda instrument: done.append(OutputRequest(24.0, 5.0).switch_on(instrument)),
    )
    bench.read(5)
    assert bench.state.output
    assert (bench.state.voltage, bench.state.current) == (24.0, 5.0)
    assert not bench.state.remote, 'the panel has control again'
    assert done == ['output of PSB 9080-120 3U switched on: 24 V, at most 5 A']
    bench.state.output = False
    bench.instrument.drop()
    bench.until(lambda: bench.counts.connections == 2)
    bench.read(5)
    assert not bench.state.output


@pytest.mark.parametrize(
    ('voltage', 'current', 'words'),
    [
        (0.0, 5.0, 'set_voltage is 0 V; to switch the output on give more than 0 and at most 60'),
        (61.0, 5.0, 'set_voltage is 61 V'),
        (24.0, -1.0, 'set_current is -1 A'),
        (float('nan'), 1.0, 'set_voltage is nan V'),
    ],
)
def test_an_output_without_sane_limits_is_refused_before_anything_is_sent(voltage, current, words):
    with pytest.raises(InputError, match=words):
        OutputRequest(voltage, current)


def switch_on(bench, request):
    instrument = Instrument(InstrumentSettings('127.0.0.1', bench.port, 5.0))
    try:
        return request.switch_on(instrument)
    finally:
        instrument.close()


def test_an_output_beyond_the_rating_stays_off(bench, monkeypatch):
    monkeypatch.setattr('sim_bridge.instruments.scpi.RATED_VOLTAGE', 40.0)
    bench.state.output = False
    with pytest.raises(InputError, match='48 V is more than the 40 V that PSB'):
        switch_on(bench, OutputRequest(48.0, 5.0))
    assert 'SYST:LOCK ON' not in bench.state.heard
    assert not bench.state.output


def test_an_output_stays_off_where_the_panel_keeps_control(bench, monkeypatch):
    never = property(lambda state: False, lambda state, wanted: None)
    monkeypatch.setattr(SupplyState, 'remote', never, raising=False)
    bench.state.output = False
    with pytest.raises(InputError, match='controlled by NONE: release it at its panel'):
        switch_on(bench, OutputRequest(48.0, 5.0))
    assert not bench.state.output


def test_an_output_stays_off_where_a_setting_reads_back_otherwise(bench):
    bench.state.output = False
    bench.instrument.send = lambda question, answer: whole(
        question, '12.00 V' if question == 'VOLT?' else answer
    )
    with pytest.raises(InputError, match='VOLT 48 V was set, 12 V read back'):
        switch_on(bench, OutputRequest(48.0, 5.0))
    assert not bench.state.output
    assert_panel_has_control(bench)


def ended_by(bench):
    """The error that ended the poller."""
    poller, bench.poller = bench.poller, None
    end = time.monotonic() + PATIENCE
    while not poller.failed:
        assert time.monotonic() < end, f'waited in vain; it said {bench.said}'
        time.sleep(0.01)
    with pytest.raises(InputError) as raised:
        poller.join()
    return str(raised.value)


def heard(bench, command):
    return [line for line in bench.state.heard if line.startswith(command)]


class Tripping(SupplyState):
    """A supply whose output goes off as soon as it is switched on."""

    def answer(self, line):
        answer = super().answer(line)
        if line == 'OUTP ON':
            self.output = False
        return answer


def test_an_output_that_trips_at_once_is_not_switched_on_a_second_time(bench):
    bench.instrument.state = bench.state = Tripping(bench.terminals, output=False)
    bench.poll(prepare=OutputRequest(24.0, 5.0).switch_on)
    assert ended_by(bench) == (
        'the output went off at once after OUTP ON; the output was switched off and is off'
    )
    assert heard(bench, 'OUTP ') == ['OUTP ON', 'OUTP OFF']
    assert bench.instrument.connections == 1
    assert bench.readings == []


def test_a_link_that_breaks_after_the_output_came_on_is_not_made_again_to_switch_on(bench):
    bench.state.output = False

    def send(question, answer):
        if question == 'OUTP?' and bench.state.output:
            bench.instrument.drop()
            bench.state.output = False  # the supply is power-cycled and comes back off
            return []
        return whole(question, answer)

    bench.instrument.send = send
    bench.poll(timeout=0.5, prepare=OutputRequest(24.0, 5.0).switch_on)
    said = ended_by(bench)
    assert 'the output may be ON' in said
    assert 'look at its panel' in said
    assert heard(bench, 'OUTP ON') == ['OUTP ON']
    assert not bench.state.output


def test_a_preparation_that_fails_ends_the_poller_whatever_it_raises(bench):
    def prepare(instrument):
        raise LostError('gone')

    bench.poll(prepare=prepare)
    with pytest.raises(LostError, match='gone'):
        bench.until(lambda: False)
    bench.poller = None
    assert bench.readings == []


def test_an_output_that_is_refused_after_it_came_on_is_switched_off_again_before_the_lock(bench):
    class Complaining(SupplyState):
        def answer(self, line):
            answer = super().answer(line)
            if line == 'OUTP ON':
                self.error(-222)
            return answer

    bench.instrument.state = bench.state = Complaining(bench.terminals, output=False)
    with pytest.raises(InputError) as raised:
        switch_on(bench, OutputRequest(24.0, 5.0))
    assert str(raised.value) == (
        'the supply refuses OUTP ON: -222 Data out of range; '
        'the output was switched off and is off'
    )
    assert not bench.state.output
    assert_panel_has_control(bench)
    changes = [line for line in bench.state.heard if '?' not in line]
    assert changes[-3:] == ['OUTP ON', 'OUTP OFF', 'SYST:LOCK OFF']


def test_an_output_that_stays_on_in_spite_of_outp_off_is_said_to_be_on(bench):
    class Stuck(SupplyState):
        def answer(self, line):
            if line == 'OUTP OFF':
                return None
            answer = super().answer(line)
            if line == 'OUTP ON':
                self.error(-222)
            return answer

    bench.instrument.state = bench.state = Stuck(bench.terminals, output=False)
    with pytest.raises(InputError, match='the output is ON although OUTP OFF was sent'):
        switch_on(bench, OutputRequest(24.0, 5.0))


def test_an_answer_that_comes_after_outp_off_is_not_taken_for_that_of_the_output(bench):
    bench.state.output = False
    late = iter([True])

    def send(question, answer):
        if question == 'OUTP?' and bench.state.output and next(late, False):
            return [(0.7, b'OFF\n')]
        return whole(question, answer)

    class Stuck(SupplyState):
        def answer(self, line):
            return None if line == 'OUTP OFF' else super().answer(line)

    bench.instrument.state = bench.state = Stuck(bench.terminals, output=False)
    bench.instrument.send = send
    instrument = Instrument(InstrumentSettings('127.0.0.1', bench.port, 0.5))
    with pytest.raises(InputError, match='the output is ON although OUTP OFF was sent'):
        OutputRequest(24.0, 5.0).switch_on(instrument)
    instrument.close()


def test_an_output_that_is_on_already_is_refused_and_nothing_of_it_is_changed(bench):
    bench.state.voltage, bench.state.current = 30.0, 4.0
    with pytest.raises(InputError, match='is on already: switch it off at its panel first'):
        switch_on(bench, OutputRequest(55.0, 50.0))
    assert bench.state.output
    assert (bench.state.voltage, bench.state.current) == (30.0, 4.0)
    assert [line for line in bench.state.heard if '?' not in line] == []


def test_a_link_that_breaks_while_the_lock_is_given_back_does_not_hide_what_failed(bench):
    bench.state.output = False

    def send(question, answer):
        if question == 'VOLT?':
            bench.instrument.drop()
            return []
        return whole(question, answer)

    bench.instrument.send = send
    instrument = Instrument(InstrumentSettings('127.0.0.1', bench.port, 0.5))
    with pytest.raises(InputError, match=r'VOLT\?.*; the output was not switched on'):
        OutputRequest(24.0, 5.0).switch_on(instrument)
    instrument.close()
    assert not bench.state.output
