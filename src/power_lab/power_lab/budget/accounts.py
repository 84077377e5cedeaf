"""A fitted model on recordings: signals, phases and meters that its power is accounted by."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from power_estimator.drive_types import assign, infer_types, owners
from power_estimator.effects import Signals
from power_estimator.effects.fit.blocks import drawn_blocks
from power_estimator.effects.fit.design import BasePower
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.effects.model_file.model import DriveGroup, EffectModel
from power_estimator.effects.signals.prepared import WHOLE
from power_estimator.effects.signals.reducer import REDUCED_RATE
from power_estimator.effects.signals.scale import DriveScale
from power_estimator.effects.split import SHAFT, Split, reduced, split
from power_estimator.judge.held_out import power_under
from power_estimator.judge.judge import Judge
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_lab.budget.draws import Draws, coefficient_draws, with_torque
from power_lab.budget.tally import ELECTRONICS, Tally, block_sums, blocks_of, phase_masks
from power_lab.compare.comparison import describe_state

REGENERATION, MEASUREMENT = 'regeneration', 'measurement'


@dataclass(frozen=True)
class DriveAccount:
    """Power of E parts of one drive at N rows of 50 Hz, and its slopes by K coefficients."""

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
        """Build from a drive's power by effect at 50 Hz, W [N] each.

        changes: deviations of all coefficients in R draws [R, m]; torque_scale: relative errors of
        the torque [R]; measurement: power per unit of each meter error [N, k], estimates [k] and
        deviations [R, k] of these errors. Negative shaft power becomes the part `regeneration`.
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
        """Sum power over some rows by phase, in the estimate and in R draws.

        rows: mask of the rows that count [N]; masks: rows of each phase [N]; meter: W [N], NaN
        where unknown; block, often: as in `block_sums`.
        """
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


Masks = Mapping[str, Bools]

DRAWS = 200  # draws of what is uncertain: ten of them lie beyond either bound of 90 %


@dataclass(frozen=True)
class PartsOverTime:
    """Power of E parts of D drives and of M meters (D or 1) at N rows of 50 Hz, with the state."""

    names: tuple[str, ...]  # D drives
    parts: tuple[str, ...]
    power: Singles  # W [N, D, E]
    metered: Floats  # W [N, M]
    state: Mapping[str, Floats]  # N·m, rad/s, … [N, D]
    masks: Masks  # by phase [N, D]
    stretches: Sequence[slice]


class Accounts:
    """Power of a fitted model on a judge's recordings, by effect, drive and phase.

    count: number of draws for intervals. InputError for a drive that the model does not cover.
    """

    def __init__(
        self, judge: Judge, model: EffectModel, seed: int = 0, count: int = DRAWS
    ) -> None:
        self.judge, self.model, self.seed, self._count = judge, model, seed, count
        self.prepared = judge.prepared
        names = self.prepared.signals.names
        found = owners(names, model.groups)
        for name, group in zip(names, found, strict=True):
            if group is None:
                raise InputError(f'{model.name} says nothing about {name}; fit it on that, too')
        self.members: list[DriveGroup] = [group for group in found if group is not None]
        self.coefficients = model.coefficients(self.members)
        self.draws: Draws = coefficient_draws(judge, model, self.members, count, seed)

    @cached_property
    def signals(self) -> Signals:
        """Signals, with torque by the torque constants of the model, unless it is refitted."""
        signals = self.prepared.signals
        if self.judge.refits(self.model):
            return signals
        ratio = np.ones(len(signals.names))
        for drive, group in enumerate(self.members):
            constant = self.prepared.torque_constant[drive]
            if group.torque_constant is not None and np.isfinite(constant):
                ratio[drive] = group.torque_constant / constant
        scale = DriveScale.stack([group.scale for group in self.members])
        return replace(with_torque(signals, ratio), scale=scale)

    @cached_property
    def base(self) -> BasePower | None:
        """Power of the model's base, None without one; InputError for gaps in joint signals."""
        found = power_under(self.judge.recordings, self.model)
        if found is None:
            return None
        if len(found.power) != len(self.prepared.signals.time):
            raise InputError('the recording has samples without position, velocity or torque')
        copper = np.array([group.copper for group in self.members])
        return BasePower(np.asarray(found.power, np.float64), copper)

    @cached_property
    def metered(self) -> Floats:
        """Power of the meters with their delays taken out, W [N, M]."""
        if self.judge.refits(self.model):
            return self.prepared.power_at(self.members[0].delay)
        out = self.prepared.power_at(0.0)
        for index, delay in enumerate(self.judge.score(self.model).delays):
            rows = self.prepared.recording == index
            out[rows] = self.prepared.power_at(delay)[rows]
        return out

    @property
    def masks(self) -> Masks:
        """Boolean masks [N, D] of the rows in each phase, by name of the phase."""
        return self._described[1]

    @cached_property
    def _described(self) -> tuple[Mapping[str, Floats], Masks]:
        state, labels = describe_state(self.prepared, self.judge.recordings)
        still = self.prepared.signals.scale.standstill
        return state, phase_masks(state['torque'], state['velocity'], still, labels.get('phase'))

    @cached_property
    def _robot_masks(self) -> Masks:
        """Rows [N, 1] of the phases of a robot that has one meter: those of its shaft power."""
        state, masks = self._described
        torque, velocity = state['torque'], state['velocity']
        shaft = (torque * velocity).sum(axis=1, keepdims=True)
        rest = masks['rest'].all(axis=1, keepdims=True)
        return phase_masks(shaft, np.where(rest, 0.0, 1.0), np.full(1, 0.5), None)

    def tallies(self) -> tuple[PartsOverTime, list[dict[str, Tally]]]:
        """Return the parts over time and, for each recording, tallies by drive, type and robot."""
        prepared, names = self.prepared, self.prepared.signals.names
        state, masks = self._described
        found: list[dict[str, Tally]] = [{} for _ in prepared.recordings]
        whole: list[list[Tally]] = [[] for _ in prepared.recordings]
        power: list[Singles] = []
        parts: tuple[str, ...] = ()
        for drive, account in enumerate(self._drives()):
            power.append(account.power.astype(np.float32))
            parts = account.parts
            own = {phase: rows[:, drive] for phase, rows in masks.items()}
            unknown = np.full(len(prepared.time), np.nan)
            meter = unknown if prepared.whole else self.metered[:, drive]
            for index in range(len(found)):
                found[index][names[drive]] = self._tally(account, index, own, meter)
                if prepared.whole:
                    robot = {phase: rows[:, 0] for phase, rows in self._robot_masks.items()}
                    share = self.metered[:, 0] / len(names)
                    whole[index].append(self._tally(account, index, robot, share))
        for index, tallies in enumerate(found):
            self._add_groups(tallies, whole[index], index)
        over_time = PartsOverTime(
            names=names,
            parts=parts,
            power=np.stack(power, axis=1),
            metered=self.metered,
            state=state,
            masks=masks,
            stretches=prepared.reducer.stretches(),
        )
        return over_time, found

    @property
    def together(self) -> list[list[int]]:
        """Indices of drives to evaluate jointly: one each, unless an effect couples the drives."""
        drives = range(len(self.members))
        apart = all(active.per_drive for active in self.model.structure.actives)
        return [[drive] for drive in drives] if apart else [[*drives]]

    def _drives(self) -> Iterator[DriveAccount]:
        """Accounts of the drives in their order."""
        signals, structure, draws = self.signals, self.model.structure, self.draws
        for drives in self.together:
            seen, base = signals, self.base
            if len(drives) < len(signals.names):
                seen, base = seen.drive(drives[0]), base and base.drive(drives[0])
            found = split(structure, self.coefficients[drives], seen, base)
            small = reduced(found, self.prepared.reduced)
            for place, drive in enumerate(drives):
                changes = draws.coefficients[:, drive] - self.coefficients[drive]
                scale = draws.torque_scale[:, drive]
                yield DriveAccount.of(small.drive(place), changes, scale, self._errors(drive))

    def _errors(self, drive: int) -> tuple[Floats, Floats, Floats] | None:
        """Errors of a drive's meter that were fitted with the model, as an account takes them."""
        draws = self.draws
        if not draws.terms or self.prepared.whole:
            return None
        builder = DesignBuilder(self.prepared.drive(drive))
        found = builder.beside(draws.terms, draws.structure, draws.point[[drive]])
        values = draws.measured[drive]
        columns = np.concatenate([column[:, 0] for column in found], axis=1)
        return columns, values, draws.measurement[:, drive] - values

    def _tally(self, account: DriveAccount, index: int, masks: Masks, meter: Floats) -> Tally:
        rows = self.prepared.recording == index
        block, often = self._blocks[index]
        return account.tally(rows, masks, meter, block, often)

    @cached_property
    def _blocks(self) -> list[tuple[NDArray[np.intp], Floats]]:
        """Of each recording: second or point of each row [N]; how often each is drawn [R, B]."""
        length = 1 if self.prepared.steady else round(REDUCED_RATE)
        numbers = blocks_of(self.prepared.reducer.stretches(), length)
        found = []
        for index in range(len(self.prepared.recordings)):
            rows = self.prepared.recording == index
            own = np.where(rows, numbers - numbers[rows].min(), 0)
            found.append((own, self._often(int(own.max()) + 1, index)))
        return found

    def _often(self, count: int, index: int) -> Floats:
        together = 1 if self.prepared.steady else self.judge.settings.fit.drawn_together
        return drawn_blocks(count, self._count, together, self.seed + 1 + index)

    def _add_groups(self, tallies: dict[str, Tally], whole: list[Tally], index: int) -> None:
        """Types of drives, and the robot with its electronics."""
        names, drives = self.prepared.signals.names, list(tallies.values())
        for kind, own in assign(names, infer_types(names)).items():
            if 1 < len(own) < len(names) and kind not in tallies:
                tallies[kind] = Tally.beside([drives[drive] for drive in own])
        if self.prepared.whole:
            robot = Tally.beside(whole)
            tallies[WHOLE] = replace(robot, counts=robot.counts / len(names), drives=1)
            for member, tally in tallies.items():
                parts = tuple(ELECTRONICS if part == 'idle' else part for part in tally.parts)
                tallies[member] = replace(tally, parts=parts)
        elif len(names) > 1:
            robot, electronics = Tally.beside(drives), self._electronics(index)
            if electronics is not None:
                robot = robot.with_constant(ELECTRONICS, electronics)
            tallies[WHOLE] = robot

    def _electronics(self, index: int) -> Floats | None:
        """W [1 + R] that the robot draws beside its drives; None where that is not known."""
        loaded = self.judge.recordings
        data = loaded.data
        joints = loaded.recordings[0].joints if loaded.recordings else data.names
        rest = data.supply.astype(np.float64) - data.power.sum(axis=1)
        known = np.isfinite(rest) & (data.recording == index)
        if not known.any() or not {*joints} <= {*data.names}:
            return None
        _, second = np.unique(np.floor(data.time[known]), return_inverse=True)
        sums, counts = np.bincount(second, rest[known]), np.bincount(second)
        often = self._often(len(sums), index)
        estimate = sums.sum() / counts.sum()
        return np.concatenate([[estimate], (often @ sums) / np.maximum(often @ counts, 1)])
