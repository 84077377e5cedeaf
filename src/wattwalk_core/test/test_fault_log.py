"""Log of faults that come and go."""

import pytest
from kept_log import KeptLog
from wattwalk_core.nodes import diagnostics
from wattwalk_core.nodes.diagnostics import FaultLog


@pytest.fixture
def clock(monkeypatch):
    """The time in s that the log reads, in a list that a test changes."""
    now = [0.0]
    monkeypatch.setattr(diagnostics.time, 'monotonic', lambda: now[0])
    return now


def test_a_fault_that_lasts_is_logged_once_in_ten_seconds_whatever_its_figures(clock):
    kept = KeptLog()
    log = FaultLog(kept)
    for second in range(21):
        clock[0] = float(second)
        log.warning(f'{second} samples lost, rate {second / 2} Hz')
    assert kept == [f'{s} samples lost, rate {s / 2} Hz' for s in (0, 10, 20)]


def test_a_new_fault_is_not_hidden_by_an_old_one(clock):
    kept = KeptLog()
    log = FaultLog(kept)
    for fault in ('bus silent', 'no frames of DRIVE_1', 'bus silent', 'no frames of DRIVE_2'):
        log.warning(fault)
    assert kept == ['bus silent', 'no frames of DRIVE_1', 'no frames of DRIVE_2']


def test_the_end_of_a_fault_is_logged_where_its_beginning_was(clock):
    kept = KeptLog()
    log = FaultLog(kept)
    log.info('reading can0')
    for second in (0.0, 2.0, 4.0, 11.0):
        clock[0] = second
        log.warning('bus lost')
        log.info('reading can0')
    assert kept == ['reading can0', *2 * ('bus lost', 'reading can0')]


def test_texts_that_change_without_end_are_no_flood(clock):
    kept = KeptLog()
    log = FaultLog(kept)
    for letter in 'abcdefghijklmnop':
        log.warning(f'joint {letter} is unknown')
    assert len(kept) == 8
