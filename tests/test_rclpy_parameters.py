"""Behaviour of rclpy's parameters that the nodes rely on, the same on both runtimes."""

import pytest
import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterException,
    ParameterNotDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions


def test_a_callback_may_refuse_parameters_with_a_reason(node):
    def check(parameters):
        too_high = any(parameter.value > 5 for parameter in parameters)
        return SetParametersResult(successful=not too_high, reason='at most 5')

    node.declare_parameter('gain', 1)
    node.add_on_set_parameters_callback(check)
    assert node.set_parameters([Parameter('gain', value=4)])[0].successful
    refused = node.set_parameters([Parameter('gain', value=6)])[0]
    assert (refused.successful, refused.reason) == (False, 'at most 5')
    assert node.get_parameter('gain').value == 4


def test_read_only_parameters_keep_their_value(node):
    descriptor = ParameterDescriptor(description='bus', read_only=True)
    assert node.declare_parameter('channel', 'can0', descriptor).value == 'can0'
    result = node.set_parameters([Parameter('channel', value='can1')])[0]
    assert not result.successful
    assert result.reason
    assert node.get_parameter('channel').value == 'can0'


@pytest.mark.parametrize(
    ('limits', 'default', 'outside'),
    [
        ({'integer_range': [IntegerRange(from_value=1, to_value=10, step=0)]}, 2, 11),
        ({'floating_point_range': [FloatingPointRange(from_value=0.0, to_value=1.0)]}, 0.5, 1.5),
    ],
)
def test_a_range_holds_for_declaring_and_for_setting(node, limits, default, outside):
    node.declare_parameter('inside', default, ParameterDescriptor(**limits))
    assert not node.set_parameters([Parameter('inside', value=outside)])[0].successful
    assert node.get_parameter('inside').value == default
    with pytest.raises(InvalidParameterValueException):
        node.declare_parameter('outside', outside, ParameterDescriptor(**limits))


def test_wrong_uses_of_parameters_raise_parameter_exceptions(ros_domain):
    rclpy.init(
        args=['--ros-args', '-p', 'whole:=1.5', '-p', 'text:=given'],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    node = Node('conformance')
    try:
        assert node.declare_parameter('text', 'default').value == 'given'
        with pytest.raises(InvalidParameterTypeException):
            node.declare_parameter('whole', 1)
        with pytest.raises(ParameterAlreadyDeclaredException):
            node.declare_parameter('text', 'again')
        with pytest.raises(ParameterNotDeclaredException):
            node.get_parameter('unheard_of')
        assert node.get_parameter('use_sim_time').value is False
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    for kind in (
        InvalidParameterTypeException,
        InvalidParameterValueException,
        ParameterAlreadyDeclaredException,
        ParameterNotDeclaredException,
    ):
        assert issubclass(kind, ParameterException)


@pytest.mark.parametrize(
    ('make', 'error'),
    [
        (lambda node: node.declare_parameter(3, 1), TypeError),
        (lambda node: node.declare_parameter('made', 1, 'a descriptor'), TypeError),
        (lambda node: node.declare_parameter('made', Parameter.Type.NOT_SET), ValueError),
        (lambda node: node.declare_parameter('made', {}), TypeError),
        (lambda node: node.declare_parameters('', [('made', 1, None, 2)]), TypeError),
        (lambda node: node.set_parameters(['made']), TypeError),
        (lambda node: Parameter('made', 'INTEGER', 1), TypeError),
    ],
)
def test_what_cannot_be_a_parameter_is_refused(node, make, error):
    with pytest.raises(error):
        make(node)
    assert not node.has_parameter('made')


def test_a_parameter_declared_by_its_name_alone_is_warned_of(node):
    with pytest.warns(UserWarning, match="'alone'.*only providing its name is deprecated"):
        node.declare_parameter('alone')


def test_a_callback_must_return_a_result(node):
    node.declare_parameter('speed', 1.0)
    node.add_on_set_parameters_callback(lambda parameters: True)
    with pytest.raises((TypeError, AttributeError)):
        node.set_parameters([Parameter('speed', value=2.0)])
