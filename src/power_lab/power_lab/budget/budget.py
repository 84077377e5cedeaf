"""Energy budgets: where the metered power goes, by effect, drive and phase of the motion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from power_estimator.drive_types import assign, infer_types
from power_estimator.effects import Signals
from power_estimator.effects.fit.blocks import one_thread_a_product
from power_estimator.effects.fit.design import Structure, evaluate
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.judge.judge import Judge
from wattwalk_core.arrays import Floats

from power_lab.budget.account import Account, BudgetDifference
from power_lab.budget.accounts import DRAWS, Accounts, PartsOverTime
from power_lab.budget.levers import Lever, saved
from power_lab.budget.tables import headline, tables
from power_lab.budget.tally import Tally, interval


@dataclass(frozen=True)
class Steady:
    """Model of one drive in steady motion, at a recording's median voltage and temperature."""

    drive: int
    structure: Structure
    coefficients: Floats  # [1, m]
    signals: Signals  # of that drive, D = 1

    def power(self, speed: Floats, torque: Floats) -> Floats:
        """Power, W [G], at speeds in rad/s and torques in N·m [G], without effects with memory."""
        count, nothing = len(speed), np.zeros((len(speed), 1))
        own = self.signals
        steady = replace(
            own,
            time=np.arange(count) / own.rate,
            segment=np.zeros(count, np.int32),
            recording=np.zeros(count, np.int32),
            position=nothing,
            velocity=speed[:, None],
            motor_velocity=speed[:, None],
            acceleration=nothing,
            motor_acceleration=nothing,
            torque=torque[:, None],
            motor_torque=torque[:, None],
            torque_rate=nothing,
            torque_cost=nothing,
            electronics=nothing,
            drawn=(torque * speed)[:, None],
            voltage=np.full((count, 1), np.median(own.voltage)),
            temperature=np.full((count, 1), np.median(own.temperature)),
            past=None,
        )
        kept = [
            0.0 if active.effect.remembers else 1.0
            for active in self.structure.free
            for _ in active.effect.terms
        ]
        return evaluate(self.structure, self.coefficients * kept, steady)[:, 0]


@dataclass(frozen=True)
class Budget:
    """Energy budgets of recordings by one model, and the savings by changes of the drives."""

    model: EffectModel
    chosen: bool  # automatically, from the recordings
    accounts: tuple[Account, ...]  # by recording
    account: Account  # of all of them
    pictured: PartsOverTime  # of all recordings, for plots
    levers: tuple[Lever, ...]
    refused: tuple[str, ...]  # levers that the model cannot carry over, and why
    steady: Mapping[str, Steady]  # of the first drive of each type
    battery: float | None  # Wh
    error_w: float  # held-out rms error of the model

    @property
    def origin(self) -> str:
        """Effects of the model, where it came from, and its error, in words."""
        effects = ', '.join(self.model.effects)
        how = 'chosen by its error on held-out data' if self.chosen else self.model.name
        return f'{effects} ({how}; {self.error_w:.2f} W rms on data that it was not fitted on)'

    @cached_property
    def differences(self) -> tuple[BudgetDifference, ...]:
        """Mean power of each recording less that of the first, by drive, phase and part."""
        base = self.accounts[0]
        found = []
        for other in self.accounts[1:]:
            for member, one in base.tallies.items():
                two = other.tallies.get(member)
                if two is None or one.rows != two.rows:
                    continue
                apart = two.means - one.means
                limits = interval(apart)
                for place, part in np.argwhere(np.isfinite(apart[0])).tolist():
                    low, high = limits[place, part].tolist()
                    names = other.name, base.name, member, base.phases[place], one.rows[part]
                    watts = float(apart[0, place, part])
                    found.append(BudgetDifference(*names, watts, (low, high)))
        return tuple(found)

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """Return the budget as text tables, 100 columns wide."""
        return tables(
            sentence=headline(self.account, self.levers),
            model=self.origin,
            accounts=(self.account, *self.accounts),
            differences=self.differences,
            levers=self.levers,
            refused=self.refused,
            battery=self.battery,
        )

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `budget --json` writes them."""
        found = {
            'model': self.model.name,
            'effects': list(self.model.effects),
            'chosen': self.chosen,
            'held_out_rmse_w': self.error_w,
            **self.account.json(),
            'levers': [vars(lever) for lever in self.levers],
        }
        if self.battery:
            found['runtime_h'] = self.account.runtime(self.battery)
        if len(self.accounts) > 1:
            found['recordings'] = [
                {'name': one.name, **one.json()}
                | ({'runtime_h': one.runtime(self.battery)} if self.battery else {})
                for one in self.accounts
            ]
            found['differences'] = [vars(one) for one in self.differences]
        return found


@one_thread_a_product()
def budget(
    judge: Judge,
    model: EffectModel,
    *,
    chosen: bool = False,
    changes: Mapping[str, float] | None = None,
    battery: float | None = None,
    seed: int = 0,
    draws: int = DRAWS,
) -> Budget:
    """Split the metered power of recordings by effect, drive and phase with a fitted model.

    chosen: whether the model was chosen automatically; changes: factor by lever (`gear_ratio`:
    1.1), by default 10 % of each; battery: Wh; draws: number of random draws for intervals, 0 for
    neither intervals nor levers nor error. InputError for a drive or change that the model does
    not cover.
    """
    accounts = Accounts(judge, model, seed, draws)
    rows, tallies = accounts.tallies()
    error_w = judge.score(model).rms_w if draws else np.nan
    phases = tuple(rows.masks)
    of_recordings = tuple(
        Account(known['name'], own, phases)
        for known, own in zip(judge.recordings.identities, tallies, strict=True)
    )
    joined = {
        member: Tally.joined([own[member] for own in tallies])
        for member in tallies[0]
        if all(member in own and own[member].rows == tallies[0][member].rows for own in tallies)
    }
    misfit = error_w / float(np.sqrt(np.nanmean(np.square(rows.metered))))
    levers, refused = saved(accounts, changes or {}, misfit) if draws else ([], [])
    kinds = assign(rows.names, infer_types(rows.names))
    steady = {
        kind: Steady(own[0], model.structure, accounts.coefficients[own[:1]], seen)
        for kind, own in kinds.items()
        if model.base is None and (seen := accounts.signals.drive(own[0]))
    }
    return Budget(
        *(model, chosen, of_recordings, Account('all', joined, phases), rows),
        *(tuple(levers), tuple(refused), steady, battery, error_w),
    )
