"""Session of simulation, instruments and controller, in stretches of half a second."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Floats

from sim_bridge.offline.controllers import Controller, SensedWalk
from sim_bridge.plant.drive import JointCommand
from sim_bridge.plant.simulation import STEP, PlantBlock, Simulation
from sim_bridge.sensors.blocks import InstrumentReadings, Instruments

_STRETCH = 1000  # steps
_DOWN = 2000  # steps on the ground after a fall


@dataclass(frozen=True)
class Event:
    """A `fall` or `push` (`kind`) at a step, with a sentence for the user."""

    step: int
    kind: str
    text: str


@dataclass(frozen=True)
class SessionPart:
    """Readings, N commands to the drives and events of half a second."""

    samples: InstrumentReadings
    step: NDArray[np.int64]  # [N], from whose end on a command is held
    commands: dict[str, Floats]  # position rad, velocity rad/s, effort N·m, as given [N, D]
    base_velocity: Floats | None  # vx, vy m/s, yaw rate rad/s [N, 3]
    events: tuple[Event, ...]


class Pushes:
    """Random pushes of 0.2 to 0.6 m/s, every 3 to 8 s."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 1])
        self._next = self._random.uniform(3.0, 8.0)

    def due(self, time: float) -> Floats | None:
        """Return the velocity change of a push at this time, m/s [3], or None."""
        if time < self._next:
            return None
        self._next = time + self._random.uniform(3.0, 8.0)
        return random_push(self._random)


def random_push(random: np.random.Generator) -> Floats:
    """Return the velocity change of a random horizontal push, m/s [3]."""
    heading = random.uniform(0.0, 2 * np.pi)
    return random.uniform(0.2, 0.6) * np.array([np.cos(heading), np.sin(heading), 0.0])


class SimulatedSession:
    """A simulation with instruments under a controller; it is reset 1 s after a fall."""

    def __init__(
        self,
        simulation: Simulation,
        instruments: Instruments,
        controller: Controller,
        pushes: Pushes | None = None,
        watch: Callable[[PlantBlock], None] | None = None,
    ) -> None:
        """Make a session; watch: is called with every block before it is measured."""
        self.simulation = simulation
        self._watch = watch
        self._instruments = instruments
        self._controller = controller
        self._pushes = pushes
        self._down = 0
        self._events: list[Event] = []

    def run(self, duration: float) -> Iterator[SessionPart]:
        """Yield parts of 0.5 s for `duration` s in all, rounded up to whole command periods."""
        last = self.simulation.steps + round(duration / STEP)
        while self.simulation.steps < last:
            yield self._stretch(min(last, self.simulation.steps + _STRETCH))

    def _stretch(self, stop: int) -> SessionPart:
        blocks: list[PlantBlock] = []
        given: list[tuple[int, JointCommand, Floats | None]] = []
        self._events = []
        while self.simulation.steps < stop:
            command = self._decide()
            given.append((self.simulation.steps, command, self._controller.velocity))
            self.simulation.hold(command)
            blocks.append(self.simulation.advance(self._controller.period))
            if isinstance(self._controller, SensedWalk):
                self._controller.sense(*self._instruments.sense(blocks[-1]))
        block = PlantBlock.join(blocks)
        if self._watch is not None:
            self._watch(block)
        steps, commands, velocities = zip(*given, strict=True)
        stacked = {
            entry.name: _stack([getattr(command, entry.name) for command in commands])
            for entry in fields(JointCommand)
        }
        return SessionPart(
            samples=self._instruments.read(block),
            step=np.array(steps),
            commands={name: rows for name, rows in stacked.items() if rows is not None},
            base_velocity=_stack(velocities),
            events=tuple(self._events),
        )

    def _decide(self) -> JointCommand:
        simulation = self.simulation
        if self._down:
            self._down = max(self._down - self._controller.period, 0)
            if self._down:
                return self._limp()
            simulation.reset()
            self._controller.reset()
        elif reason := simulation.fallen:
            self._tell('fall', f'fell at {simulation.time:.1f} s: {reason}')
            self._down = _DOWN
            return self._limp()
        elif self._pushes and (push := self._pushes.due(simulation.time)) is not None:
            self._tell('push', f'pushed at {simulation.time:.1f} s')
            simulation.push(push)
        return self._controller.command(simulation)

    def _limp(self) -> JointCommand:
        return JointCommand(position=self.simulation.joint_position)

    def _tell(self, kind: str, text: str) -> None:
        self._events.append(Event(self.simulation.steps, kind, text))


def _stack(rows: Sequence[Floats | None]) -> Floats | None:
    given = [row for row in rows if row is not None]
    return np.array(given) if len(given) == len(rows) else None
