"""`ros2 node list | info`."""

import argparse
from collections.abc import Sequence

from ros2cli.main import CommandError
from ros2cli.verbs import Verbs, direct_node, discover


def _full(name: str, namespace: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'


def _list(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node, options.spin_time)
        nodes = node.context.graph.participants()
    found = [_full(one.name, one.namespace) for one in nodes]
    names = sorted(name for name in found if options.all or '/_' not in name)
    if options.count_nodes:
        print(len(names))
    for name in [] if options.count_nodes else names:
        print(name)


def _info(options: argparse.Namespace) -> None:
    with direct_node() as node:
        discover(node, options.spin_time)
        graph = node.context.graph
        wanted = options.node if options.node.startswith('/') else f'/{options.node}'
        found = [n for n in graph.participants() if _full(n.name, n.namespace) == wanted]
        if not found:
            raise CommandError(f"Unable to find node '{wanted}'")
        gids = {gid for one in found for gid in (*one.readers, *one.writers)}
        readers = [e for e in graph.endpoints('reader') if e.gid in gids]
        writers = [e for e in graph.endpoints('writer') if e.gid in gids]
    print(wanted)
    for title, ends, kind in (
        ('Subscribers', readers, 'topic'),
        ('Publishers', writers, 'topic'),
        ('Service Servers', readers, 'request'),
        ('Service Clients', writers, 'request'),
    ):
        print(f'  {title}:')
        for name, type_name in sorted((e.name, e.type_name) for e in ends if e.kind == kind):
            print(f'    {name}: {type_name}')


def main(argv: Sequence[str]) -> int:
    """Run a verb of `ros2 node` and return its exit code."""
    verbs = Verbs('node', 'Nodes of the domain.')
    verb = verbs.add('list', _list, 'List nodes.', 'ros2 node list', spin_time=True)
    verb.add_argument('-a', '--all', action='store_true', help='show hidden nodes as well')
    verb.add_argument('-c', '--count-nodes', action='store_true', help='show their number only')
    verb = verbs.add(
        'info', _info, 'Show what a node has.', 'ros2 node info /daq', 'node', spin_time=True
    )
    return verbs.run(argv)
