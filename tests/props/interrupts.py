"""
Nodes interrupted at random moments from the start of their process on, with messages at 1 kHz.

Each turn starts a node, sends it SIGINT or SIGTERM at a moment of the node's first seconds, and
says how it ended. None may end in a traceback, with another code than that of its own end or of
the signal, or not at all; a bag has every sample but those that its recorder said were lost.
`before the suite` is a signal before its first line, which the interpreter prints, or loses, in
its own way. Runs on the runtime of this Python; with its own program it feeds the nodes.
"""

import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from power_recordings.reading.reader import Recording
from soak_devices import told_lost
from wattwalk_core.errors import InputError
from wattwalk_core.processes import ChildProcess, ProcessError

ROOT = Path(__file__).resolve().parents[2]
MOTION = 'format: motion/1\ndrives: [LF_KFE]\nsegments: [{mode: rest, seconds: 60}]\n'
PATIENCE = 20.0  # s from the signal to the end
SIGNALS = (signal.SIGINT, signal.SIGTERM)
NODES = {
    'record': ('power_daq', 2.0, ('-o', '{folder}/bag')),
    'daq': ('power_daq', 1.5, ('--ros-args', *('-p', 'interface:=unixsocket', '-p'), '{bus}')),
    'watch': ('power_daq', 1.5, ()),
    'supply': ('power_daq', 1.5, ('--ros-args', '-p', 'host:=127.0.0.1')),
    'estimate': ('power_estimator', 4.0, ('--ros-args', '-p', '{model}')),
    'run': ('policy_runner', 4.0, ('--policy', 'trot', '--start')),
    'sim': ('sim_bridge', 3.0, ('--ros-args', *('-p', 'interface:=unixsocket', '-p'), '{bus}')),
    'supply_instrument': ('sim_bridge', 2.0, ('--ros-args', '-p', 'port:=0')),
    'motion': ('drive_bench', 2.0, ('{motion}',)),
}
"""By name: package, the latest moment of a signal [s], arguments."""
_EARLY = 'before the suite'
GOOD = ('in order', _EARLY)
OF_PYTHON = re.compile(
    r'from wattwalk_core import early\n(?!.*/wattwalk_core/)|Failed checking if argv\[0\]',
    re.DOTALL,
)
"""Words of the interpreter about a signal that came before its hooks were taken over."""
CHEAP = ('record', 'daq', 'supply')
AT_WORK = re.compile(r'^(\[\w+\] \[[\d.]+\] \[|recording to )', re.MULTILINE)
"""First lines of nodes: of ROS's log, and the recorder's."""


@dataclass(frozen=True)
class Ending:
    """One turn: node, signal, moment [s], exit code, and `how` it ended, in a word."""

    node: str
    signal: int
    moment: float
    code: int | None
    how: str
    output: str


def executable(package: str, name: str) -> Path:
    """Return the program that `ros2 run` starts, of either runtime."""
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    places = (Path(prefix) / 'lib' / package / name for prefix in prefixes if prefix)
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ProcessError(f'no {package} {name} below {", ".join(prefixes)}')
    return found


def interrupted(node: str, seed: int) -> Ending:
    """Run a node until a signal at a moment that the seed gives; tell how it ended."""
    package, until, arguments = NODES[node]
    chance = random.Random(seed)
    number, moment = chance.choice(SIGNALS), chance.uniform(0.0, until)
    folder = Path(tempfile.mkdtemp(prefix='interrupt'))
    (folder / 'rest.yaml').write_text(MOTION)
    names = {
        'folder': str(folder),
        'bus': f'channel:={folder}/bus',
        'motion': str(folder / 'rest.yaml'),
        'model': f'model:=ppn:{ROOT / "bags" / "ppn_small"}',
    }
    program = executable(package, 'run' if node == 'motion' else node)
    command = [str(program), *(text.format(**names) for text in arguments)]
    try:
        with ChildProcess(command, folder / f'{node}.log') as process:
            time.sleep(moment)
            process.send_signal(number)
            try:
                code: int | None = process.wait(PATIENCE)
            except ProcessError:
                code = None
            output = process.output
        how = _how(node, number, code, output)
        if how == 'in order' and node == 'record':
            how = _account(folder / 'bag', output)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return Ending(node, number, moment, code, how, output)


def _how(node: str, number: int, code: int | None, output: str) -> str:
    early = OF_PYTHON.search(output)
    if code is None:
        return _EARLY if early else 'hangs'
    if 'Traceback' in output or 'Fatal Python error' in output:
        own = re.search(r'/wattwalk_core/wattwalk_core/|/site-packages/rclpy/', output)
        return 'traceback' if own and not early else _EARLY
    # A node at work ends by itself; by the signal it would lose what it has not written yet.
    allowed = {0, 128 + number, *(() if AT_WORK.search(output) else (-number,))}
    # A bag without a message is an error of its own.
    empty = node == 'record' and code == 1
    return 'in order' if code in allowed or empty else f'code {code}'


def _account(bag: Path, output: str) -> str:
    """Compare the samples in a bag with what its recorder said were lost."""
    lost = told_lost(output)
    if lost is None:
        return 'in order'  # nothing was said to have come
    try:
        sequence = Recording.open(bag).drive_supply().sequence.astype(np.int64)
    except InputError as error:
        return f'bag: {error}'
    missing = int((np.diff(sequence) - 1).sum())
    return 'in order' if missing == lost else f'{missing} missing, {lost} told'


def feed() -> int:
    """Publish supplies of twelve drives at 1 kHz and joint states at 400 Hz until a signal."""
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from wattwalk_core.anymal import JOINT_NAMES
    from wattwalk_core.nodes.running import run_node

    from drive_power_msgs.msg import DriveSupply

    class Feeder(Node):
        """Catches up with the samples that are due, however late it is called."""

        def __init__(self) -> None:
            super().__init__('feeder')
            self.supply = self.create_publisher(DriveSupply, 'drive_supply', 1000)
            self.joints = self.create_publisher(JointState, 'joint_states', 1000)
            self.begun, self.sent = time.monotonic(), 0
            some = [0.0] * len(JOINT_NAMES)
            self.electrical = DriveSupply(name=list(JOINT_NAMES), voltage=some, current=some)
            self.electrical.status = [0] * len(JOINT_NAMES)
            self.mechanical = JointState(name=list(JOINT_NAMES), position=some, velocity=some)
            self.mechanical.effort = some
            self.create_timer(0.001, self.speak)

        def speak(self) -> None:
            while self.sent < 1000 * (time.monotonic() - self.begun):
                now = self.get_clock().now()
                stamp = now.to_msg()
                self.electrical.header.stamp = stamp
                self.electrical.sequence, self.electrical.device_time = (
                    self.sent,
                    [now.nanoseconds],
                )
                self.supply.publish(self.electrical)
                if self.sent % 5 in (0, 2):
                    self.mechanical.header.stamp = stamp
                    self.joints.publish(self.mechanical)
                self.sent += 1

    return run_node(Feeder, [])


if __name__ == '__main__':
    sys.exit(feed())
