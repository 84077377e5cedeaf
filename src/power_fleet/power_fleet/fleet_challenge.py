"""Histories of robots with a hidden change: drawn from a seed, recorded day by day, sealed."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from power_lab.challenge.challenge import seal
from sim_bridge.plant.ageing import AgeingPlan, HistoryDay, WearCourse
from sim_bridge.plant.wear import OFFSET
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

KINDS = ('quiet', 'wear', 'meter')
WORN = ('coulomb_friction', 'viscous_friction', 'copper_loss', 'idle')
LEAST_RECORDINGS = 8
_SHARES = (0.5, 0.35, 0.15)  # of the kinds
_GAITS: Final[tuple[Literal['trot', 'trot_slow', 'trot_high'], ...]] = (
    'trot',
    'trot_slow',
    'trot_high',
)
_WEEK = 7.0


@dataclass(frozen=True)
class FleetChallenge:
    """Histories of two simulated robots, with a change hidden in one drive of one, or none.

    kind: one of KINDS; without a change `drive` is empty and `course` None.
    """

    plans: tuple[AgeingPlan, ...]
    kind: str
    robot: int = 0  # index of the plan that ages
    drive: str = ''
    course: WearCourse | None = None

    def answer(self) -> dict[str, Any]:
        """Return the answer as JSON-compatible values."""
        answer: dict[str, Any] = {'fleet': True, 'kind': self.kind, 'hidden': []}
        if self.course is not None:
            days = [day.day for day in self.plans[self.robot].days]
            first = next((i for i, day in enumerate(days) if day >= self.course.begin), len(days))
            answer['hidden'] = [
                {
                    'unit': self.plans[self.robot].unit,
                    'drive': self.drive,
                    **asdict(self.course),
                    'recording': first,
                    'words': f'{self.course.effect} {self.course.words}',
                }
            ]
        return answer


def draw_fleet(
    seed: int, recordings: int, seconds: float, drives: tuple[str, ...] = JOINT_NAMES
) -> FleetChallenge:
    """Draw the histories of two robots from a seed; in half of the draws no drive changes.

    recordings: of both robots together; seconds: of each. One week of the history has none. In the
    other half one effect of a drive grows by 25 to 60 %, or a current sensor changes: its gain by
    3 to 6 %, or its offset by 20 to 40 mA, at once or slowly. InputError for fewer than 8
    recordings of each robot.
    """
    if recordings < 2 * LEAST_RECORDINGS:
        least = 2 * LEAST_RECORDINGS
        raise InputError(f'--recordings {recordings}: give at least {least}, 8 for each robot')
    random = np.random.default_rng([seed, 2026])
    kind = str(random.choice(KINDS, p=_SHARES))
    units = random.choice(np.arange(1, 1000), 2, replace=False)
    days = _days(random, recordings)
    robot, drive = int(random.integers(2)), str(random.choice(drives))
    last = days[-1].day
    course = None if kind == 'quiet' else _course(random, kind, last)
    age = {} if course is None else {drive: {course.effect: course.words}}
    plans = tuple(
        AgeingPlan(
            days=tuple(days[index::2]),
            age=age if index == robot else {},
            unit=int(units[index]),
            seed=2 * (seed % 2**30) + index,
            seconds=seconds,
            drives=drives,
        )
        for index in range(2)
    )
    if course is None:
        return FleetChallenge(plans, kind)
    return FleetChallenge(plans, kind, robot, drive, course)


def record_fleet(challenge: FleetChallenge, folder: Path, engine: TaskEngine) -> Iterator[Path]:
    """Record every day of every robot, and yield each bag's path once it is written.

    The answer is sealed into the folder after the last bag: the iterator has to be exhausted.
    InputError for a bag that is there already.
    """
    from sim_bridge.offline.history import record_history  # a bus, which analyses do without

    for index, plan in enumerate(challenge.plans):
        yield from record_history(plan, folder, engine, prefix=f'robot_{index}')
    seal(challenge.answer(), folder)


def _days(random: np.random.Generator, count: int) -> list[HistoryDay]:
    numbers = np.cumsum(random.integers(1, 4, count)).astype(float)
    numbers[max(1, int(random.integers(count))) :] += _WEEK  # never before the first recording
    phase, days = random.uniform(0, 2 * np.pi), []
    for number in numbers:
        season = 9.0 * np.sin(2 * np.pi * number / 365.0 + phase)
        days.append(
            HistoryDay(
                day=float(number),
                temperature=round(float(16.0 + season + random.normal(0, 4.0)), 1),
                terrain='rough' if random.uniform() < 0.25 else 'flat',
                controller=_GAITS[int(random.choice(len(_GAITS), p=(0.6, 0.25, 0.15)))],
                payload=float(random.choice((0.0, 5.0, 10.0))),
            )
        )
    return days


def _course(random: np.random.Generator, kind: str, last: float) -> WearCourse:
    begin = round(float(random.uniform(0.25, 0.67)) * last)
    over = round(float(random.uniform(0.2, 1.0)) * (last - begin)) if random.uniform() < 0.5 else 0
    if kind == 'wear':
        effect, share = str(random.choice(WORN)), round(random.uniform(0.25, 0.6), 2)
        return WearCourse(effect, share, float(begin), float(over))
    sign = float(random.choice((-1, 1)))
    if random.uniform() < 0.5:
        gain = sign * round(random.uniform(0.03, 0.06), 3)
        return WearCourse('power_gain', gain, float(begin), float(over))
    offset = sign * round(random.uniform(0.02, 0.04), 3)
    return WearCourse(OFFSET, offset, float(begin), float(over))
