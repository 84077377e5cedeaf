"""Dates, times of day, and their parts in several columns."""

import numpy as np
import pytest
from power_recordings.commands.arguments import import_logs as main
from power_recordings.importing.times import DAY, is_date, is_time_of_day, moments, unwrapped
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

TEN = 10 * 3600 * 10**9  # ns


def ns(*texts):
    return moments(np.array(texts, object), 'log').tolist()


@pytest.mark.parametrize(
    'text',
    [
        '2026-11-24T10:00:00.5',
        '2026-11-24 10:00:00,500',
        '2026/11/24 10:00:00.5',
        '24.11.2026 10:00:00,500',
        '24/11/2026 10:00:00.500',
        '11/24/2026 10:00:00.5 AM',
        '2026-11-24 11:00:00.5 +01:00',
    ],
)
def test_one_moment_is_read_however_it_is_written(text):
    assert ns(text) == [1_795_514_400 * 10**9 + 500_000_000]


def test_noon_is_no_midnight_and_the_afternoon_is_twelve_hours_on():
    assert ns('12:00:00 AM', '12:00:00 PM', '1:00 pm') == [0, 12 * TEN // 10, 13 * TEN // 10]


def test_a_time_of_day_is_no_date():
    assert is_time_of_day('10:00:00.5')
    assert not is_date('10:00:00')
    assert is_date('24.11.2026')


def test_times_of_day_go_on_over_midnight():
    times = np.array([DAY - 2, -1, DAY - 1, 0, 1])
    whole = unwrapped(times, -1)
    assert whole.tolist() == [DAY - 2, -1, DAY - 1, DAY, DAY + 1]
    assert unwrapped(np.array([2, 3]), int(whole.max())).tolist() == [DAY + 2, DAY + 3]


def test_what_is_no_time_is_an_error_that_quotes_it():
    with pytest.raises(InputError, match="log: 'soon' is no time"):
        ns('10:00', 'soon')
    with pytest.raises(InputError, match='25:00:00'):
        ns('25:00:00')


def test_date_time_and_milliseconds_in_three_columns_are_added(tmp_path, capsys):
    rows = ['Date,Time,Millisecond,Speed (rpm),Torque (Nm),Udc (V),Idc (A)']
    for i in range(400):  # 10 ms each, over midnight
        date, clock = ('24', '23:59:58') if i < 200 else ('25', '00:00:00')
        clock = clock[:-1] + str(int(clock[-1]) + i % 200 // 100)
        torque = 2 + np.sin(i / 9)
        amps = (1.1 * torque * 31.4159 + 5) / 48
        rows.append(f'2026/11/{date},{clock},{i % 100 * 10},300,{torque:.6f},48,{amps:.6f}')
    log = tmp_path / 'log.csv'
    log.write_text('\n'.join([*rows, '']))
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    assert '[{from: Date}, {from: Time}, {from: Millisecond, unit: ms}]' in text
    (tmp_path / 'map.yaml').write_text(text)
    assert main([str(log), '--map', str(tmp_path / 'map.yaml'), '-o', str(tmp_path / 'bag')]) == 0
    stamps = Recording.open(tmp_path / 'bag').joint_states().stamp_ns
    assert (np.diff(stamps) == 10_000_000).all()
