"""Console output of tracking."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from wattwalk_core.quoting import printable

from power_fleet.track.outcome import Tracked


def print_tracked(console: Console, found: Tracked) -> None:
    """Print alarms, what circumstances explain, and the certain changes as a table."""
    for text in found.alarms or [found.sentence]:
        console.print(escape(text), style='bold')
    for text in found.explained:
        console.print(escape(text))
    for text in found.left_out:
        console.print(escape(printable(f'left out: {text}')), style='dim')
    if not found.result.findings:
        return
    table = Table(box=None)
    for name in ('drive', 'effect', 'change', 'since'):
        table.add_column(name, overflow='fold')
    for name in ('from', 'to', 'W', 'certainty'):
        table.add_column(name, justify='right')
    for finding in found.result.findings:
        change, history = finding.change, found.histories[finding.drive]
        begin, end = found.ends(finding.drive, change)
        profile = change.profile
        at = history.recordings[profile.end if profile.step else profile.begin]
        table.add_row(
            escape(printable(history.drive)),
            change.hypothesis,
            'step' if profile.step else 'drift',
            escape(printable(at)),
            f'{begin:.4g}',
            f'{end:.4g}',
            f'{found.watts(finding.drive, change):+.2f}',
            f'{finding.certainty:.3f}',
        )
    console.print(table)
