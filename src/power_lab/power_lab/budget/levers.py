"""Levers: what changes of the drives would save at the same motion of the joints."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from power_estimator.effects import Signals
from power_estimator.effects.effect import LEVERS
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.split import split
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

from power_lab.budget.accounts import DRAWS, Accounts
from power_lab.budget.draws import with_torque
from power_lab.budget.tally import interval

_SECONDS: Final = 120.0  # that a change is computed on: longer recordings in pieces
_SCALING: Final = 0.1  # of an effect's change, by which it scales otherwise: as formulas depart
_SMALL: Final = 0.1  # change of each lever in the table
_EITHER: Final = ('gear_ratio', 'supply_voltage')  # may save in either direction


@dataclass(frozen=True)
class Lever:
    """Change of the mean power in W by a change such as `gear_ratio=1.1`; negative saves."""

    change: str
    mean_w: float
    interval: tuple[float, float]  # 90 %


def parse_changes(text: str) -> dict[str, float]:
    """Parse `gear_ratio=1.2,idle=0.5`: factors; InputError for what is no lever or no factor."""
    found: dict[str, float] = {}
    for item in filter(None, (part.strip() for part in text.split(','))):
        name, _, value = item.partition('=')
        try:
            factor = float(value)
        except ValueError:
            factor = np.nan
        if name not in LEVERS:
            raise InputError(f'--change {item!r}: {name!r} is none of {", ".join(LEVERS)}')
        if not 0.0 < factor <= 10.0:
            raise InputError(f'--change {item!r}: give a factor up to 10, as {name}=1.1')
        if name in found:
            raise InputError(f'--change names {name} twice')
        found[name] = factor
    return found


def saved(
    accounts: Accounts, changes: Mapping[str, float], misfit: float
) -> tuple[list[Lever], list[str]]:
    """Estimate what changes of the drives save; return levers, and why others cannot be judged.

    changes: factor by lever, judged one by one and all together; without any, 10 % of each lever,
    the largest saving first. misfit: share of the power that is unexplained, which widens
    intervals. InputError for a given change that the model cannot predict.
    """
    trial = _Trial(accounts, misfit)
    if changes:
        alone = [{name: factor} for name, factor in changes.items()]
        asked = [*alone, dict(changes)] if len(alone) > 1 else alone
        return [trial.lever(one) for one in asked], []
    found, refused = [], []
    for name in LEVERS:
        try:
            factors = [1.0 - _SMALL, 1.0 + _SMALL] if name in _EITHER else [1.0 - _SMALL]
            both = [trial.lever({name: factor}) for factor in factors]
        except InputError as error:
            refused.append(str(error))
        else:
            found.append(min(both, key=lambda lever: lever.mean_w))
    return sorted(found, key=lambda lever: lever.mean_w), refused


class _Trial:
    """The model on some of the samples, as it is and with changes."""

    def __init__(self, accounts: Accounts, misfit: float) -> None:
        self._accounts, self._misfit = accounts, misfit
        prepared = pieces(accounts.prepared, _SECONDS)
        part = prepared.part
        self._signals = accounts.signals
        if part is not None:
            self._signals = accounts.signals.rows(part.samples, prepared.signals.segment)
        self._unseen = 1.0 - len(self._signals.time) / len(accounts.signals.time)
        self._fixed = [a.name for a in accounts.model.structure.actives if a.effect.fixed]
        self._before = self._mean(self._signals, accounts.coefficients)

    def lever(self, changes: Mapping[str, float]) -> Lever:
        """Change of the power of all drives by changes of them."""
        accounts = self._accounts
        factors = np.ones(accounts.coefficients.shape[1])
        signals = self._signals
        for name, factor in changes.items():
            factors = factors * carried_over(accounts.model, signals, name, factor)
            if name == 'supply_voltage':
                signals = replace(signals, voltage=signals.voltage * factor)
            if name == 'payload':
                signals = self._loaded(signals, factor)
        after = self._mean(signals, accounts.coefficients * factors)
        moved = accounts.draws.coefficients - accounts.coefficients
        by_effect = {name: watts - self._before[0][name] for name, watts in after[0].items()}
        change = sum(by_effect.values())
        random = np.random.default_rng([accounts.seed, 2])
        drawn = ((after[1] * factors - self._before[1]) * moved).sum(axis=(1, 2))
        drawn = change + (1.0 + self._misfit) * drawn
        for name, own in by_effect.items():
            share = self._misfit if name in self._fixed else np.hypot(self._misfit, _SCALING)
            drawn += share * own * random.standard_normal(DRAWS)
        drawn += self._unseen_w(after[2] - self._before[2]) * random.standard_normal(DRAWS)
        low, high = interval(np.concatenate([[change], drawn])).tolist()
        text = ','.join(f'{name}={factor:g}' for name, factor in changes.items())
        return Lever(text, float(change), (low, high))

    def _loaded(self, signals: Signals, factor: float) -> Signals:
        """Torque times a factor: of legs that stand, where it is known which do."""
        prepared, masks = self._accounts.prepared, self._accounts.masks
        stands = masks.get('stance', masks['all'])
        near = np.searchsorted(prepared.time, signals.time).clip(0, len(prepared.time) - 1)
        return with_torque(signals, np.where(stands[near], factor, 1.0))

    def _unseen_w(self, change: Floats) -> float:
        """Deviation of the mean of a change [T] in W, for what lies between the pieces."""
        second = round(self._signals.rate)
        whole = change[: len(change) // second * second].reshape(-1, second).mean(axis=1)
        return float(np.sqrt(self._unseen * whole.var() / len(whole))) if len(whole) else 0.0

    def _mean(
        self, signals: Signals, coefficients: Floats
    ) -> tuple[dict[str, float], Floats, Floats]:
        """Mean power of all drives by effect, W, its slopes [D, m], and its sum [T]."""
        accounts = self._accounts
        slopes = np.zeros_like(coefficients)
        total: dict[str, float] = defaultdict(float)
        over_time = np.zeros(len(signals.time))
        for drives in accounts.together:
            seen = signals.drive(drives[0]) if len(drives) < len(signals.names) else signals
            found = split(accounts.model.structure, coefficients[drives], seen)
            for name, values in found.parts.items():
                total[name] += float(values.mean(axis=0).sum())
                over_time += values.sum(axis=1)
            for (_, column), values in found.slopes.items():
                slopes[drives, column] += values.mean(axis=0)
        return total, slopes, over_time


def carried_over(model: EffectModel, signals: Signals, lever: str, factor: float) -> Floats:
    """Factors [m] on a model's coefficients when a lever changes by a factor.

    InputError where the model does not say how an effect's coefficients change, naming the effect.
    """
    if model.base is not None:
        raise InputError(f'{lever}: what becomes of the base model {model.base} is not known')
    at_motor = [name for name, own in zip(signals.names, signals.at_motor, strict=True) if own]
    if at_motor and lever in ('gear_ratio', 'friction', 'payload'):
        raise InputError(
            f"{lever}: the torque of {', '.join(at_motor)} is the motor's, with friction and "
            'rotor inertia in it, which change otherwise'
        )
    factors: list[float] = []
    for active in model.structure.free:
        effect = active.effect
        exponents = (0.0,) * len(effect.terms)
        if lever in ('gear_ratio', 'winding_resistance') or lever in (effect.scaling or {}):
            given = None if effect.scaling is None else effect.scaling.get(lever, exponents)
            if given is None:
                raise InputError(f'{lever}: what becomes of {active.name} is not known')
            exponents = given
        factors += [factor**exponent for exponent in exponents]
    return np.array(factors)
