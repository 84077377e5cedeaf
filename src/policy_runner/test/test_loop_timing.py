from policy_runner.supervisor.supervisor import LoopTiming


def test_steps_on_time_miss_no_period_and_late_ones_those_between():
    timing = LoopTiming(0.02)
    for now in (0.0, 0.02, 0.041, 0.059, 0.1, 0.2):
        timing.begin(now)
        timing.end(now + 0.001)
    assert timing.missed == 1 + 4
    assert timing.figures() == {
        'steps': '6',
        'periods missed': '5',
        'observation to command, median [ms]': '1.00',
        'observation to command, p99 [ms]': '1.00',
    }


def test_a_change_of_rate_is_no_missed_period():
    timing = LoopTiming(0.005)
    timing.begin(0.0)
    timing.end(0.001)
    timing.change(0.02)
    timing.begin(0.5)
    timing.end(0.501)
    assert timing.missed == 0


def test_before_the_first_step_there_is_nothing_to_say():
    assert LoopTiming(0.02).figures() == {'steps': '0'}
