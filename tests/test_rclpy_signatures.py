"""
rclpy has what the nodes ask of it, with the signatures that they use.

The same tests run on ROS 2 and on the embedded runtime.
"""

import ast
import importlib
import inspect
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

SOURCES = Path(__file__).resolve().parents[1] / 'src'
ROS_FILES = sorted(
    path
    for path in SOURCES.glob('*/[a-z]*/**/*.py')
    if 'test' not in path.parts and 'rclpy' in path.read_text(encoding='utf-8')
)
NODE_FILES = [path for path in ROS_FILES if '(Node):' in path.read_text(encoding='utf-8')]
BEHAVIOUR = [
    Path(__file__).with_name(f'test_rclpy_{part}.py') for part in ('conformance', 'parameters')
]

CALLS = {
    'rclpy:init': [{'args': []}, {'args': [], 'signal_handler_options': None}],
    'rclpy:spin': [('node',)],
    'rclpy:spin_until_future_complete': [('node', 'future')],
    'rclpy:try_shutdown': [{}],
    'rclpy:shutdown': [{'context': None}],
    'rclpy.node:Node': [('name',), {'node_name': 'name', 'context': None, 'namespace': ''}],
    'rclpy.node:Node.get_namespace': [('self',)],
    'rclpy.node:Node.declare_parameter': [('self', 'name', 1.0, 'descriptor')],
    'rclpy.node:Node.get_parameter': [('self', 'name')],
    'rclpy.node:Node.create_publisher': [('self', 'type', 'topic', 'qos')],
    'rclpy.node:Node.create_subscription': [
        ('self', 'type', 'topic', 'callback', 'qos'),
        ('self', 'type', 'topic', 'callback', 'qos', {'raw': True, 'event_callbacks': None}),
    ],
    'rclpy.node:Node.destroy_subscription': [('self', 'subscription')],
    'rclpy.node:Node.create_timer': [('self', 1.0, 'callback', {'clock': None})],
    'rclpy.node:Node.create_service': [('self', 'type', 'name', 'callback')],
    'rclpy.node:Node.destroy_timer': [('self', 'timer')],
    'rclpy.node:Node.add_on_set_parameters_callback': [('self', 'callback')],
    'rclpy.node:Node.count_publishers': [('self', 'topic')],
    'rclpy.node:Node.get_topic_names_and_types': [('self',)],
    'rclpy.node:Node.resolve_topic_name': [('self', 'topic')],
    'rclpy.node:Node.get_name': [('self',)],
    'rclpy.node:Node.get_clock': [('self',)],
    'rclpy.node:Node.get_logger': [('self',)],
    'rclpy.node:Node.destroy_node': [('self',)],
    'rclpy.context:Context.ok': [('self',)],
    'rclpy.context:Context.try_shutdown': [('self',)],
    'rclpy.clock:Clock': [{'clock_type': None}],
    'rclpy.time:Time': [{'nanoseconds': 1}],
    'rclpy.event_handler:SubscriptionEventCallbacks': [
        {'incompatible_qos': None, 'use_default_callbacks': False}
    ],
    'rclpy.executors:SingleThreadedExecutor': [{}, {'context': None}],
    'rclpy.executors:SingleThreadedExecutor.add_node': [('self', 'node')],
    'rclpy.executors:SingleThreadedExecutor.remove_node': [('self', 'node')],
    'rclpy.executors:SingleThreadedExecutor.create_task': [('self', 'callback')],
    'rclpy.executors:SingleThreadedExecutor.shutdown': [('self',)],
    'rclpy.executors:SingleThreadedExecutor.spin_until_future_complete': [('self', 'future')],
    'rclpy.executors:SingleThreadedExecutor.spin_once': [('self', {'timeout_sec': 0.1})],
    'rclpy.publisher:Publisher.publish': [('self', 'message')],
    'rclpy.publisher:Publisher.wait_for_all_acked': [('self', 'timeout')],
    'rclpy.duration:Duration': [{'seconds': 1.0}],
    'rclpy.task:Future': [{}],
    'rclpy.task:Future.set_result': [('self', 'result')],
    'rclpy.task:Future.done': [('self',)],
    'rclpy.utilities:remove_ros_args': [(['x'],)],
    'rclpy.impl.rcutils_logger:RcutilsLogger.info': [
        ('self', 'text', {'throttle_duration_sec': 10.0})
    ],
}
OPAQUE = {'rclpy.clock:Clock', 'rclpy.qos:QoSProfile'}
"""Made by __new__ or keyword dictionaries, which signatures do not tell of."""


def found(path):
    """The object that 'module:Class.method' names."""
    module, _, names = path.partition(':')
    if module == 'rclpy.impl.rcutils_logger':
        thing = type(rclpy.logging.get_logger('x'))
        names = names.split('.', 1)[1]
    else:
        thing = importlib.import_module(module)
    for name in names.split('.'):
        thing = getattr(thing, name)
    return thing


@pytest.mark.parametrize('path', sorted(CALLS))
def test_functions_take_the_arguments_that_nodes_give(path):
    signature = inspect.signature(found(path))
    for call in CALLS[path]:
        keywords = call if isinstance(call, dict) else {}
        arguments = [] if isinstance(call, dict) else list(call)
        if arguments and isinstance(arguments[-1], dict):
            keywords = arguments.pop()
        if path not in OPAQUE:
            signature.bind(*arguments, **keywords)


def asked_of_rclpy(path):
    """Names that a file imports from rclpy, takes from it, or that Node has, as in CALLS."""
    public = {name for name in dir(Node) if not name.startswith('_')}
    names = set()
    for part in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(part, ast.ImportFrom) and (part.module or '').split('.')[0] == 'rclpy':
            names |= {f'{part.module}:{alias.name}' for alias in part.names}
        if isinstance(part, ast.Attribute):
            of_rclpy = isinstance(part.value, ast.Name) and part.value.id == 'rclpy'
            names |= {f'rclpy:{part.attr}'} if of_rclpy else set()
            names |= {f'rclpy.node:Node.{part.attr}'} if part.attr in public else set()
    return names


@pytest.mark.parametrize('path', ROS_FILES, ids=lambda path: path.stem)
def test_what_a_node_asks_of_rclpy_is_tested_here(path):
    listed = set(CALLS) | {key.rpartition('.')[0] for key in CALLS if '.' in key.split(':')[1]}
    assert asked_of_rclpy(path) <= listed.union(*map(asked_of_rclpy, BEHAVIOUR))


def own_names(path):
    """Attributes that the node classes of a file give themselves."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    nodes = [
        part
        for part in tree.body
        if isinstance(part, ast.ClassDef)
        and any(isinstance(base, ast.Name) and base.id == 'Node' for base in part.bases)
    ]
    names = set()
    for part in (inner for node in nodes for inner in ast.walk(node)):
        if isinstance(part, ast.FunctionDef):
            names.add(part.name)
        targets = part.targets if isinstance(part, ast.Assign) else []
        targets = [part.target] if isinstance(part, ast.AnnAssign) else targets
        for target in (leaf for given in targets for leaf in ast.walk(given)):
            if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name):
                names |= {target.attr} if target.value.id == 'self' else set()
    return {name for name in names if not name.startswith('__')}


@pytest.mark.parametrize('path', NODE_FILES, ids=lambda path: f'{path.parts[-3]}-{path.stem}')
def test_no_node_overwrites_what_its_base_class_keeps_for_itself(node, path):
    names = own_names(path)
    assert names, f'{path} has no class of Node'
    assert names.isdisjoint(dir(node))


def test_there_are_nodes_to_check():
    assert {path.stem for path in NODE_FILES} >= {'daq', 'recorder', 'run', 'motion', 'node'}
