"""`ros2 topic list | info | echo | hz | pub`."""

import argparse
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import pstdev
from typing import Any

from ros2cli.main import CommandError
from ros2cli.verbs import (
    Verbs,
    direct_node,
    discover,
    field,
    fill,
    parse_values,
    to_yaml,
    wait_until,
)

HIDDEN = '/_'


def _endpoints(node: Any, kind: str, name: str) -> list[Any]:
    ends = node.context.graph.endpoints(kind)
    return [end for end in ends if end.kind == 'topic' and end.name == name]


def _list(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node, options.spin_time)
        topics = {
            name: types
            for name, types in node.get_topic_names_and_types()
            if options.include_hidden_topics or HIDDEN not in name
        }
    if options.count_topics:
        print(len(topics))
        return
    for name, types in topics.items():
        print(f'{name} [{", ".join(types)}]' if options.show_types else name)


def _info(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node, options.spin_time)
        topics = dict(node.get_topic_names_and_types())
        name = node.resolve_topic_name(options.topic)
        if name not in topics:
            raise CommandError(f"Unknown topic '{options.topic}'")
        print(f'Type: {", ".join(topics[name])}\n')
        for label, kind in (('Publisher', 'writer'), ('Subscription', 'reader')):
            ends = _endpoints(node, kind, name)
            print(f'{label} count: {len(ends)}')
            if options.verbose:
                print()
                for end in ends:
                    print(_described(node, end, kind), end='\n\n')


def _described(node: Any, end: Any, kind: str) -> str:
    from rclpy.qos import from_dds  # slow to import

    owner = next(
        (n for n in node.context.graph.participants() if end.gid in (*n.readers, *n.writers)), None
    )
    profile = from_dds(end.qos)
    return '\n'.join(
        (
            f'Node name: {owner.name if owner else "_NODE_NAME_UNKNOWN_"}',
            f'Node namespace: {owner.namespace if owner else "_NODE_NAMESPACE_UNKNOWN_"}',
            f'Topic type: {end.type_name}',
            f'Endpoint type: {"PUBLISHER" if kind == "writer" else "SUBSCRIPTION"}',
            f'GID: {end.gid.hex(".")}',
            'QoS profile:',
            f'  Reliability: {profile.reliability.name}',
            f'  Durability: {profile.durability.name}',
            f'  Liveliness: {profile.liveliness.name}',
        )
    )


def _message_type(node: Any, options: argparse.Namespace, patience: float) -> Any:
    from rosidl_runtime_py.utilities import get_message  # slow to import

    name = node.resolve_topic_name(options.topic)
    given = getattr(options, 'type', None)
    if given is None:
        found = wait_until(lambda: node.context.graph.topics().get(name), patience)
        if not found:
            raise CommandError(
                f"Could not determine the type for the passed topic '{name}': nobody has it"
            )
        if len(found) > 1:
            raise CommandError(f"topic '{name}' has more than one type: {', '.join(found)}")
        given = found[0]
    try:
        return get_message(given)
    except (AttributeError, ModuleNotFoundError, ValueError):
        raise CommandError(f"The message type '{given}' is invalid") from None


def _matching_qos(node: Any, name: str, options: argparse.Namespace) -> Any:
    """Return a profile that fits all publishers there are, unless users ask for another."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, from_dds  # slow

    offered = [from_dds(end.qos) for end in _endpoints(node, 'writer', name)]
    profile = QoSProfile(depth=1000)
    if any(one.reliability == ReliabilityPolicy.BEST_EFFORT for one in offered) or not offered:
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    local = DurabilityPolicy.TRANSIENT_LOCAL
    if offered and all(one.durability == local for one in offered):
        profile.durability = local
    if options.qos_reliability is not None:
        profile.reliability = ReliabilityPolicy[options.qos_reliability.upper()]
    if options.qos_durability is not None:
        profile.durability = DurabilityPolicy[options.qos_durability.upper()]
    return profile


def _listen(
    options: argparse.Namespace, callback: Callable[..., None], raw: bool, patience: float
) -> Any:
    import rclpy  # slow to import
    from rclpy.executors import ExternalShutdownException

    with direct_node() as node:
        message_type = _message_type(node, options, patience)
        name = node.resolve_topic_name(options.topic)
        wait_until(lambda: node.count_publishers(name) > 0, 0.3)
        profile = _matching_qos(node, name, options)
        node.create_subscription(message_type, name, callback, profile, raw=raw)
        done = rclpy.Future()
        options.finish = done.set_result
        end = time.monotonic() + getattr(options, 'timeout', float('inf'))
        try:
            while not done.done():
                rclpy.spin_until_future_complete(node, done, timeout_sec=0.5)
                if time.monotonic() > end and not done.done():
                    raise CommandError(f"no message on '{name}' within {options.timeout:g} s")
        except ExternalShutdownException:
            return


def _echo(options: argparse.Namespace) -> None:
    def show(message: Any) -> None:
        if options.once and getattr(options, 'shown', False):
            return
        chosen = message if options.field is None else field(message, options.field)
        print(repr(message) if options.raw else to_yaml(chosen), flush=True)
        print('---', flush=True)
        options.shown = True
        if options.once:
            options.finish(None)

    _listen(options, show, options.raw, 2.0)


def _hz(options: argparse.Namespace) -> None:
    arrivals: deque[float] = deque(maxlen=options.window)
    last_print = time.monotonic()
    count = 0

    def note(_: bytes) -> None:
        nonlocal last_print, count
        now = time.monotonic()
        arrivals.append(now)
        count += 1
        if now - last_print < 1.0 or len(arrivals) < 2:
            return
        last_print = now
        gaps = [b - a for a, b in pairwise(arrivals)]
        mean = sum(gaps) / len(gaps)
        print(
            f'average rate: {1 / mean:.3f}\n\tmin: {min(gaps):.3f}s max: {max(gaps):.3f}s '
            f'std dev: {pstdev(gaps):.5f}s window: {len(arrivals)}',
            flush=True,
        )

    print(f'subscribed to [{options.topic}]', flush=True)
    _listen(options, note, True, 10**9)


def _pub(options: argparse.Namespace) -> None:
    import rclpy  # slow to import
    from rclpy.executors import ExternalShutdownException

    with direct_node() as node:
        message_type = _message_type(node, options, 0.0)
        message = message_type()
        fill(message, parse_values(options.values))
        publisher = node.create_publisher(message_type, options.topic, 10)
        if options.once:
            while not wait_until(lambda: publisher.get_subscription_count() > 0, 1.0):
                print('Waiting for at least 1 matching subscription...', flush=True)
            publisher.publish(message)
            publisher.wait_for_all_acked()
            return
        node.create_timer(1.0 / options.rate, lambda: publisher.publish(message))
        try:
            rclpy.spin(node)
        except ExternalShutdownException:
            return


def _add_qos(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--qos-reliability', choices=('reliable', 'best_effort'))
    parser.add_argument('--qos-durability', choices=('volatile', 'transient_local'))


def main(argv: Sequence[str]) -> int:
    """Run a verb of `ros2 topic` and return its exit code."""
    verbs = Verbs('topic', 'Topics of the domain.')
    verb = verbs.add('list', _list, 'List topics.', 'ros2 topic list -t', spin_time=True)
    verb.add_argument('-t', '--show-types', action='store_true', help='show their types')
    verb.add_argument('-c', '--count-topics', action='store_true', help='show their number only')
    verb.add_argument('--include-hidden-topics', action='store_true')
    verb = verbs.add(
        'info', _info, 'Show a topic.', 'ros2 topic info -v /joint_states', 'topic', spin_time=True
    )
    verb.add_argument('-v', '--verbose', action='store_true', help='show its endpoints')
    verb = verbs.add('echo', _echo, 'Print messages.', 'ros2 topic echo --once /supply', 'topic')
    verb.add_argument('type', nargs='?', help='message type (default: that of the topic)')
    verb.add_argument('--once', action='store_true', help='print one message and exit')
    verb.add_argument('--field', help='print this field only, for example header.stamp')
    verb.add_argument('--raw', action='store_true', help='print the bytes')
    verb.add_argument('--timeout', type=float, default=float('inf'), help='exit with 1 after [s]')
    _add_qos(verb)
    example = 'ros2 topic hz /drive_supply'
    verb = verbs.add('hz', _hz, 'Print the rate of messages.', example, 'topic')
    verb.add_argument('-w', '--window', type=int, default=10_000, help='messages to average over')
    _add_qos(verb)
    example = "ros2 topic pub --once /a std_msgs/msg/String '{data: b}'"
    verb = verbs.add('pub', _pub, 'Publish a message.', example, 'topic', 'type')
    verb.add_argument('values', nargs='?', default='{}', help='fields as YAML')
    verb.add_argument('-r', '--rate', type=float, default=1.0, help='messages per second')
    verb.add_argument(
        '-1', '--once', action='store_true', help='wait for a subscription, publish one, exit'
    )
    return verbs.run(argv)
