"""Offline runs of the simulated robot, into a bag or into memory."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray
from power_daq.bus.description import BusDescription
from power_recordings.card import Card
from power_recordings.messages import cdr
from power_recordings.messages.topics import TYPES
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter, MessageBlock
from wattwalk_core.anymal import FOOT_NAMES
from wattwalk_core.command import DeferredSignals, Interrupted
from wattwalk_core.console import counting_bar
from wattwalk_core.errors import InputError

import sim_bridge
from sim_bridge.offline.controllers import Controller, make_controller
from sim_bridge.offline.session import Event, Pushes, SimulatedSession
from sim_bridge.offline.telemetry import START_NS, Telemetry, Wire, gather
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.simulation import PlantBlock, Simulation
from sim_bridge.plant.terrain import FLAT, TERRAINS, rough
from sim_bridge.plant.world import World, walking_world
from sim_bridge.sensors.blocks import Instruments

_SECOND: Final = 1_000_000_000


class BagTopics:
    """Writer of telemetry to the topics that the live system records, in the order of time."""

    def __init__(
        self, bag: BagWriter, joints: Sequence[str], measured: Sequence[str], device: str
    ) -> None:
        """joints: of joint_states; measured, device: drives, frame of drive_supply."""
        self._bag = bag
        self._topics: dict[str, int] = {}
        self._samples = 0
        self._seconds = 0
        self._counts = {'fall': 0, 'push': 0}
        of_joints = partial(cdr.joint_state_block, names=joints)
        self._encoders: dict[str, Callable[..., NDArray[np.uint8]]] = {
            'drive_supply': partial(_drive_supply, names=measured, frame_id=device),
            'joint_states': of_joints,
            'joint_commands': of_joints,
            'supply': cdr.battery_block,
            'imu': cdr.imu_block,
            'odom': cdr.odometry_block,
            'foot_force': partial(cdr.joint_state_block, names=FOOT_NAMES),
            'cmd_vel': cdr.twist_block,
        }

    def write(self, telemetry: Telemetry) -> None:
        """Add half a second of telemetry; RecordingError where the disk refuses."""
        blocks = []
        for name, rows in telemetry.topics.items():
            values: dict[str, Any] = rows.values
            if name == 'drive_supply':
                values = {**values, 'sequence0': self._samples}
                self._samples += len(rows.stamp_ns)
            topic = self._topic(name)
            if len(rows.stamp_ns):
                messages = self._encoders[name](rows.stamp_ns, **values)
                blocks.append(MessageBlock(topic, rows.stamp_ns, messages))
        blocks += self._diagnostics(telemetry)
        self._bag.write_blocks(sorted(blocks, key=lambda block: block.topic))

    def _topic(self, name: str) -> int:
        """Return the handle of a topic, which is added where it is new."""
        if name not in self._topics:
            self._topics[name] = self._bag.add_topic(name, TYPES[name])
        return self._topics[name]

    def _diagnostics(self, telemetry: Telemetry) -> list[MessageBlock]:
        """Return the message at 1 Hz, and nothing between."""
        topic = self._topic('diagnostics')
        stamps = telemetry.topics['supply'].stamp_ns
        last = int(stamps[-1]) if len(stamps) else START_NS
        for event in telemetry.events:
            self._counts[event.kind] += 1
        if last - START_NS < (self._seconds + 1) * _SECOND:
            return []
        self._seconds = (last - START_NS) // _SECOND
        falls = [event for event in telemetry.events if event.kind == 'fall']
        data = np.frombuffer(_diagnostic(last, falls, self._counts), np.uint8)
        return [MessageBlock(topic, np.array([last]), data[None])]


def _drive_supply(stamps_ns: NDArray[np.int64], **values: Any) -> NDArray[np.uint8]:
    (block,) = cdr.drive_supply_blocks(stamps_ns, **values)
    return block


def _diagnostic(stamp: int, falls: Sequence[Event], counts: dict[str, int]) -> bytes:
    seconds, nanoseconds = divmod(stamp, _SECOND)
    status = cdr.message(
        'diagnostic_msgs/msg/DiagnosticStatus',
        level=1 if falls else 0,
        name='sim_bridge',
        message=falls[-1].text if falls else 'running',
        hardware_id='simulation',
        values=[{'key': f'{kind}s', 'value': str(count)} for kind, count in counts.items()],
    )
    header = {'stamp': {'sec': seconds, 'nanosec': nanoseconds}}
    message = cdr.message(cdr.DIAGNOSTIC_ARRAY, header=header, status=[status])
    return cdr.serialize(cdr.DIAGNOSTIC_ARRAY, message)


class OfflineRun:
    """A seeded run of a plant in a world under a controller, an iterator of `Telemetry`.

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
        watch: Callable[[PlantBlock], None] | None = None,
    ) -> None:
        """Make a run.

        drives: those whose power is metered, all if None. watch: is shown every block of the
        plant, as an instrument beside the meter.
        """
        if not 0.1 <= duration <= 36_000.0:
            raise InputError(f'duration is {duration!r}; it must lie in 0.1..36000 s')
        if seed < 0:
            raise InputError(f'seed is {seed!r}; it must not be negative')
        self.plant, self.seed, self.duration = plant, seed, duration
        self.controller = controller.name
        self.joints = world.joints
        self.drives = tuple(world.joints if drives is None else drives)
        self.bus = BusDescription.load()
        simulation = Simulation(plant, world)
        instruments = Instruments(simulation, seed)
        warmth = simulation.circuit.temperature.winding.copy()
        self._wire = Wire(self.bus, self.joints, self.drives, instruments.clock, warmth)
        self._session = SimulatedSession(
            simulation, instruments, controller, Pushes(seed) if pushes else None, watch
        )

    def card(self, robot: str, *, notes: str, **other: Any) -> Card:
        """Return the card of the run's recording, with `other` entries."""
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
    fastest: Sequence[float] | None
    trust_code: bool
    payload: float


def walking_run(
    plant: Plant, *, duration: float, seed: int, **options: Unpack[WalkOptions]
) -> OfflineRun:
    """Return a run of ANYmal C; iterating it simulates and yields `Telemetry`.

    controller: name or folder of a policy, or `stand`; `trot` if absent. terrain: flat (if absent)
    or rough. pushes: every few seconds. drives: those whose power is metered, all if absent.
    velocity: vx, vy in m/s and yaw rate in rad/s to hold; random ones if absent. fastest: of the
    random ones. trust_code: run a TorchScript file as controller. payload: on the base, kg.
    InputError for bad values.
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
        fastest=options.get('fastest'),
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
    """Write a bag of a walk as the live system would record it, and return its path.

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
    output: Path, run: OfflineRun, card: Card, *, overwrite: bool = False, progress: bool = False
) -> None:
    """Write a run and its card; falls and pushes are in `diagnostics`.

    SIGINT and SIGTERM end it with a closed bag whose card says so; then Interrupted is raised.
    """
    bar = counting_bar('s')
    with (
        DeferredSignals() as signals,
        BagWriter(output, overwrite=overwrite) as bag,
        bar if progress else nullcontext(),
    ):
        task = bar.add_task(f'simulating {output.name}', total=run.duration)
        topics = BagTopics(bag, run.joints, run.drives, run.bus.device)
        for telemetry in run:
            topics.write(telemetry)
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


def simulate_recording(run: OfflineRun) -> Recording:
    """Return a run as a recording in memory, without diagnostics and card."""
    return gather('simulation', list(run), run.joints, run.drives)
