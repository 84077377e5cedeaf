"""`ros2 service list | type | call`."""

import argparse
from collections.abc import Sequence
from typing import Any

from ros2cli.main import CommandError
from ros2cli.verbs import Verbs, direct_node, discover, fill, parse_values, wait_until


def _list(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node, options.spin_time)
        services = node.get_service_names_and_types()
    for name, types in services:
        if '/_' not in name:
            print(f'{name} [{", ".join(types)}]' if options.show_types else name)


def _type(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node)
        services = dict(node.get_service_names_and_types())
        name = node.resolve_service_name(options.service)
    if name not in services:
        raise CommandError(f"Unknown service '{name}'")
    print('\n'.join(services[name]))


def request(node: Any, service_type: Any, name: str, message: Any, timeout: float) -> Any:
    """Call a service and return its response; CommandError if none comes in `timeout` s."""
    import rclpy  # slow to import

    client = node.create_client(service_type, name)
    if not client.wait_for_service(timeout):
        raise CommandError(f"service '{client.srv_name}' is not available after {timeout:g} s")
    future = client.call_async(message)
    rclpy.spin_until_future_complete(node, future, timeout_sec=timeout)
    if not future.done():
        raise CommandError(f"no response from '{client.srv_name}' within {timeout:g} s")
    node.destroy_client(client)
    return future.result()


def _call(options: argparse.Namespace) -> None:
    from rosidl_runtime_py.utilities import get_service  # slow to import

    try:
        service_type = get_service(options.type)
    except (AttributeError, ModuleNotFoundError, ValueError):
        raise CommandError(f"The service type '{options.type}' is invalid") from None
    message = service_type.Request()
    fill(message, parse_values(options.values))
    with direct_node() as node:
        name = node.resolve_service_name(options.service)
        wait_until(lambda: name in node.context.graph.services(), 1.0)
        print(f'requester: making request: {message!r}\n', flush=True)
        response = request(node, service_type, options.service, message, options.timeout)
        print(f'response:\n{response!r}\n')


def main(argv: Sequence[str]) -> int:
    """Run a verb of `ros2 service` and return its exit code."""
    verbs = Verbs('service', 'Services of the domain.')
    verb = verbs.add('list', _list, 'List services.', 'ros2 service list -t', spin_time=True)
    verb.add_argument('-t', '--show-types', action='store_true', help='show their types')
    example = 'ros2 service type /push'
    verbs.add('type', _type, 'Show the type of a service.', example, 'service')
    example = "ros2 service call /stop std_srvs/srv/SetBool '{data: true}'"
    verb = verbs.add('call', _call, 'Call a service.', example, 'service', 'type')
    verb.add_argument('values', nargs='?', default='{}', help='fields of the request as YAML')
    verb.add_argument('--timeout', type=float, default=10.0, help='give up after [s]')
    return verbs.run(argv)
