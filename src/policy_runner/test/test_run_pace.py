from policy_runner.supervisor.loop_timing import Pace


def test_steps_on_time_miss_no_period_and_late_ones_those_between():
    pace = Pace(0.02)
    for now in (0.0, 0.02, 0.041, 0.059, 0.1, 0.2):
        pace.begin(now)
        pace.end(now + 0.001)
    assert pace.missed == 1 + 4
    assert pace.figures() == {
        'steps': '6',
        'periods missed': '5',
        'observation to command, median [ms]': '1.00',
        'observation to command, p99 [ms]': '1.00',
    }


def test_a_change_of_rate_is_no_missed_period():
    pace = Pace(0.005)
    pace.begin(0.0)
    pace.end(0.001)
    pace.change(0.02)
    pace.begin(0.5)
    pace.end(0.501)
    assert pace.missed == 0


def test_before_the_first_step_there_is_nothing_to_say():
    assert Pace(0.02).figures() == {'steps': '0'}
