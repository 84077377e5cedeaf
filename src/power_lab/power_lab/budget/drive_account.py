"""Account of one drive: power by part over time, and how uncertain coefficients move it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.arrays import Bools, Floats

from power_lab.budget.parts import SHAFT, Split
from power_lab.budget.tally import Tally, block_sums

REGENERATION, MEASUREMENT = 'regeneration', 'measurement'


@dataclass(frozen=True)
class DriveAccount:
    """Power by part of one drive, with slopes by K uncertain coefficients."""

    parts: tuple[str, ...]
    power: Floats  # W [N, E]
    slopes: Floats  # W per unit [N, K]
    part_of: NDArray[np.intp]  # [K]
    changes: Floats  # of the coefficients in draws [R, K]
    torque_scale: Floats  # relative error of the torque in draws [R]

    @classmethod
    def of(
        cls,
        found: Split,
        changes: Floats,
        torque_scale: Floats,
        measurement: tuple[Floats, Floats, Floats] | None,
    ) -> 'DriveAccount':
        """
        Account of reduced power [N], with changes of all coefficients in draws [R, m].

        The shaft's power is divided by its sign: what the joint gave back is regeneration.
        measurement: power of the meter's errors per unit [N, k], their estimates [k] and the
        changes of these [R, k].
        """
        parts: dict[str, Floats] = {}
        for name, values in found.parts.items():
            if name == SHAFT:
                parts[SHAFT] = np.maximum(values, 0.0)
                parts[REGENERATION] = np.minimum(values, 0.0)
            else:
                parts[name] = values
        slopes = list(found.slopes.values())
        owners = [part for part, _ in found.slopes]
        moved = [changes[:, column] for _, column in found.slopes]
        if measurement is not None:
            columns, values, shifts = measurement
            parts[MEASUREMENT] = columns @ values
            slopes += list(columns.T)
            owners += [MEASUREMENT] * len(values)
            moved += list(shifts.T)
        names = tuple(parts)
        none = np.empty((len(next(iter(parts.values()))), 0)), np.empty((len(changes), 0))
        return cls(
            names,
            np.stack(list(parts.values()), axis=1),
            np.stack(slopes, axis=1) if slopes else none[0],
            np.array([names.index(owner) for owner in owners], dtype=np.intp),
            np.stack(moved, axis=1) if slopes else none[1],
            torque_scale,
        )

    def tally(
        self,
        rows: Bools,
        masks: Mapping[str, Bools],
        meter: Floats,
        block: NDArray[np.intp],
        often: Floats,
    ) -> Tally:
        """Sum over rows [N] of phases [N]; meter: W [N]; block and often as in `block_sums`."""
        good = rows & np.isfinite(self.power).all(axis=1)
        unmetered = np.isnan(meter[rows]).all()
        if not unmetered:
            good = good & np.isfinite(meter)
        chosen = [good & mask for mask in masks.values()]
        joined = np.concatenate([self.power, meter[:, None]], axis=1)
        sums, counts = block_sums(joined, chosen, block, often)
        for phase, own in enumerate(chosen):
            if own.any():
                moved = self.changes * self.slopes[own].mean(axis=0)
                for part in range(len(self.parts)):
                    watts = moved[:, self.part_of == part].sum(axis=1)
                    sums[1:, phase, part] += watts * counts[1:, phase]
        for name in (SHAFT, REGENERATION):
            if name in self.parts:
                part = self.parts.index(name)
                moved = sums[1:, :, part] * self.torque_scale[:, None]
                sums[1:, :, part] += moved
                if MEASUREMENT in self.parts:
                    sums[1:, :, self.parts.index(MEASUREMENT)] -= moved
        return Tally(self.parts, sums, counts)
