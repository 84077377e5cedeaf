"""`ros2 run wattwalk_bringup live`: all nodes of a measured robot in one terminal."""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

from wattwalk_core.errors import printable
from wattwalk_core.interruption import DeferredSignals

from wattwalk_bringup.display import display
from wattwalk_bringup.node_group import started
from wattwalk_bringup.node_set import commands
from wattwalk_bringup.settings import BringupSettings

_PERIOD = 0.25  # s


def run(options: argparse.Namespace) -> int:
    """Run all nodes until Ctrl-C, the end of the duration or of a node; 1 if one failed."""
    given = {name: text for name, text in vars(options).items() if text is not None}
    settings = BringupSettings.load(given.pop('config')).changed(given)
    return _run(settings)


def _run(settings: BringupSettings) -> int:
    wanted = commands(settings)
    folder = Path(tempfile.mkdtemp(prefix='wattwalk_live_'))
    # The recorder counts its own duration.
    limit = settings.duration if settings.duration and not settings.record_counts else 0.0
    with DeferredSignals() as signals, started(wanted, folder) as group:
        begin = time.monotonic()
        with display() as shown:
            while signals.received is None and group.ended is None:
                shown.show(group.nodes)
                if limit and time.monotonic() - begin >= limit:
                    break
                time.sleep(_PERIOD)
            first = group.ended
            failures = group.failures()
            group.end(lambda: shown.show(group.nodes))
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
