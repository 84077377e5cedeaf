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
import resource
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
import rclpy
import runtimes
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rich.console import Console
from rich.progress import Progress
from soak_account import Account, Check, Counters, account, markdown, supply_account
from soak_devices import SoakDrives, SoakSupply, messages, rows
from stepped_clock import ClockFile
from wattwalk_core.processes import ChildProcess, wait_until

PATIENCE = 120.0  # s
_SHIM = Path(__file__).with_name('stepped_clock.py')
_LEFT = 300_000  # bytes that are left for the recording


class SoakError(Exception):
    """Raised when the soak itself does not work."""


def until(condition: Callable[[], object], what: str) -> None:
    """Wait up to 120 s for a condition; SoakError, which names `what`, at timeout."""
    if not wait_until(condition, PATIENCE):
        raise SoakError(f'{what} never came')


class Diagnostics:
    """The newest figures of each part of each node, from the topic diagnostics."""

    def __init__(self) -> None:
        self.figures: dict[str, dict[str, str]] = {}
        self.heard: dict[str, int] = {}
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node('soak', context=self._context)
        self.node.create_subscription(DiagnosticArray, 'diagnostics', self._take, 100)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _take(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.figures[status.name] = {pair.key: pair.value for pair in status.values}
            self.heard[status.name] = self.heard.get(status.name, 0) + 1

    def fresh(self, name: str) -> dict[str, str]:
        """Wait for diagnostics of a part, published after this call, and return its figures."""
        before = self.heard.get(name, 0)
        until(lambda: self.heard.get(name, 0) >= before + 2, f'diagnostics of {name}')
        return self.figures[name]

    def close(self) -> None:
        """Shut down the node and its ROS context."""
        self._executor.shutdown()
        rclpy.shutdown(context=self._context)


@dataclass
class Take:
    """One recording: its process, and counts of measured samples at its begin and end.

    how: stopped, killed or disk full.
    """

    path: Path
    process: ChildProcess
    begun: dict[str, int]
    ended: dict[str, int]
    how: str = 'stopped'


def _memory_mb(process: ChildProcess) -> float:
    return float(psutil.Process(process.pid).memory_info().rss) / 1e6


class System:
    """Simulated devices, the nodes under test and their recordings."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clock = ClockFile(folder / 'clock')
        self.clock.install()
        self.drives = SoakDrives(folder / 'bus')
        self.supply = SoakSupply()
        self.takes: list[Take] = []
        self.diagnostics = Diagnostics()
        bus = ['-p', 'interface:=unixsocket', '-p', f'channel:={folder}/bus']
        instrument = ['-p', 'host:=127.0.0.1', '-p', f'port:={self.supply.port}']
        self.nodes = {
            'daq': self._start('power_daq.commands.arguments:daq', ['--ros-args', *bus], 'daq'),
            'supply': self._start(
                'power_daq.commands.arguments:supply', ['--ros-args', *instrument], 'supply'
            ),
        }
        self.used: dict[str, tuple[float, float, float]] = {}

    def _start(self, function: str, arguments: Sequence[str], name: str) -> ChildProcess:
        """Start a command on the clock that can be stepped."""
        command = [sys.executable, str(_SHIM), str(self.folder / 'clock'), function, *arguments]
        return ChildProcess(command, self.folder / f'{name}.log')

    def measured(self) -> dict[str, int]:
        """Return the number of samples by stream that the devices have measured so far."""
        return {**self.drives.marks(), 'supply': self.supply.measured}

    def record(self) -> None:
        """Start a recorder, and wait until it is ready."""
        name = f'bag_{len(self.takes) + 1}'
        path = self.folder / name
        process = self._start('power_daq.commands.arguments:record', ['-o', str(path)], name)
        process.wait_for_line('recording to', PATIENCE)
        now = self.measured()
        self.takes.append(Take(path, process, now, now))

    def stop_recording(self, how: str = 'stopped') -> None:
        """End the recorder; how: stopped (by SIGINT), killed, or disk full (waits for its end)."""
        take = self.takes[-1]
        take.how = how
        if how == 'disk full':
            until(lambda: not take.process.running, 'the end of a recorder whose disk is full')
        take.ended = self.measured()
        if how != 'disk full':
            take.process.end(PATIENCE, () if how == 'killed' else (signal.SIGINT,))

    def matched(self) -> bool:
        """True if recorder, DAQ and supply have discovered each other, as this node sees it."""
        node = self.diagnostics.node
        streams = ('drive_supply', 'joint_states', 'supply')
        return all(node.count_publishers(t) and node.count_subscribers(t) for t in streams)

    def mark(self) -> None:
        """Start the measurement of CPU time and memory that `usage` returns."""
        now = time.monotonic()
        self.used = {n: (now, p.cpu_seconds(), _memory_mb(p)) for n, p in self.nodes.items()}

    def usage(self) -> dict[str, dict[str, float]]:
        """Return CPU in % of a core, memory and its growth in MB since `mark`, by node."""
        now = time.monotonic()
        return {
            name: {
                'cpu_percent': 100.0 * (self.nodes[name].cpu_seconds() - cpu) / (now - since),
                'memory_mb': _memory_mb(self.nodes[name]),
                'memory_grown_mb': _memory_mb(self.nodes[name]) - memory,
            }
            for name, (since, cpu, memory) in self.used.items()
        }

    def close(self) -> None:
        """End all processes and devices."""
        for process in [*(take.process for take in self.takes), *self.nodes.values()]:
            if process.running:
                process.end(PATIENCE)
        self.drives.close()
        self.supply.unplug()
        self.diagnostics.close()


Event = tuple[float, str, Callable[[], None]]
_CYCLE = 300.0  # s
_SETTLE = 2.0  # s after discovery


class Soak:
    """Runs the cycles of faults and keeps a list of what was done when.

    seconds: in all, without the time that actions take, such as the start of a recorder.
    """

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder, self.seconds = folder, seconds
        self.system = System(folder)
        self.done: list[tuple[float, str]] = []
        self.checks: list[Check] = []

    def run(self, advance: Callable[[float], None]) -> None:
        """Run all cycles; advance: is called with the s that have passed. May raise SoakError."""
        system = self.system
        system.record()
        if not system.drives.wait_for_listener(PATIENCE):
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
        # Its file may grow by _LEFT more, as on a full disk.
        size = next(take.path.glob('*.mcap')).stat().st_size + _LEFT
        resource.prlimit(take.process.pid, resource.RLIMIT_FSIZE, (size, size))
        self.system.stop_recording('disk full')
        held = re.search(r'(?:holds all|The) (\d+) messages', take.process.output)
        told = int(held[1]) if held else -1
        name = f'{take.path.name}: messages = what the recorder said'
        self.checks.append(Check(name, messages(take.path), told))

    def accounts(self) -> list[Account]:
        """Return the account of each stream; call it while the nodes still run."""
        system = self.system
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
    """Run a soak, print and write its account; return whether all sums close."""
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
    """Run a soak; return 1 if a sum does not close, else 0."""
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
