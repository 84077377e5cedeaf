"""Half an hour of acquisition at full rate with faults, and an account of every sample.

12 drives at 1 kHz and 400 Hz over the Unix-socket bus, a bench supply at 100 Hz over TCP, DAQ,
supply node and recorder as processes on DDS. Once a cycle: the system clock is stepped forward
and back, the bus goes off and on, the recorder is killed hard, the supply is unplugged, the disk
fills up. Every sample carries a number: those that are in no bag are listed by reason. The account
closes if none is missing inside of a bag but those that a node counted, and if none of the ends of
a bag costs more than it may.

    python bench/soak.py                       30 minutes, six cycles
    python bench/soak.py --seconds 60 -o soak  one minute, one cycle
"""

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import runtimes
from rich.console import Console
from rich.progress import Progress
from soak_account import Account, Check, Counters, account, markdown, supply_account
from soak_devices import messages, rows
from soak_system import SoakError, System, fill_disk, until

Event = tuple[float, str, Callable[[], None]]
_CYCLE = 300.0  # s
_SETTLE = 2.0  # s after discovery


class Soak:
    """Runs the cycles and remembers what was done when.

    What an action takes, such as the start of a recorder, comes on top of the seconds.
    """

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder, self.seconds = folder, seconds
        self.system = System(folder)
        self.done: list[tuple[float, str]] = []
        self.checks: list[Check] = []

    def run(self, advance: Callable[[float], None]) -> None:
        """Do it all; advance is told the s that have passed."""
        system = self.system
        system.record()
        listens = system.drives.wait_for_listener(120.0)
        if not listens:
            raise SoakError('the DAQ never opened the bus')
        until(system.matched, 'discovery')
        time.sleep(_SETTLE)
        system.drives.start()
        system.mark()
        began = time.monotonic()
        for at, what, action in self._plan():
            began += self._sleep(began + at, began, advance)
            before = time.monotonic()
            self.done.append((before - began, what))
            action()
            began += time.monotonic() - before
        self._sleep(began + self.seconds, began, advance)
        system.drives.stop()
        advance(self.seconds)

    @staticmethod
    def _sleep(until: float, began: float, advance: Callable[[float], None]) -> float:
        """Sleep until a time; what it took longer is given back, for faults to last as planned."""
        while (now := time.monotonic()) < until:
            advance(now - began)
            time.sleep(min(0.2, until - now))
        return max(now - until, 0.0)

    def _plan(self) -> list[Event]:
        cycles = max(1, round(self.seconds / _CYCLE))
        length = self.seconds / cycles
        plan: list[Event] = []
        s = self.system
        for cycle in range(cycles):
            start = cycle * length
            plan += [
                (start + 0.08 * length, 'clock +1.5 s', lambda: s.clock.step(1.5)),
                (start + 0.16 * length, 'bus off', lambda: s.drives.switch(False)),
                (start + 0.21 * length, 'bus on', lambda: s.drives.switch(True)),
                (start + 0.30 * length, 'recorder killed', lambda: s.stop_recording('killed')),
                (start + 0.33 * length, 'recorder started', s.record),
                (start + 0.44 * length, 'supply unplugged', s.supply.unplug),
                (start + 0.50 * length, 'supply plugged in', s.supply.plug),
                (start + 0.56 * length, 'clock -0.7 s', lambda: s.clock.step(-0.7)),
                (start + 0.62 * length, 'recorder stopped', s.stop_recording),
                (start + 0.63 * length, 'recorder started', s.record),
                (start + 0.70 * length, 'disk filled', self._fill),
                (start + 0.80 * length, 'recorder started', s.record),
                (start + 0.88 * length, 'clock +0.02 s', lambda: s.clock.step(0.02)),
                (start + 0.94 * length, 'clock -0.02 s', lambda: s.clock.step(-0.02)),
            ]
        return plan

    def _fill(self) -> None:
        take = self.system.takes[-1]
        fill_disk(take)
        self.system.stop_recording('disk full')
        held = re.search(r'(?:holds all|The) (\d+) messages', take.process.output)
        told = int(held[1]) if held else -1
        name = f'{take.path.name}: messages = what the recorder said'
        self.checks.append(Check(name, messages(take.path), told))

    def accounts(self) -> list[Account]:
        """Account of every sample; the nodes have to run yet."""
        system = self.system
        daq = system.diagnostics.fresh('power_daq: bus')
        until(lambda: system.diagnostics.fresh('power_daq: bus')['samples waiting'] == '0', 'calm')
        daq = system.diagnostics.fresh('power_daq: bus')
        system.supply.unplug()
        supply = system.diagnostics.fresh('supply: instrument')
        system.stop_recording()
        bags = [
            rows(take.path, take.begun, take.ended, take.how, take.process.output)
            for take in system.takes
        ]
        found = []
        for name, kept in system.drives.kept.items():
            figures = ('samples', 'lost', 'unsettled', 'dropped unpublished', 'published')
            counters = Counters(*(int(daq[f'{name} {figure}']) for figure in figures))
            own = [bag[name] for bag in bags]
            found.append(account(name, kept.times, kept.withheld, counters, own))
        excuses = int(supply['connections lost']) + int(supply['not an answer'])
        own = [bag['supply'] for bag in bags]
        readings = int(supply['readings'])
        found.append(supply_account(system.supply.times, readings, excuses, own))
        found[0].checks += self.checks
        self.figures = {'daq': daq, 'supply': supply}
        return found


def run(seconds: float, folder: Path, output: Path | None, console: Console) -> bool:
    """Run a soak, print and write its account; whether all sums close."""
    with runtimes.reserved() as domain, Progress(console=console) as progress:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        task = progress.add_task(f'soak of {seconds:.0f} s', total=seconds)
        soak = Soak(folder, seconds)
        try:
            soak.run(lambda passed: progress.update(task, completed=passed))
            progress.update(task, description='accounting')
            usage = soak.system.usage()
            found = soak.accounts()
        finally:
            soak.system.close()
    text = markdown(found)
    console.print(text, markup=False, highlight=False, soft_wrap=True)
    closes = all(one.closes for one in found)
    content = {
        'seconds': seconds,
        'closes': closes,
        'events': [{'at': round(at, 2), 'what': what} for at, what in soak.done],
        'latest_sending_s': round(soak.system.drives.latest, 4),
        'streams': {one.stream: one.content() for one in found},
        'usage': usage,
        'nodes': soak.figures,
        'bags': [
            {
                'name': take.path.name,
                'ended': take.how,
                'said': take.process.output.splitlines()[-8:],
            }
            for take in soak.system.takes
        ],
    }
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        (output / 'soak.json').write_text(json.dumps(content, indent=1, ensure_ascii=False))
        (output / 'soak.md').write_text(text)
        console.print(f'wrote {output}/soak.json and soak.md')
    console.print('every sample is accounted for' if closes else 'THE ACCOUNT DOES NOT CLOSE')
    return closes


def main(args: list[str] | None = None) -> int:
    """Run it; 1 if a sum does not close."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--seconds', type=float, default=1800.0)
    parser.add_argument('-o', '--output', type=Path, help='folder for soak.json and soak.md')
    parser.add_argument('--keep', type=Path, help='folder for the bags, which are else deleted')
    options = parser.parse_args(args)
    if options.seconds < 30.0:
        parser.error(f'--seconds is {options.seconds:g}; the faults need 30 at least')
    console = Console()
    if options.keep is not None:
        options.keep.mkdir(parents=True)
        return 0 if run(options.seconds, options.keep, options.output, console) else 1
    with tempfile.TemporaryDirectory(prefix='wattwalk_soak') as folder:
        return 0 if run(options.seconds, Path(folder), options.output, console) else 1


if __name__ == '__main__':
    sys.exit(main())
