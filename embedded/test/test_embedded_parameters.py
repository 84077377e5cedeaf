"""Parameters of a node, declared and set from within."""

import pytest
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
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python


@pytest.mark.parametrize(
    ('value', 'kind'),
    [
        (True, 'BOOL'),
        (3, 'INTEGER'),
        (3.0, 'DOUBLE'),
        ('x', 'STRING'),
        ([True, False], 'BOOL_ARRAY'),
        ([1, 2], 'INTEGER_ARRAY'),
        ([1.0], 'DOUBLE_ARRAY'),
        (['a'], 'STRING_ARRAY'),
        ([b'\x01'], 'BYTE_ARRAY'),
    ],
)
def test_the_type_comes_from_the_default_value_and_survives_the_message(node, value, kind):
    parameter = node.declare_parameter('thing', value)
    assert parameter.type_ is Parameter.Type[kind]
    assert node.get_parameter('thing').value == value
    assert parameter_value_to_python(parameter.get_parameter_value()) == value


def test_undeclared_parameters_raise_with_their_name(node):
    with pytest.raises(ParameterNotDeclaredException, match=r'undeclared parameter.*gian'):
        node.get_parameter('gian')
    with pytest.raises(ParameterNotDeclaredException, match='undeclared'):
        node.set_parameters([Parameter('gian', value=1)])


def test_a_parameter_is_declared_once(node):
    node.declare_parameter('gain', 1.0)
    with pytest.raises(ParameterAlreadyDeclaredException, match='gain'):
        node.declare_parameter('gain', 2.0)


def test_another_type_is_refused(node):
    node.declare_parameter('gain', 1.0)
    (result,) = node.set_parameters([Parameter('gain', value=1)])
    assert not result.successful
    assert result.reason.startswith('Wrong parameter type')
    assert node.get_parameter('gain').value == 1.0


def test_an_override_of_another_type_fails_the_declaration(ros):
    node = Node('other', parameter_overrides=[Parameter('gain', value='loud')])
    with pytest.raises(InvalidParameterTypeException, match="'STRING', expecting type 'DOUBLE'"):
        node.declare_parameter('gain', 1.0)
    node.destroy_node()


def test_overrides_replace_defaults(ros):
    node = Node('other', cli_args=['--ros-args', '-p', 'gain:=2.5', '-p', 'other:names:=[LF, RF]'])
    assert node.declare_parameter('gain', 1.0).value == 2.5
    assert node.declare_parameter('names', ['']).value == ['LF', 'RF']
    assert node.declare_parameter('gains.0', 1.0).value == 1.0
    node.destroy_node()


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('5', 5),
        ('0x10', 16),
        ('-7', -7),
        ('5.', 5.0),
        ('.5', 0.5),
        ('1e3', 1000.0),
        ('-.inf', float('-inf')),
        ('yes', True),
        ('off', False),
        ('"5"', '5'),
        ('5:30', '5:30'),
        ('2024-01-01', '2024-01-01'),
        ('null', 'null'),
        ('a b', 'a b'),
        ('[1, 2]', [1, 2]),
        ('[1.0, 2.0]', [1.0, 2.0]),
        ('[true, off]', [True, False]),
    ],
)
def test_values_on_the_command_line_have_the_types_that_rcl_gives_them(ros, text, value):
    node = Node('other', cli_args=['--ros-args', '-p', f'thing:={text}'])
    parameter = node.declare_parameter('thing', value)
    assert parameter.type_ == Parameter.Type.from_parameter_value(value)
    assert (list(parameter.value) if isinstance(value, list) else parameter.value) == value
    node.destroy_node()


@pytest.mark.parametrize('text', ['', '[1, 2.5]', '{a: 1}', '[1', "'a"])
def test_values_that_are_no_parameter_are_refused(ros, text):
    with pytest.raises(RuntimeError, match='thing'):
        Node('other', cli_args=['--ros-args', '-p', f'thing:={text}'])


@pytest.mark.parametrize(
    ('value', 'accepted'), [(0.0, True), (2.5, True), (10.0, True), (10.1, False), (-0.1, False)]
)
def test_floating_point_ranges_hold_at_their_edges(node, value, accepted):
    limits = FloatingPointRange(from_value=0.0, to_value=10.0)
    node.declare_parameter('gain', 1.0, ParameterDescriptor(floating_point_range=[limits]))
    (result,) = node.set_parameters([Parameter('gain', value=value)])
    assert result.successful == accepted


@pytest.mark.parametrize(('value', 'accepted'), [(0, True), (15, True), (12, False), (101, False)])
def test_integer_ranges_hold_their_step(node, value, accepted):
    limits = IntegerRange(from_value=0, to_value=100, step=5)
    node.declare_parameter('count', 10, ParameterDescriptor(integer_range=[limits]))
    (result,) = node.set_parameters([Parameter('count', value=value)])
    assert result.successful == accepted


def test_a_default_outside_of_its_range_fails_the_declaration(node):
    limits = IntegerRange(from_value=0, to_value=10)
    with pytest.raises(InvalidParameterValueException, match='out of range'):
        node.declare_parameter('count', 11, ParameterDescriptor(integer_range=[limits]))


def test_read_only_parameters_are_declared_with_a_value_and_stay(node):
    node.declare_parameter('device', 'a', ParameterDescriptor(read_only=True))
    (result,) = node.set_parameters([Parameter('device', value='b')])
    assert 'read-only' in result.reason


def test_a_parameter_declared_by_type_has_no_value_until_set(node):
    node.declare_parameter('gain', Parameter.Type.DOUBLE)
    with pytest.raises(ParameterUninitializedException, match='gain'):
        node.get_parameter('gain')
    node.set_parameters([Parameter('gain', value=2.0)])
    assert node.get_parameter('gain').value == 2.0


def test_callbacks_validate(node):
    def validate(parameters):
        good = all(p.value % 2 == 0 for p in parameters if p.name == 'even')
        return SetParametersResult(successful=good, reason='' if good else 'odd')

    node.add_on_set_parameters_callback(validate)
    node.declare_parameter('even', 2)
    refused, accepted = node.set_parameters([Parameter('even', value=v) for v in (3, 4)])
    assert (refused.successful, refused.reason, accepted.successful) == (False, 'odd', True)


def test_parameters_set_atomically_are_set_all_or_none(node):
    node.declare_parameters('', [('a', 1), ('b', 1)])
    result = node.set_parameters_atomically([Parameter('a', value=2), Parameter('b', value='x')])
    assert not result.successful
    assert (node.get_parameter('a').value, node.get_parameter('b').value) == (1, 1)


def test_names_are_listed_by_prefix_and_depth(node):
    node.declare_parameters('filter', [('window', 3), ('taps.first', 1)])
    assert sorted(node.list_parameters(['filter'], 0).names) == [
        'filter.taps.first',
        'filter.window',
    ]
    assert node.list_parameters(['filter'], 1).names == ['filter.window']
    assert {'filter', 'filter.taps'} <= set(node.list_parameters([], 0).prefixes)


def test_values_without_a_parameter_type_raise(node):
    with pytest.raises(TypeError, match='allowed types'):
        node.declare_parameter('thing', {'a': 1})
    with pytest.raises(ValueError, match='PARAMETER_NOT_SET'):
        node.declare_parameters('', [('thing', None, ParameterDescriptor())])
