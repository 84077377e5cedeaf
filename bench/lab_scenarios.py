"""Scenarios of the lab's blind benchmark: hidden effects and the simulated hardware."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

from drive_bench.motion.segment_path import JUMPS
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from sim_bridge.offline.motions import MotionController, bench_motion
from sim_bridge.offline.run import OfflineRun, simulate_recording, walking_run
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import Stand, stand_world
from truth_circuit import CONSTANT, UNMODELLED, Faults, Truth, record

BASES: Mapping[str, tuple[str, ...]] = {
    'lean': ('copper_loss', 'idle'),
    'mid': ('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle'),
    'rich': (
        *('copper_loss', 'viscous_friction', 'coulomb_friction', 'idle'),
        *('rotor_inertia', 'load_friction'),
    ),
    'core': ('copper_loss', 'viscous_friction', 'coulomb_friction', 'rotor_inertia', 'idle'),
}
CIRCUIT_EFFECTS = (
    *('copper_loss', 'winding_heating', 'viscous_friction', 'coulomb_friction'),
    *('stribeck_friction', 'load_friction', 'iron_loss', 'inverter_loss', 'idle'),
    *('regeneration_efficiency', 'regeneration_limit', 'field_weakening', 'rotor_inertia'),
    *('spring', 'cogging', 'line_resistance'),
)
SIM_EFFECTS = (
    *('winding_heating', 'viscous_friction', 'coulomb_friction', 'stribeck_friction'),
    *('load_friction', 'iron_loss', 'inverter_loss', 'idle', 'line_resistance'),
    *('regeneration_efficiency', 'rotor_inertia', 'spring'),
)
PAIRS = (
    ('load_friction', 'rotor_inertia'),
    ('coulomb_friction', 'idle'),
    ('viscous_friction', 'load_friction'),
    ('stribeck_friction', 'load_friction'),
    ('regeneration_efficiency', 'rotor_inertia'),
    ('line_resistance', 'coulomb_friction'),
    ('inverter_loss', 'viscous_friction'),
    ('spring', 'load_friction'),
    ('winding_heating', 'coulomb_friction'),
    ('viscous_friction', 'coulomb_friction'),
)
FAULTS: Mapping[str, dict[str, float]] = {
    'late power 8 ms': {'delay': 0.0095},
    'late power 15 ms': {'delay': 0.0165},
    'gain +2 %': {'gain': 0.02},
    'gain -2 %': {'gain': -0.02},
    'current offset 20 mA': {'current_offset': 0.02},
    'torque bias 0.4 N·m': {'torque_bias': 0.4},
    'velocity filter 20 Hz': {'velocity_filter': 20.0},
    'drifting offset': {'offset_drift': 0.006},
    'bent torque sensor': {'torque_bend': 0.015},
}
STRENGTHS = (0.5, 1.0, 2.0)
LEG = ('LF_HAA', 'LF_HFE', 'LF_KFE')


@dataclass(frozen=True)
class Scenario:
    """One recording to be judged."""

    group: str  # effect, null, pair, unmodelled, fault, beside
    source: str  # circuit or sim
    motion: str  # walk, ladder or bench
    base: str
    hidden: Mapping[str, float] = field(default_factory=dict)  # strength by name
    fault: str = ''
    seed: int = 0
    seconds: float = 150.0

    @property
    def key(self) -> str:
        """Key of the scenario in a file of results."""
        hidden = '+'.join(f'{name}:{strength:g}' for name, strength in self.hidden.items())
        parts = (self.group, self.source, self.motion, self.base, hidden, self.fault)
        return '|'.join((*parts, str(self.seed), f'{self.seconds:g}'))

    @property
    def known(self) -> tuple[str, ...]:
        """Effects of the model that is judged."""
        return ('shaft', *(name for name in BASES[self.base] if name not in self.hidden))

    @property
    def truth(self) -> frozenset[str]:
        """Effects that a perfect diagnosis names."""
        return frozenset(name for name in self.hidden if name not in (*UNMODELLED, *CONSTANT))

    def record(self, *, without: Collection[str] = ()) -> AlignedDataset:
        """Simulate; without: these are not hidden."""
        effects: dict[str, float] = dict.fromkeys(self.known[1:], 1.0)
        effects.update(self.hidden)
        effects.update(dict.fromkeys(without, 0.0))
        if self.source == 'circuit':
            faults = Faults(**FAULTS[self.fault]) if self.fault else Faults()
            motion = 'walk' if self.motion == 'walk' else 'ladder'
            truth = Truth(effects, motion, self.seconds, self.seed, self.seed + 50, faults)
            return record(truth)
        return _simulated(self, effects, self.seed)


def _simulated(scenario: Scenario, effects: Mapping[str, float], seed: int) -> AlignedDataset:
    base = Plant.load('anymal_c').unit(scenario.seed + 1)
    changes: dict[str, Any] = {name: False for name, _ in base.effects}
    changes.update({name: value if value else False for name, value in effects.items()})
    plant = base.with_effects(**changes)
    if scenario.motion == 'walk':
        run = walking_run(plant, duration=scenario.seconds, seed=seed, drives=LEG)
        return align(simulate_recording(run), rate=400.0, smooth=False, drives=LEG)
    drive = LEG[scenario.seed % 3]
    world = stand_world(drive, Stand(0.05, 5.0, 0.45))
    ladder = bench_motion('ladder', 'velocity', amplitude=5.0, seconds=scenario.seconds)
    motion = MotionController(replace(ladder, segments=ladder.segments[1:]), ramps=JUMPS)
    offline = OfflineRun(plant, world, motion, duration=scenario.seconds, seed=seed)
    return align(simulate_recording(offline), rate=400.0, smooth=False)


def scenarios(seeds: Sequence[int], *, sources: Sequence[str], quick: bool) -> list[Scenario]:
    """All of them; quick: one strength and one base each."""
    out: list[Scenario] = []
    strengths = (1.0,) if quick else STRENGTHS
    for seed in seeds:
        if 'circuit' in sources:
            out += _circuit(seed, strengths, quick)
        if 'sim' in sources:
            out += _sim(seed, quick)
    return out


def _circuit(seed: int, strengths: Sequence[float], quick: bool) -> list[Scenario]:
    bases = ('mid', 'lean', 'rich')
    out = []
    for motion in ('walk', 'ladder'):
        out += [Scenario('null', 'circuit', motion, name, seed=seed) for name in bases]
        out += [
            Scenario(
                'effect', 'circuit', motion, bases[(seed + index) % 3], {name: strength}, seed=seed
            )
            for index, name in enumerate(CIRCUIT_EFFECTS)
            for strength in strengths
        ]
        out += [
            Scenario(
                'pair',
                'circuit',
                motion,
                bases[(seed + index) % 2],
                dict.fromkeys(pair, 1.0),
                seed=seed,
            )
            for index, pair in enumerate(PAIRS)
        ]
        out += [
            Scenario('unmodelled', 'circuit', motion, 'mid', {name: strength}, seed=seed)
            for name in UNMODELLED
            for strength in ((1.0,) if quick else (0.5, 1.0))
        ]
        out += [
            Scenario('constant', 'circuit', motion, base, {name: strength}, seed=seed)
            for name in CONSTANT
            for base in ('mid', 'lean')
            for strength in ((1.0,) if quick else STRENGTHS)
        ]
        out += [Scenario('fault', 'circuit', motion, 'mid', {}, fault, seed) for fault in FAULTS]
    out += [
        Scenario('beside', 'circuit', 'walk', 'mid', {missing: 1.0, effect: 1.0}, seed=seed)
        for missing in UNMODELLED
        for effect in ('load_friction', 'spring')
    ]
    return out


def _sim(seed: int, quick: bool) -> list[Scenario]:
    def walk(group: str, hidden: Mapping[str, float]) -> Scenario:
        return Scenario(group, 'sim', 'walk', 'core', hidden, seed=seed)

    out = [Scenario('null', 'sim', motion, 'core', seed=seed) for motion in ('walk', 'bench')]
    out += [
        walk('effect', {name: strength})
        for name in SIM_EFFECTS
        for strength in ((1.0,) if quick else (1.0, 2.0, 3.0))
    ]
    out += [
        Scenario('effect', 'sim', 'bench', 'core', {name: 2.0}, seed=seed)
        for name in ('load_friction', 'coulomb_friction', 'iron_loss', 'viscous_friction')
    ]
    out += [walk('unmodelled', {name: 1.0}) for name in UNMODELLED]
    pairs = combinations(('load_friction', 'regeneration_efficiency', 'spring'), 2)
    out += [walk('pair', dict.fromkeys(pair, 2.0)) for pair in pairs]
    return out
