"""Histories of legs of one or two robots for the benchmark of `track`: weather, wear, meters."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from lab_scenarios import BASES
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_fleet.track.kept_fit import from_bytes, to_bytes
from power_fleet.track.recording_fit import Occasion, RecordingFit, fit_recording
from truth_circuit import NAMES, Faults, Truth, record
from wattwalk_core.files import write_whole

CATALOGUE = builtin_catalogue()
EFFECTS = BASES['core']
WORN = ('coulomb_friction', 'viscous_friction', 'copper_loss', 'idle')
SECONDS = 60.0
_DAY = 86_400.0
_START = 1.7e9  # s since 1970
_WARMTH = {'viscous_friction': -0.012, 'coulomb_friction': -0.004, 'copper_loss': 0.0035}  # 1/K
_KINDS = ('quiet', 'wear', 'quiet', 'gain', 'quiet', 'wear', 'quiet', 'offset')


@dataclass(frozen=True)
class Plan:
    """
    Sealed change of one drive in a history.

    The robots of a history take turns; begin and end count the recordings of the one that changes.
    """

    seed: int
    kind: str  # quiet, wear, gain or offset
    effect: str = ''
    drive: str = ''
    course: str = ''  # step or ramp
    begin: int = 0  # first recording that differs
    end: int = 0  # first recording with all of the change
    size: float = 0.0  # share of the effect; of the gain: 1; of the offset: A
    robots: int = 1
    robot: int = 0  # the one that changes

    @property
    def meter(self) -> str:
        """Name of the drive that changes in the results, with the robot where there are two."""
        return f'leg_{self.robot} {self.drive}' if self.robots > 1 else self.drive

    def share(self, index: int) -> float:
        """Share of the change in a recording."""
        if self.kind == 'quiet':
            return 0.0
        if self.course == 'step':
            return float(index >= self.begin)
        return float(np.clip((index - self.begin + 1) / (self.end - self.begin + 1), 0.0, 1.0))


def plan(seed: int, count: int) -> Plan:
    """Draw the sealed plan of a history of so many recordings; every third has two robots."""
    random = np.random.default_rng([seed, 1900])
    kind = _KINDS[seed % len(_KINDS)]
    robots = 2 if seed % 3 == 2 else 1
    count //= robots
    if kind == 'quiet':
        return Plan(seed, kind, robots=robots)
    drive = str(random.choice(NAMES))
    begin = int(random.integers(count // 4, count - count // 3))
    course = str(random.choice(('step', 'ramp')))
    end = begin if course == 'step' else int(random.integers(begin + count // 5, count))
    if kind == 'wear':
        effect, size = WORN[seed // 4 % len(WORN)], float(random.uniform(0.25, 0.6))
    elif kind == 'gain':
        effect, size = 'power_gain', float(random.choice((-1, 1)) * random.uniform(0.03, 0.06))
    else:
        effect, size = 'current_offset', float(random.uniform(0.02, 0.04))
    robot = int(random.integers(robots))
    return Plan(seed, kind, effect, drive, course, begin, end, size, robots, robot)


def circumstances(own: Plan, count: int) -> Iterator[tuple[Occasion, Truth]]:
    """Yield the recordings of a history: a season, gaits, payloads, a few on the bench."""
    random = np.random.default_rng([own.seed, 1901])
    phase, days = random.uniform(0, 2 * np.pi), np.cumsum(random.integers(1, 4, count))
    days[random.integers(count) :] += 7  # a week without recordings
    for index in range(count):
        turn, robot = divmod(index, own.robots)
        season = 9.0 * np.sin(2 * np.pi * days[index] / 365.0 + phase)
        temperature = 16.0 + season + random.normal(0, 4.0)
        gait = str(random.choice(('trot', 'slow', 'bench'), p=(0.55, 0.3, 0.15)))
        payload = float(random.choice((0.0, 5.0, 10.0)))
        effects: dict[str, Any] = {
            name: np.full(3, np.exp(_WARMTH.get(name, 0.0) * (temperature - 16.0)))
            for name in EFFECTS
        }
        faults, place = Faults(), [name == own.drive for name in NAMES]
        share = own.share(turn) if robot == own.robot else 0.0
        step = own.size * share * np.array(place, dtype=np.float64)
        if own.kind == 'wear':
            effects[own.effect] = effects[own.effect] * (1.0 + step)
        elif own.kind == 'gain':
            faults = replace(faults, gain=step)
        elif own.kind == 'offset':
            faults = replace(faults, current_offset=step)
        yield (
            Occasion(
                f'day_{days[index]:03d}',
                _START + _DAY * float(days[index]),
                f'leg_{robot}',
                {'temperature': round(temperature + random.normal(0, 1.0), 1), 'payload': payload},
                {'controller': gait},
            ),
            Truth(
                effects,
                'ladder' if gait == 'bench' else 'walk',
                SECONDS,
                seed=own.seed * 1000 + index,
                unit=2 * own.seed + robot,
                faults=faults,
                pace=0.8 if gait == 'slow' else 1.0,
                payload=1.0 + payload / 50.0,
            ),
        )


def model() -> EffectModel:
    """The model that is tracked, which names everything that the circuit has."""
    names = ('shaft', *EFFECTS)
    return EffectModel('core', Structure(tuple(Active.of(CATALOGUE[name]) for name in names)))


def history(own: Plan, count: int, cache: Path) -> list[RecordingFit]:
    """Fits of a history's recordings; what the cache has is not simulated again."""
    cache.mkdir(parents=True, exist_ok=True)
    out = []
    for index, (occasion, truth) in enumerate(circumstances(own, count)):
        file = cache / f'{own.seed}_{count}_of_{own.robots}_{index}.fit'
        if not file.exists():
            fit = fit_recording(record(truth), model(), CATALOGUE, occasion)
            write_whole(file, to_bytes(fit))
        out.append(from_bytes(file.read_bytes()))
    return out
