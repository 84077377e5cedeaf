"""Times, durations, clocks and timers."""

import pytest
import rclpy
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMsg


def test_times_add_and_subtract_durations():
    start = Time(seconds=10, nanoseconds=5)
    assert (start + Duration(seconds=1.5)).nanoseconds == 11_500_000_005
    assert (start - Duration(nanoseconds=5)).nanoseconds == 10_000_000_000
    assert (start - Time(seconds=4)).nanoseconds == 6_000_000_005
    assert Duration(seconds=-1) < Duration()


def test_messages_of_negative_durations_have_positive_nanoseconds():
    message = Duration(seconds=-0.25).to_msg()
    assert (message.sec, message.nanosec) == (-1, 750_000_000)
    assert Duration.from_msg(message).nanoseconds == -250_000_000


def test_time_messages_go_there_and_back():
    message = Time(nanoseconds=1_700_000_000_123_456_789).to_msg()
    assert (message.sec, message.nanosec) == (1_700_000_000, 123_456_789)
    assert Time.from_msg(message, ClockType.SYSTEM_TIME).nanoseconds == 1_700_000_000_123_456_789


def test_times_of_different_clocks_do_not_mix():
    ros, steady = Time(clock_type=ClockType.ROS_TIME), Time(clock_type=ClockType.STEADY_TIME)
    with pytest.raises(TypeError, match='different clock types'):
        _ = ros - steady
    with pytest.raises(TypeError, match='different clock types'):
        _ = ros < steady


def test_negative_times_are_refused():
    with pytest.raises(ValueError, match='negative'):
        Time(seconds=-1)


def test_clocks_are_of_the_kind_asked_for_and_do_not_go_back():
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    first = clock.now()
    assert first.clock_type == ClockType.STEADY_TIME
    assert clock.now() >= first
    assert isinstance(Clock(clock_type=ClockType.ROS_TIME), ROSClock)


def test_a_timer_on_simulated_time_follows_the_clock_topic(node, spin_until):
    source = Node('simulator')
    publisher = source.create_publisher(ClockMsg, '/clock', 10)
    node.set_parameters([Parameter('use_sim_time', value=True)])
    calls = []
    node.create_timer(1.0, lambda: calls.append(node.get_clock().now().nanoseconds))
    spin_until(lambda: publisher.get_subscription_count() == 1)
    assert calls == []
    moments = [1_000_000_000, 2_000_000_000, 5_500_000_000, 6_000_000_000]
    for moment in moments:
        publisher.publish(ClockMsg(clock=Time(nanoseconds=moment).to_msg()))
        spin_until(lambda now=moment: calls and calls[-1] == now)
    assert calls == moments
    source.destroy_node()


def test_a_timer_calls_back_until_cancelled_and_again_after_reset(node, spin_until):
    calls = []
    timer = node.create_timer(0.005, lambda: calls.append(1))
    spin_until(lambda: len(calls) >= 3)
    timer.cancel()
    count = len(calls)
    for _ in range(5):
        rclpy.spin_once(node, timeout_sec=0.01)
    assert len(calls) == count
    timer.reset()
    spin_until(lambda: len(calls) > count)
    assert timer.timer_period_ns == 5_000_000


def test_a_timer_that_is_late_skips_what_it_missed(node):
    simulated = ROSClock()
    simulated._set_ros_time_is_active(True)
    calls = []
    node.create_timer(0.1, lambda: calls.append(simulated.now().nanoseconds), clock=simulated)
    for hundredths in (10, 45, 47, 50):
        now = Time(nanoseconds=hundredths * 10_000_000, clock_type=ClockType.ROS_TIME)
        simulated.set_ros_time_override(now)
        for _ in range(5):
            rclpy.spin_once(node, timeout_sec=0.0)
    assert calls == [100_000_000, 450_000_000, 500_000_000]


def test_a_timer_without_autostart_waits_for_reset(node):
    timer = node.create_timer(0.001, lambda: None, autostart=False)
    assert timer.is_canceled()
    assert timer.time_until_next_call() is None
    timer.reset()
    assert not timer.is_canceled()
