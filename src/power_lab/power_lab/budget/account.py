"""Shares of effects in the power of drives, types of drives and the robot."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from power_estimator.drive_types import assign, infer_types
from power_estimator.effects.signals.prepared import WHOLE
from power_estimator.effects.signals.reducer import REDUCED_RATE

from power_lab.budget.tally import ELECTRONICS, UNEXPLAINED, Tally, interval

_JOULES = 3600.0


@dataclass(frozen=True)
class Share:
    """Mean power of one effect in one phase, for a drive, a drive type or the robot."""

    drive: str  # or a type of drives, or `robot`
    phase: str
    effect: str
    mean_w: float
    interval: tuple[float, float]  # 90 %
    share: float | None  # of its drive's metered energy; None where nothing was metered or drawn
    energy_wh: float


@dataclass(frozen=True)
class BudgetDifference:
    """Power that a part of a recording's budget draws more than that of another."""

    recording: str
    against: str
    drive: str
    phase: str
    effect: str
    mean_w: float
    interval: tuple[float, float]  # 90 %


@dataclass(frozen=True)
class Account:
    """Energy budget of one recording, or of several pooled, by drive, drive type and robot."""

    name: str
    tallies: Mapping[str, Tally]
    phases: tuple[str, ...]

    @property
    def first(self) -> str:
        """Name of the robot's tally, or of its only drive."""
        return WHOLE if WHOLE in self.tallies else next(iter(self.tallies))

    @property
    def groups(self) -> list[str]:
        """Names of drive types, and of drives that are of none."""
        names = [n for n, tally in self.tallies.items() if n != WHOLE and tally.drives == 1]
        found: list[str] = []
        for kind, own in assign(names, infer_types(names)).items():
            several = kind in self.tallies and self.tallies[kind].drives > 1
            found += [kind] if several else [names[drive] for drive in own]
        return found

    def shares(self, member: str, phase: str = 'all') -> list[Share]:
        """Shares of a drive, drive type or the robot in a phase, what is unexplained last.

        member: name of one in `tallies`. [] for a phase without samples.
        """
        tally, place = self.tallies[member], self.phases.index(phase)
        means, limits = tally.means[0], interval(tally.means)
        rows = tally.counts[0] / tally.drives
        if not rows[place]:
            return []
        whole = float(means[0, -1] * rows[0])
        found = []
        for part, effect in enumerate(tally.rows[:-1]):
            mean = float(means[place, part])
            if np.isfinite(mean):
                share = mean * float(rows[place]) / whole if whole > 0.0 else None
                low, high = limits[place, part].tolist()
                energy = mean * float(rows[place]) / REDUCED_RATE / _JOULES
                found.append(Share(member, phase, effect, mean, (low, high), share, energy))
        return found

    def rows(self) -> Iterator[Share]:
        """Yield shares of drives, types and robot in all phases; electronics for robots alone."""
        for member in self.tallies:
            for phase in self.phases:
                for found in self.shares(member, phase):
                    if found.effect != ELECTRONICS or member == WHOLE:
                        yield found

    def power(self, phase: str = 'all') -> tuple[float, tuple[float, float]]:
        """Mean metered power of the robot in a phase, W, with its 90 % interval."""
        means = self.tallies[self.first].means[:, self.phases.index(phase), -1]
        low, high = interval(means).tolist()
        return float(means[0]), (low, high)

    @property
    def unexplained_w(self) -> float:
        """Mean metered power of the robot that no effect explains, W."""
        return next(s.mean_w for s in self.shares(self.first) if s.effect == UNEXPLAINED)

    @property
    def energy_wh(self) -> float:
        """Metered energy of the robot over all counted samples, Wh."""
        tally = self.tallies[self.first]
        return float(tally.sums[0, 0, -1]) / REDUCED_RATE / _JOULES

    def runtime(self, battery: float) -> dict[str, dict[str, Any]]:
        """Runtime by phase from a battery in Wh: `hours`, and their 90 % `interval`.

        A phase that draws no power is left out. The upper end is None where power may be 0.
        """
        found = {}
        for phase in self.phases:
            watts, (low, high) = self.power(phase)
            if watts > 0.0:
                longest = battery / low if low > 0.0 else None
                found[phase] = {'hours': battery / watts, 'interval': [battery / high, longest]}
        return found

    def json(self) -> dict[str, Any]:
        """Return shares and totals as JSON-compatible values."""
        metered, _ = self.power()
        return {
            'rows': [vars(row) for row in self.rows()],
            'total_w': metered - self.unexplained_w,
            'metered_w': metered,
            'unexplained_w': self.unexplained_w,
            'energy_wh': self.energy_wh,
        }
