"""Blind questions of the benchmark of reliability: hidden effects and the simulated hardware."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from drive_bench.motion.file import find_motion
from drive_bench.motion.segment_path import JUMPS
from power_estimator.effects.signals.prepared import prepare
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from reliability_questions import NAMED_FROM, Sealed
from sim_bridge.offline.motions import MotionController
from sim_bridge.offline.run import OfflineRun, simulate_recording, walking_run
from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.world import Stand, stand_world
from truth_circuit import CONSTANT, NAMES, UNMODELLED, Faults, Truth, record

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


@dataclass(frozen=True)
class Scenario:
    """A question of the blind benchmark: an effect, a pair, a fault or nothing in 150 s."""

    group: str  # effect, null, pair, unmodelled, constant, fault, beside
    source: str  # circuit or sim
    motion: str  # walk, ladder or bench
    base: str
    hidden: Mapping[str, float] = field(default_factory=dict)  # strength by name
    fault: str = ''
    seed: int = 0
    seconds: float = 150.0

    @property
    def key(self) -> str:
        """Key in a file of results."""
        hidden = '+'.join(f'{name}:{strength:g}' for name, strength in self.hidden.items())
        parts = ('blind', self.group, self.source, self.motion, self.base, hidden, self.fault)
        return '|'.join((*parts, str(self.seed), f'{self.seconds:g}'))

    @property
    def about(self) -> Mapping[str, object]:
        """Properties of the question for the file of results, as of `Question.about`."""
        return {
            'family': f'blind, {self.group}',
            'developed': True,
            'motion': self.motion,
            'seconds': self.seconds,
            'drives': len(NAMES),
            'hidden': [*self.hidden, *([self.fault] if self.fault else [])],
        }

    @property
    def _known(self) -> tuple[str, ...]:
        return ('shaft', *(name for name in BASES[self.base] if name not in self.hidden))

    def seal(self) -> Sealed:
        """Simulate the scenario and return its recording with the truth."""
        data = self._record()
        missing = frozenset(name for name in self.hidden if name not in (*UNMODELLED, *CONSTANT))
        fault = FAULTS.get(self.fault, {})
        wrong = {'power_gain'} if abs(fault.get('gain', 0.0)) >= NAMED_FROM else set()
        watts = self._watts(data, missing)
        return Sealed(data, self._known, missing | wrong, watts=watts)

    def _watts(self, data: AlignedDataset, missing: Collection[str]) -> Mapping[str, float]:
        """W rms by which hidden effects change the power; a robot moves otherwise without them."""
        if self.source != 'circuit':
            return {}
        power = prepare(data).power_at(0.0)
        without = {name: prepare(self._record(name)).power_at(0.0) for name in missing}
        return {n: float(np.sqrt(np.nanmean(np.square(power - p)))) for n, p in without.items()}

    def _record(self, without: str = '') -> AlignedDataset:
        effects = {**dict.fromkeys(self._known[1:], 1.0), **self.hidden}
        if without:
            effects[without] = 0.0
        if self.source == 'circuit':
            faults = Faults(**FAULTS[self.fault]) if self.fault else Faults()
            motion = 'walk' if self.motion == 'walk' else 'ladder'
            truth = Truth(effects, motion, self.seconds, self.seed, self.seed + 50, faults)
            return record(truth)
        base = Plant.load('anymal_c').unit(self.seed + 1)
        changes: dict[str, Any] = {name: False for name, _ in base.effects}
        changes.update({name: value if value else False for name, value in effects.items()})
        plant = base.with_effects(**changes)
        if self.motion == 'walk':
            run = walking_run(plant, duration=self.seconds, seed=self.seed, drives=NAMES)
            return align(simulate_recording(run), rate=400.0, smooth=False, drives=NAMES)
        world = stand_world(NAMES[self.seed % 3], Stand(0.05, 5.0, 0.45))
        ladder = find_motion('ladder', 'velocity').changed(amplitude=5.0, seconds=self.seconds)
        motion = MotionController(replace(ladder, segments=ladder.segments[1:]), ramps=JUMPS)
        offline = OfflineRun(plant, world, motion, duration=self.seconds, seed=self.seed)
        return align(simulate_recording(offline), rate=400.0, smooth=False)


def blind_questions(seed: int = 0) -> list[Scenario]:
    """Return all questions of the blind benchmark, on the circuit and the simulated robot."""
    return [*_circuit(seed), *_sim(seed)]


def _circuit(seed: int) -> list[Scenario]:
    def asked(group: str, motion: str, base: str, *hidden: str, fault: str = '') -> Scenario:
        strengths = dict.fromkeys(hidden, 1.0)
        return Scenario(group, 'circuit', motion, base, strengths, fault, seed)

    bases = ('mid', 'lean', 'rich')
    out = []
    for motion in ('walk', 'ladder'):
        out += [asked('null', motion, base) for base in bases]
        out += [
            asked('effect', motion, bases[(seed + index) % 3], name)
            for index, name in enumerate(CIRCUIT_EFFECTS)
        ]
        out += [
            asked('pair', motion, bases[(seed + index) % 2], *pair)
            for index, pair in enumerate(PAIRS)
        ]
        out += [asked('unmodelled', motion, 'mid', name) for name in UNMODELLED]
        out += [
            asked('constant', motion, base, name) for name in CONSTANT for base in ('mid', 'lean')
        ]
        out += [asked('fault', motion, 'mid', fault=fault) for fault in FAULTS]
    out += [
        asked('beside', 'walk', 'mid', missing, effect)
        for missing in UNMODELLED
        for effect in ('load_friction', 'spring')
    ]
    return out


def _sim(seed: int) -> list[Scenario]:
    def asked(group: str, motion: str, *hidden: str, strength: float = 1.0) -> Scenario:
        strengths = dict.fromkeys(hidden, strength)
        return Scenario(group, 'sim', motion, 'core', strengths, seed=seed)

    on_bench = ('load_friction', 'coulomb_friction', 'iron_loss', 'viscous_friction')
    pairs = combinations(('load_friction', 'regeneration_efficiency', 'spring'), 2)
    return [
        *(asked('null', motion) for motion in ('walk', 'bench')),
        *(asked('effect', 'walk', name) for name in SIM_EFFECTS),
        *(asked('effect', 'bench', name, strength=2.0) for name in on_bench),
        *(asked('unmodelled', 'walk', name) for name in UNMODELLED),
        *(asked('pair', 'walk', *pair, strength=2.0) for pair in pairs),
    ]
