"""Real-time execution of the plant by a steady clock, and the commands that it takes."""

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import count
from operator import itemgetter
from threading import Event as Flag
from typing import Any, Final

import can
import numpy as np
from power_daq.bus.description import BusDescription
from wattwalk_core.anymal import DEFAULT_POSE
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.simulation import STEP, Simulation
from sim_bridge.sensors.blocks import BusColumns, InstrumentReadings, Instruments
from sim_bridge.sensors.sensors import DeviceClock

INTERFACES: Final = ('unixsocket', 'virtual', 'socketcan')
_SEND_TIMEOUT: Final = 0.2  # s


class FrameEncoder:
    """Encoder of readings as frames in the order of time, with rolling counters."""

    def __init__(self, bus: BusDescription, joints: Sequence[str], clock: DeviceClock) -> None:
        """Make an encoder; InputError for a joint that the bus lacks."""
        self._bus = bus
        self._clock = clock
        self._columns = BusColumns(bus, joints)
        self._counts = {name: count() for name in ('electrical', 'joints', 'temperature')}

    def encode(self, samples: InstrumentReadings) -> list[can.Message]:
        """Return a block's frames: SYNC and electrical 1 kHz, joints 400 Hz, temperature 10 Hz."""
        meter, joints, warmth = samples.electrical, samples.joints, samples.temperature
        timed = []
        for group, steps, quantities in (
            ('electrical', meter.step, (meter.voltage, meter.current, meter.status)),
            ('joints', joints.step, (joints.position, joints.velocity, joints.torque)),
            ('temperature', warmth.step, (warmth.temperature,)),
        ):
            wide = np.stack([self._columns.spread(values) for values in quantities], axis=1)
            times = (self._clock.device_ns(steps) // 1000).tolist()
            for step, us, row in zip(steps, times, wide, strict=True):
                number = next(self._counts[group])
                if group == 'electrical':
                    timed.append((step, self._bus.encode_sync(number, us)))
                timed.append((step, self._bus.encode(group, number, us, *row)))
        timed.sort(key=itemgetter(0))  # stable: groups of one step keep their order
        return [message for _, messages in timed for message in messages]


class SimulatedBus:
    """The bus of the simulated devices; the host of a Unix socket."""

    def __init__(self, interface: str, channel: str) -> None:
        """Open the bus; InputError for an unknown interface or an unusable channel."""
        if interface not in INTERFACES:
            raise InputError(f'interface is {interface!r}; it is one of {", ".join(INTERFACES)}')
        options: dict[str, Any] = {'host': True} if interface == 'unixsocket' else {}
        try:
            self._bus = can.Bus(
                interface=interface, channel=channel, fd=True, ignore_config=True, **options
            )
        except (can.CanError, OSError, ValueError) as error:
            raise InputError(f'cannot open {interface} bus {channel!r}: {error}') from error
        self._send_all = getattr(self._bus, 'send_all', None)
        self.refused = 0

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put frames on the bus; refused ones are counted in `refused`."""
        if self._send_all is not None:
            self._send_all(messages)
            return
        for message in messages:
            try:
                self._bus.send(message, timeout=_SEND_TIMEOUT)
            except can.CanError:
                self.refused += 1

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


BLOCK: Final = 4  # steps at a time: 2 ms
CATCH_UP: Final = 20  # steps at a time when late
STALE_AFTER: Final = 0.1  # s without a command, then the drives damp


@dataclass
class LoopProgress:
    """Loop timing since it was last taken."""

    steps: int = 0
    wall: float = 0.0  # s
    worst: float = 0.0  # s behind the clock

    @property
    def factor(self) -> float:
        """Ratio of simulated to real time."""
        return self.steps * STEP / self.wall if self.wall > 0.0 else 1.0


class LivePlant:
    """Simulation in real time by its device clock; every sample is handed on.

    Until the first command the drives hold the default pose (on a stand: position 0); when
    commands stop coming for 0.1 s they damp. After a stall it catches up; no sample is left out.
    Give commands, pushes and resets from any thread; `run` works in one.
    """

    def __init__(
        self,
        simulation: Simulation,
        instruments: Instruments,
        encoder: FrameEncoder,
        send: Callable[[Sequence[can.Message]], None],
        publish: Callable[[InstrumentReadings], None],
        *,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Make a plant; send, publish: receive each block; now, sleep: a steady clock, in s."""
        self.simulation = simulation
        self._instruments = instruments
        self._encoder = encoder
        self._send, self._publish = send, publish
        self._now, self._sleep = now, sleep
        self._tasks: list[Callable[[], None]] = []
        self._commanded: tuple[float, JointCommand] | None = None
        self._held: JointCommand | None = None
        self._pace = (1.0 + 1e-6 * instruments.clock.drift) / STEP
        self._progress = LoopProgress()
        self.falls = 0
        self.down: str | None = None
        start = DEFAULT_POSE if simulation.world.floating else np.zeros(len(simulation.joints))
        self._start = JointCommand(position=start)

    @property
    def stale(self) -> bool:
        """True once the last command is more than 0.1 s old; False before the first."""
        commanded = self._commanded  # a reset by the plant's thread may take it away meanwhile
        return commanded is not None and self._now() - commanded[0] > STALE_AFTER

    def command(self, command: JointCommand) -> None:
        """Hold a command from the next block on."""
        self._commanded = self._now(), command

    def push(self, velocity: Floats) -> None:
        """Push the base so that the robot gains a velocity, m/s [3]."""
        self._tasks.append(lambda: self.simulation.push(velocity))

    def reset(self) -> None:
        """Reset the robot; drives hold the initial pose until the next command."""
        self._tasks.append(self._reset)

    def take_progress(self) -> LoopProgress:
        """Return the loop timing since the last call."""
        progress, self._progress = self._progress, LoopProgress()
        return progress

    def run(self, stop: Flag) -> None:
        """Run in real time until stop is set; blocks are sent at the time of their last step."""
        start = last = self._now()
        late = 0.0
        while not stop.is_set():
            steps = BLOCK if late < 2 * BLOCK * STEP else CATCH_UP
            samples, frames = self._compute(steps)
            due = start + self.simulation.steps / self._pace
            now = self._wait(due)
            self._send(frames)
            self._publish(samples)
            late = now - due
            progress = self._progress
            progress.steps += steps
            progress.wall += now - last
            progress.worst = max(progress.worst, late)
            last = now

    def advance(self, steps: int) -> None:
        """Run a number of steps without waiting; send their frames and publish their samples."""
        samples, frames = self._compute(steps)
        self._send(frames)
        self._publish(samples)

    def _wait(self, due: float) -> float:
        now = self._now()
        while now < due:
            self._sleep(due - now)
            now = self._now()
        return now

    def _compute(self, steps: int) -> tuple[InstrumentReadings, list[can.Message]]:
        while self._tasks:
            self._tasks.pop(0)()
        self._hold()
        samples = self._instruments.read(self.simulation.advance(steps))
        self._watch()
        return samples, self._encoder.encode(samples)

    def _hold(self) -> None:
        if self._commanded is None:
            wanted = self._start
        else:
            wanted = JointCommand() if self.stale else self._commanded[1]
        if wanted is not self._held:
            self.simulation.hold(wanted)
            self._held = wanted

    def _watch(self) -> None:
        reason = self.simulation.fallen
        if reason and self.down is None:
            self.falls += 1
        self.down = reason

    def _reset(self) -> None:
        self.simulation.reset()
        self._commanded = None
        self.down = None


def joint_command(
    joints: Sequence[str],
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float],
    effort: Sequence[float],
    absent: Collection[str] = (),
) -> JointCommand:
    """Return the command of a JointState message's fields (rad, rad/s, N·m), in joints' order.

    An empty field commands nothing; a joint that is not named, or whose value is not finite,
    is damped; joints that are absent may be named, to no effect, as on a bus where their drives
    are missing. ValueError for unknown or repeated names and fields of another length.
    """
    for name in names:
        if name not in joints and name not in absent:
            raise ValueError(f'no joint {name!r}; there are {", ".join(joints)}')
    there = [name for name in names if name in joints]
    if len(set(there)) != len(there):
        raise ValueError('a joint is named twice')

    def placed(field: str, values: Sequence[float]) -> Floats | None:
        if len(values) == 0:
            return None
        if len(values) != len(names):
            raise ValueError(f'{field} has {len(values)} values for {len(names)} names')
        given = dict(zip(names, values, strict=True))
        return np.array([given.get(joint, np.nan) for joint in joints], np.float64)

    fields = {'position': position, 'velocity': velocity, 'effort': effort}
    return JointCommand(*(placed(field, values) for field, values in fields.items()))
