"""Units that age: courses of wear of single drives, and the days of their recordings."""

import re
from collections.abc import Mapping
from dataclasses import field, replace
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.schema import Length, Name, Quantity, parse, schema
from wattwalk_core.yaml_file import read_yaml

from sim_bridge.plant.parameters import Plant
from sim_bridge.plant.wear import OFFSET, WEARS

_LONGEST: Final = 36_500.0  # days
_COURSE: Final = re.compile(
    r'(?P<size>[+-]\d+(?:\.\d+)?) (?P<unit>%|mA)'
    r'(?: over (?P<over>\d+(?:\.\d+)?) days?)? from day (?P<begin>\d+(?:\.\d+)?)'
)
_WARMTH: Final = {'viscous_friction': -0.012, 'coulomb_friction': -0.004}  # 1/K, all drives
_REFERENCE: Final = 25.0  # °C


@schema
class WearCourse:
    """Course of one change of a drive: none until day `begin`, all of it `over` days later.

    size: share of the effect, or A of the current sensor's offset.
    """

    effect: str
    size: float
    begin: Annotated[float, Quantity(0.0, _LONGEST, 'days')]
    over: Annotated[float, Quantity(0.0, _LONGEST, 'days')] = 0.0

    def __post_init__(self) -> None:
        if self.effect not in (*WEARS, OFFSET):
            known = ', '.join((*WEARS, OFFSET))
            raise InputError(f'no wear {quoted(self.effect)}; there can be {known}')
        low, high, unit = (-1.0, 1.0, 'A') if self.effect == OFFSET else (-0.9, 5.0, '')
        if not low <= self.size <= high:
            limits = '-1000 to 1000 mA' if unit else '-90 to 500 %'
            raise InputError(f'expected {limits}, there is {self.words}')

    @classmethod
    def of(cls, effect: str, text: str) -> 'WearCourse':
        """Parse text such as `+40 % over 60 days from day 20`; InputError for any other."""
        found = _COURSE.fullmatch(text.strip()) if isinstance(text, str) else None
        wanted = 'mA' if effect == OFFSET else '%'
        if found is None or found['unit'] != wanted:
            raise InputError(
                f'{effect}: expected a course such as "+40 {wanted} over 60 days from day 20", '
                f'there is {quoted(text)}'
            )
        size = float(found['size']) / (1000.0 if effect == OFFSET else 100.0)
        course = {'effect': effect, 'size': size, 'begin': float(found['begin'])}
        return parse(cls, {**course, 'over': float(found['over'] or 0.0)}, effect)

    @property
    def words(self) -> str:
        """The course as text, which `of` parses."""
        scale, unit = (1000.0, 'mA') if self.effect == OFFSET else (100.0, '%')
        over = f' over {self.over:g} days' if self.over else ''
        return f'{self.size * scale:+g} {unit}{over} from day {self.begin:g}'

    def on(self, day: float) -> float:
        """Return the part of `size` that is reached on a day."""
        if not self.over:
            return self.size if day >= self.begin else 0.0
        return self.size * float(np.clip((day - self.begin) / self.over, 0.0, 1.0))


@schema
class HistoryDay:
    """Day and conditions of one recording."""

    day: Annotated[float, Quantity(0.0, _LONGEST, 'days', 'since the start')]
    temperature: Annotated[float, Quantity(-40.0, 60.0, '°C', 'air around the drives')] = 25.0
    terrain: Literal['flat', 'rough'] = 'flat'
    controller: Literal['trot', 'trot_slow', 'trot_high', 'stand'] = 'trot'
    payload: Annotated[float, Quantity(0.0, 50.0, 'kg')] = 0.0


@schema
class AgeingPlan:
    """Recordings of one unit that ages.

    age: courses in words by drive and effect. start: date of day 0, ISO 8601. seed: of walks and
    noise. seconds: of each recording. drives: those whose power is metered.
    """

    days: Annotated[tuple[HistoryDay, ...], Length(1)]
    age: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    plant: Name = 'anymal_c'
    unit: Annotated[int, Quantity(0, 2**31 - 1)] = 1
    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 0
    seconds: Annotated[float, Quantity(1.0, 36_000.0, 's')] = 60.0
    start: Name = '2026-01-05'
    drives: Annotated[tuple[str, ...], Length(1)] = JOINT_NAMES

    def __post_init__(self) -> None:
        try:
            date.fromisoformat(self.start)
        except ValueError:
            raise InputError(
                f'start: expected a date such as 2026-01-05, there is {quoted(self.start)}'
            ) from None
        for drive in (*self.age, *self.drives):
            if drive not in JOINT_NAMES:
                raise InputError(f'no drive {quoted(drive)}; there are {", ".join(JOINT_NAMES)}')
        self.courses  # noqa: B018 - each is read, so that a bad one is told here

    @property
    def courses(self) -> dict[str, tuple[WearCourse, ...]]:
        """Courses by drive; InputError for one that cannot be read."""
        return {
            drive: tuple(WearCourse.of(effect, text) for effect, text in own.items())
            for drive, own in self.age.items()
        }

    def aged(self, plant: Plant, day: HistoryDay) -> Plant:
        """Return the plan's unit of a plant, with the wear and temperature of a day.

        Grease is stiffer in the cold, in all drives: viscous friction by 1.2 % and Coulomb
        friction by 0.4 % per kelvin below 25 °C.
        """
        warm = {
            name: float(np.exp(slope * (day.temperature - _REFERENCE)))
            for name, slope in _WARMTH.items()
        }
        wear: dict[str, dict[str, float]] = {drive: dict(warm) for drive in JOINT_NAMES}
        for drive, courses in self.courses.items():
            for course in courses:
                known = wear[drive].get(course.effect, 0.0 if course.effect == OFFSET else 1.0)
                reached = course.on(day.day)
                wear[drive][course.effect] = (
                    known + reached if course.effect == OFFSET else known * (1.0 + reached)
                )
        sensors = replace(plant.sensors, ambient=day.temperature)
        return replace(plant.unit(self.unit), sensors=sensors, wear=wear)

    @classmethod
    def load(cls, path: Path) -> 'AgeingPlan':
        """Read a plan; InputError names file, entry and value."""
        content: Any = read_yaml(path, 'ageing plan')
        if isinstance(content, Mapping) and 'start' in content:
            content = {**content, 'start': str(content['start'])}
        return parse(cls, content, f'ageing plan {path}')
