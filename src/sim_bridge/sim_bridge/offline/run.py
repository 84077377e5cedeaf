"""Offline runs of the simulated robot, into a bag or into memory."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

from power_daq.bus.description import BusDescription
from power_recordings.card import Card
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from wattwalk_core.errors import InputError
from wattwalk_core.interruption import DeferredSignals, Interrupted

import sim_bridge
from sim_bridge.offline.bag_topics import BagTopics
from sim_bridge.offline.controllers import Controller, make_controller
from sim_bridge.offline.memory import gather
from sim_bridge.offline.session import Event, Pushes, SimulatedSession
from sim_bridge.offline.telemetry import Telemetry, Wire
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import PlantBlock, Simulation
from sim_bridge.plant.terrain import FLAT, TERRAINS, rough
from sim_bridge.plant.world import World, walking_world
from sim_bridge.sensors.blocks import Instruments


class OfflineRun:
    """
    A seeded run of a plant in a world under a controller.

    The same arguments give the same telemetry. InputError for a duration outside 0.1..36000 s, a
    negative seed, or drives that the world or the bus does not have.
    """

    def __init__(
        self,
        plant: Plant,
        world: World,
        controller: Controller,
        *,
        duration: float,
        seed: int,
        drives: Sequence[str] | None = None,
        pushes: bool = False,
        bus: BusDescription | None = None,
        watch: Callable[[PlantBlock], None] | None = None,
    ) -> None:
        """
        Make a run.

        drives: those whose power is metered, all if None. bus: the shipped one if None. watch: is
        shown every block of the plant, as an instrument beside the meter.
        """
        if not 0.1 <= duration <= 36_000.0:
            raise InputError(f'duration is {duration!r}; it must lie in 0.1..36000 s')
        if seed < 0:
            raise InputError(f'seed is {seed!r}; it must not be negative')
        self.plant, self.seed, self.duration = plant, seed, duration
        self.controller = controller.name
        self.joints = world.joints
        self.drives = tuple(world.joints if drives is None else drives)
        self.bus = BusDescription.load() if bus is None else bus
        simulation = Simulation(plant, world)
        instruments = Instruments(simulation, seed)
        warmth = simulation.circuit.temperature.winding.copy()
        self._wire = Wire(self.bus, self.joints, self.drives, instruments.clock, warmth)
        self._session = SimulatedSession(
            simulation, instruments, controller, Pushes(seed) if pushes else None, watch
        )

    def card(self, robot: str, *, notes: str, **other: Any) -> Card:
        """Return the card of its recording, with further entries."""
        return Card(
            robot=robot,
            unit=other.pop('unit', str(self.plant.unit_number)),
            drives=self.drives,
            controller=self.controller,
            terrain=other.pop('terrain', ''),
            notes=notes,
            software=f'sim_bridge {sim_bridge.__version__}',
            seed=self.seed,
            other={'plant': self.plant.name, **other},
        )

    @property
    def elapsed(self) -> float:
        """Simulated time, s."""
        return self._session.simulation.time

    def __iter__(self) -> Iterator[Telemetry]:
        """Yield telemetry in stretches of half a second."""
        for stretch in self._session.run(self.duration):
            yield self._wire.send(stretch)


class WalkOptions(TypedDict, total=False):
    """Options of a walking run, see `walking_run`."""

    controller: str
    terrain: str
    pushes: bool
    drives: Sequence[str] | None
    velocity: Sequence[float] | None
    trust_code: bool
    payload: float


def walking_run(
    plant: Plant, *, duration: float, seed: int, **options: Unpack[WalkOptions]
) -> OfflineRun:
    """
    Return a run of ANYmal C.

    controller: name or folder of a policy, or `stand`; `trot` if absent. terrain: flat (if absent)
    or rough. pushes: every few seconds. drives: those whose power is metered, all if absent.
    velocity: vx, vy in m/s and yaw rate in rad/s to hold; random ones if absent. trust_code: run a
    TorchScript file as controller. payload: on the base, kg.
    """
    terrain = options.get('terrain', 'flat')
    if terrain not in TERRAINS:
        raise InputError(f'terrain is {terrain!r}; it is one of {", ".join(TERRAINS)}')
    ground = rough(max(seed, 0)) if terrain == 'rough' else FLAT
    world = walking_world(ground, options.get('payload', 0.0))
    controller = make_controller(
        options.get('controller', 'trot'),
        max(seed, 0),
        options.get('velocity'),
        trust_code=options.get('trust_code', False),
    )
    return OfflineRun(
        plant,
        world,
        controller,
        duration=duration,
        seed=seed,
        drives=options.get('drives'),
        pushes=options.get('pushes', False),
    )


def run_offline(
    output: Path,
    *,
    duration: float,
    seed: int,
    plant: Plant | None = None,
    overwrite: bool = False,
    progress: bool = False,
    **options: Unpack[WalkOptions],
) -> Path:
    """
    Write a bag of a walk as the live system would record it, and return its path.

    plant: the shipped `anymal_c` if None. options: see `walking_run`. Equal arguments give equal
    bytes. InputError for bad arguments or a path that is taken; see OfflineRun.
    """
    hardware = Plant.load('anymal_c') if plant is None else plant
    run = walking_run(hardware, duration=duration, seed=seed, **options)
    velocity = options.get('velocity')
    card = run.card(
        'anymal_c',
        terrain=options.get('terrain', 'flat'),
        notes='simulated' + (', with random pushes' if options.get('pushes') else ''),
        **({} if velocity is None else {'velocity': [float(value) for value in velocity]}),
    )
    write_bag(output, run, card, overwrite=overwrite, progress=progress)
    return output


def write_bag(
    output: Path,
    run: OfflineRun,
    card: Card,
    *,
    overwrite: bool = False,
    progress: bool = False,
) -> tuple[Event, ...]:
    """
    Write a run and its card; return falls and pushes, which are also in `diagnostics`.

    SIGINT and SIGTERM end it with a closed bag whose card says so; then Interrupted is raised.
    """
    events: list[Event] = []
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.completed:.0f} of {task.total:.0f} s'),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    with (
        DeferredSignals() as signals,
        BagWriter(output, overwrite=overwrite) as bag,
        bar if progress else nullcontext(),
    ):
        task = bar.add_task(f'simulating {output.name}', total=run.duration)
        topics = BagTopics(bag, run.joints, run.drives, run.bus.device)
        for telemetry in run:
            topics.write(telemetry)
            events += telemetry.events
            bar.advance(task, 0.5)
            for event in telemetry.events:
                if progress and event.kind == 'fall':
                    bar.console.print(event.text)
            if signals.received is not None:
                break
    number = signals.received
    if number is not None:
        ended = f'{number.name} after {run.elapsed:g} s'
        card = replace(card, other={**card.other, 'complete': False, 'ended': ended})
    card.save(output)
    if number is not None:
        raise Interrupted(number, f'ended by {ended}; {output} is closed, incomplete')
    return tuple(events)


def simulate_recording(run: OfflineRun, name: str = 'simulation') -> Recording:
    """Return a run as a recording in memory, without diagnostics and card."""
    return gather(name, list(run), run.joints, run.drives)
