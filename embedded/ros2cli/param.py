"""`ros2 param list | get | set | describe | dump | load`."""

import argparse
from collections.abc import Sequence
from typing import Any

import yaml

from ros2cli.main import CommandError
from ros2cli.service import request
from ros2cli.verbs import Verbs, direct_node, discover

TIMEOUT = 5.0


def _absolute(node: str) -> str:
    return node if node.startswith('/') else f'/{node}'


def _ask(node: Any, target: str, verb: str, **fields: Any) -> Any:
    import rcl_interfaces.srv as services  # slow to import

    name = ''.join(part.capitalize() for part in verb.split('_'))
    service_type = getattr(services, name)
    absolute = _absolute(target)
    try:
        return request(
            node, service_type, f'{absolute}/{verb}', service_type.Request(**fields), TIMEOUT
        )
    except CommandError as error:
        raise CommandError(f"Node not found or silent: '{absolute}' ({error})") from None


def _names(node: Any, target: str) -> list[str]:
    return sorted(_ask(node, target, 'list_parameters').result.names)


def _values(node: Any, target: str, names: list[str]) -> list[Any]:
    from rclpy.parameter import parameter_value_to_python  # slow to import

    values = _ask(node, target, 'get_parameters', names=names).values
    return [parameter_value_to_python(value) for value in values]


def _list(options: argparse.Namespace) -> None:
    with direct_node() as node:
        if options.node is not None:
            for name in _names(node, options.node):
                print(f'  {name}')
            return
        discover(node, options.spin_time)
        suffix = '/list_parameters'
        services = [name for name, _ in node.get_service_names_and_types()]
        for target in sorted(s.removesuffix(suffix) for s in services if s.endswith(suffix)):
            print(f'{target}:')
            for name in _names(node, target):
                print(f'  {name}')


LABELS = {
    bool: 'Boolean value is:',
    int: 'Integer value is:',
    float: 'Double value is:',
    str: 'String value is:',
}


def _get(options: argparse.Namespace) -> None:
    with direct_node() as node:
        values = _values(node, options.node, [options.name])
    if not values:
        raise CommandError(f"Parameter not set: '{options.name}' of '{options.node}'")
    value = values[0]
    if options.hide_type:
        print(value)
    elif value is None:
        print('Parameter not set.')
    else:
        print(LABELS.get(type(value), 'Values are:'), value)


def _set(options: argparse.Namespace) -> int:
    return _set_all(options.node, {options.name: options.value})


def _set_all(target: str, values: dict[str, str]) -> int:
    from rcl_interfaces.msg import Parameter  # slow to import
    from rclpy.parameter import get_parameter_value

    parameters = [Parameter(name=n, value=get_parameter_value(v)) for n, v in values.items()]
    with direct_node() as node:
        results = _ask(node, target, 'set_parameters', parameters=parameters).results
    failed = 0
    for name, result in zip(values, results, strict=True):
        label = '' if len(values) == 1 else f'{name}: '
        if result.successful:
            reason = f': {result.reason}' if result.reason else ''
            print(f'{label}Set parameter successful{reason}')
        else:
            failed = 1
            print(f'{label}Setting parameter failed: {result.reason}')
    return failed


def _describe(options: argparse.Namespace) -> None:
    from rclpy.parameter import Parameter  # slow to import

    with direct_node() as node:
        found = _ask(node, options.node, 'describe_parameters', names=options.names).descriptors
    for descriptor in found:
        if not descriptor.name:
            raise CommandError(f"'{options.node}' lacks one of: {', '.join(options.names)}")
        print(f'Parameter name: {descriptor.name}')
        print(f'  Type: {Parameter.Type(descriptor.type).name.lower().replace("_", " ")}')
        if descriptor.description:
            print(f'  Description: {descriptor.description}')
        print('  Constraints:')
        if descriptor.read_only:
            print('    Read only: true')
        for limits in (*descriptor.integer_range, *descriptor.floating_point_range):
            print(f'    Min value: {limits.from_value}\n    Max value: {limits.to_value}')
            if limits.step:
                print(f'    Step: {limits.step}')
        if descriptor.additional_constraints:
            print(f'    Additional constraints: {descriptor.additional_constraints}')


def _dump(options: argparse.Namespace) -> None:
    with direct_node() as node:
        names = _names(node, options.node)
        values = _values(node, options.node, names)
    tree: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        *parents, last = name.split('.')
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[last] = value
    whole = {_absolute(options.node): {'ros__parameters': tree}}
    print(yaml.safe_dump(whole, sort_keys=True), end='')


def _load(options: argparse.Namespace) -> int:
    from rclpy._rclpy_pybind11 import RCLInvalidROSArgsError  # slow to import
    from rclpy.impl.arguments import RosArguments, parameters_of

    absolute = _absolute(options.node)
    try:
        entries = parameters_of(options.file)
    except RCLInvalidROSArgsError as error:
        raise CommandError(str(error)) from None
    values = RosArguments(parameters=entries).overrides(absolute)
    if not values:
        raise CommandError(f"'{options.file}' has no parameters for '{absolute}'")
    return _set_all(absolute, {name: yaml.safe_dump(v).strip() for name, v in values.items()})


def main(argv: Sequence[str]) -> int:
    """Run a verb of `ros2 param` and return its exit code."""
    verbs = Verbs('param', 'Parameters of nodes.')
    verb = verbs.add('list', _list, 'List parameters.', 'ros2 param list /daq', spin_time=True)
    verb.add_argument('node', nargs='?', help='node (default: all)')
    example = 'ros2 param get /daq samples_per_message'
    verb = verbs.add('get', _get, 'Show a value.', example, 'node', 'name')
    verb.add_argument('--hide-type', action='store_true')
    example = 'ros2 param set /sim real_time_factor 0.5'
    verbs.add('set', _set, 'Set a value.', example, 'node', 'name', 'value')
    example = 'ros2 param describe /daq bus'
    verb = verbs.add('describe', _describe, 'Show descriptors.', example, 'node')
    verb.add_argument('names', nargs='+')
    verbs.add('dump', _dump, 'Show all values as YAML.', 'ros2 param dump /daq', 'node')
    example = 'ros2 param load /daq daq.yaml'
    verbs.add('load', _load, 'Set the values of a file.', example, 'node', 'file')
    return verbs.run(argv)
