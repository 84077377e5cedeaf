"""Loggers: format, severities and limits."""

import re

import pytest
from rclpy.clock import ROSClock
from rclpy.logging import LoggingSeverity, get_logger, set_logger_level
from rclpy.time import Time


@pytest.fixture
def logger(request):
    made = get_logger(request.node.name)
    yield made
    made.set_level(LoggingSeverity.UNSET)


def test_a_line_has_severity_time_name_and_message(capfd, logger):
    assert logger.info('12 drives')
    line = capfd.readouterr().err
    assert re.fullmatch(rf'\[INFO\] \[\d+\.\d{{9}}\] \[{logger.name}\]: 12 drives\n', line)


def test_severities_below_the_level_are_not_written(capfd, logger):
    assert not logger.debug('hidden')
    logger.set_level(LoggingSeverity.DEBUG)
    assert logger.debug('shown')
    set_logger_level(logger.name, LoggingSeverity.ERROR)
    assert not logger.warning('hidden')
    assert 'hidden' not in capfd.readouterr().err


def test_once_writes_the_first_time_only(capfd, logger):
    written = [logger.warn(f'number {n}', once=True) for n in range(3)]
    assert written == [True, False, False]
    assert capfd.readouterr().err.count('number') == 1


def test_throttled_messages_keep_their_distance_on_the_clock_given(logger):
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    written = []
    for second in (1.0, 1.5, 1.9, 2.0, 2.5, 3.5):
        clock.set_ros_time_override(Time(seconds=second))
        written.append(
            logger.error('x', throttle_duration_sec=1.0, throttle_time_source_type=clock)
        )
    assert written == [True, False, False, True, False, True]


def test_unknown_severities_are_refused(logger):
    with pytest.raises(ValueError, match='7'):
        logger.log('x', 7)
