"""The state of a bring-up's nodes: a live table in a terminal, else the lines of their logs."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.live import Live
from rich.table import Table
from rich.text import Text
from wattwalk_core.console import output

from wattwalk_bringup.node_group import RunningNode


class PlainDisplay:
    """A line for each line of a log and each change of a state, after the name of the node."""

    def __init__(self) -> None:
        self._states: dict[str, str] = {}

    def show(self, nodes: Sequence[RunningNode]) -> None:
        """Print what is new."""
        for node in nodes:
            for line in node.update():
                print(f'{node.name}: {line}', flush=True)
            if self._states.get(node.name) != node.state:
                self._states[node.name] = node.state
                print(f'{node.name}: {node.state}', flush=True)


class TableDisplay:
    """A table of node, state, time in it, share of a core and last line of the log."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def show(self, nodes: Sequence[RunningNode]) -> None:
        """Draw the table anew."""
        for node in nodes:
            node.update()
        self._live.update(_table(nodes))


def _table(nodes: Sequence[RunningNode]) -> Table:
    table = Table(box=SIMPLE_HEAD, expand=True)
    for title in ('node', 'state'):
        table.add_column(title, no_wrap=True)
    for title in ('since', 'CPU'):
        table.add_column(title, justify='right', no_wrap=True)
    table.add_column('last line', no_wrap=True, overflow='ellipsis', ratio=1)
    now = time.monotonic()
    for node in nodes:
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
def display() -> Iterator[PlainDisplay | TableDisplay]:
    """Return the display for stdout."""
    console = output()
    if not console.is_terminal:
        yield PlainDisplay()
        return
    with Live(console=console, refresh_per_second=4) as live:
        yield TableDisplay(live)
