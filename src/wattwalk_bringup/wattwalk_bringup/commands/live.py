"""`ros2 run wattwalk_bringup live`: all nodes of a measured robot in one terminal."""

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.live import Live
from rich.table import Table
from rich.text import Text
from wattwalk_core.command import DeferredSignals
from wattwalk_core.console import output
from wattwalk_core.errors import printable

from wattwalk_bringup.node_group import NodeGroup, RunningNode
from wattwalk_bringup.node_set import commands
from wattwalk_bringup.settings import BringupSettings, as_text


def print_news(states: dict[str, str], nodes: Sequence[RunningNode]) -> None:
    """Update nodes and print new log lines and changes of state, each after the node's name."""
    for node in nodes:
        for line in node.update():
            print(f'{node.name}: {line}', flush=True)
        if states.get(node.name) != node.state:
            states[node.name] = node.state
            print(f'{node.name}: {node.state}', flush=True)


def node_table(nodes: Sequence[RunningNode]) -> Table:
    """Update nodes; return a table of state, time in it, share of a core and last line of each."""
    table = Table(box=SIMPLE_HEAD, expand=True)
    for title in ('node', 'state'):
        table.add_column(title, no_wrap=True)
    for title in ('since', 'CPU'):
        table.add_column(title, justify='right', no_wrap=True)
    table.add_column('last line', no_wrap=True, overflow='ellipsis', ratio=1)
    now = time.monotonic()
    for node in nodes:
        node.update()
        style = 'red' if node.state.startswith('failed') else ''
        last = ''.join(c if c.isprintable() else ' ' for c in node.log.last)
        table.add_row(
            node.name,
            Text(node.state, style),
            f'{now - node.since:.0f} s',
            f'{node.cpu_share:.0%}',
            Text(last, 'yellow' if last.startswith(('warn', 'error', 'fatal')) else ''),
        )
    return table


@contextmanager
def display() -> Iterator[Callable[[Sequence[RunningNode]], None]]:
    """Yield a function that updates nodes and shows them, in a table where it is a terminal."""
    console = output()
    if not console.is_terminal:
        yield partial(print_news, {})
        return
    with Live(console=console, refresh_per_second=4) as live:
        yield lambda nodes: live.update(node_table(nodes))


_PERIOD = 0.25  # s


def run(options: argparse.Namespace) -> int:
    """Run all nodes until Ctrl-C, the end of the duration or of a node; 1 if one failed."""
    given = {name: as_text(own) for name, own in vars(options).items() if own is not None}
    settings = BringupSettings.load(given.pop('config')).changed(given)
    wanted = commands(settings)
    folder = Path(tempfile.mkdtemp(prefix='wattwalk_live_'))
    # The recorder counts its own duration.
    limit = settings.duration if settings.duration and not settings.record_counts else 0.0
    with DeferredSignals() as signals, NodeGroup(wanted, folder) as group:
        begin = time.monotonic()
        with display() as show:
            while signals.received is None and group.ended is None:
                show(group.nodes)
                if limit and time.monotonic() - begin >= limit:
                    break
                time.sleep(_PERIOD)
            first = group.ended
            failures = group.failures()
            group.end(partial(show, group.nodes))
        failures += [text for text in group.failures() if text not in failures]
    if first is not None and not failures:
        print(f'{first.name} has ended')
    for text in failures:
        print(printable(f'live: {text}', 1000), file=sys.stderr)
    if failures:
        print(f'live: logs are in {folder}', file=sys.stderr)
        return 1
    if settings.record:
        print(f'next: ros2 run power_recordings info {settings.record}')
    shutil.rmtree(folder)
    return 0
