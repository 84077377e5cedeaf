"""Console output of a discovery."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from wattwalk_core.errors import printable

from power_lab.discover.outcome import DiscoveryOutcome


def print_discovery(console: Console, outcome: DiscoveryOutcome) -> None:
    """Print what was found: a sentence, a line for each effect and drive, then its formulas."""
    console.print(escape(outcome.sentence), style='bold')
    if not outcome.discovery.found:
        return
    table = Table(box=None)
    for name in ('effect', 'kind', 'drive'):
        table.add_column(name, no_wrap=True)
    for name in ('explains', '95 %', 'transfers'):
        table.add_column(name, justify='right', no_wrap=True)
    names = outcome.own.prepared.names
    for one, transfer in zip(outcome.discovery.found, outcome.transfers, strict=True):
        told = None if transfer is None else transfer.transfers
        word = {None: '–', True: 'yes', False: 'no'}[told]
        for place, drive in enumerate(one.drives):
            first = place == 0
            table.add_row(
                escape(one.name) if first else '',
                one.kind if first else '',
                escape(printable(names[drive])),
                f'{max(float(one.gain[drive]), 0.0) ** 0.5:.2f} W',
                f'{one.interval[0]:.2f}–{one.interval[1]:.2f} W' if first else '',
                word if first else '',
            )
    console.print(table)
    for one in outcome.discovery.found:
        for drive in one.drives if one.formula is not None else ():
            assert one.formula is not None
            formula = printable(one.formula.text(drive))
            console.print(escape(f'{one.name} on {printable(names[drive])}: {formula}'))
