"""Namespaces of nodes, before ROS sees them."""

import pytest
import rclpy
from wattwalk_core.errors import InputError
from wattwalk_core.namespace import absolute_namespace
from wattwalk_core.nodes.running import run_node


@pytest.mark.parametrize('text', ['/', 'robot_1', '/robot_1', '/lab/robot_1'])
def test_a_namespace_is_made_absolute(text):
    assert absolute_namespace(text) == f'/{text.lstrip("/")}'


@pytest.mark.parametrize('text', ['', 'bad-ns', '/a//b', '/a/', '/9', 'ä', 'a b'])
def test_a_namespace_that_ros_refuses_is_quoted(text):
    with pytest.raises(InputError, match=r'namespace .*expected letters, digits and _') as error:
        absolute_namespace(text)
    assert repr(text) in str(error.value)


def test_a_node_in_a_namespace_that_ros_refuses_is_not_made():
    with pytest.raises(InputError, match='bad-ns'):
        run_node(lambda: pytest.fail('made'), ['--ros-args', '-r', '__ns:=bad-ns'])
    assert not rclpy.ok()
