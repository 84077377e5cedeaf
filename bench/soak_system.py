"""The processes of a soak: DAQ, supply node and recorders, on one clock that can be stepped."""

import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from soak_devices import SoakDrives, SoakSupply
from stepped_clock import ClockFile
from wattwalk_core.processes import ChildProcess, wait_until

PATIENCE = 120.0  # s
_SHIM = Path(__file__).with_name('stepped_clock.py')
_LEFT = 300_000  # bytes that are left for the recording


class SoakError(Exception):
    """The soak itself does not work."""


def until(condition: Callable[[], object], what: str) -> None:
    """Wait for a condition; SoakError where it never comes."""
    if not wait_until(condition, PATIENCE):
        raise SoakError(f'{what} never came')


class Diagnostics:
    """The newest figures of each part of each node."""

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
        """Figures that were said from now on."""
        before = self.heard.get(name, 0)
        until(lambda: self.heard.get(name, 0) >= before + 2, f'diagnostics of {name}')
        return self.figures[name]

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        rclpy.shutdown(context=self._context)


@dataclass
class Take:
    """One recording: its process, and how much had been measured when it was ready and ended."""

    path: Path
    process: ChildProcess
    begun: dict[str, int]
    ended: dict[str, int]
    how: str = 'stopped'


def _memory_mb(process: ChildProcess) -> float:
    return float(psutil.Process(process.pid).memory_info().rss) / 1e6


def fill_disk(take: Take) -> None:
    """Let the file of a recording that is under way grow by little more, as on a full disk."""
    size = next(take.path.glob('*.mcap')).stat().st_size + _LEFT
    resource.prlimit(take.process.pid, resource.RLIMIT_FSIZE, (size, size))


class System:
    """Devices, nodes and the recorder of the moment."""

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
        """Samples by stream that the devices have measured by now."""
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
        """End the recorder: in good order, killed, or by waiting until its disk is full."""
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
        """Count processor time and memory from now on."""
        now = time.monotonic()
        self.used = {n: (now, p.cpu_seconds(), _memory_mb(p)) for n, p in self.nodes.items()}

    def usage(self) -> dict[str, dict[str, float]]:
        """Share of a core and growth of memory (MB) of each node since the mark."""
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
        """End all."""
        for process in [*(take.process for take in self.takes), *self.nodes.values()]:
            if process.running:
                process.end(PATIENCE)
        self.drives.close()
        self.supply.unplug()
        self.diagnostics.close()
