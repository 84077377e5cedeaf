"""Both sides of a gear: torque at the joint beside the motor's current.

The power balance is written twice, with the torque of either side:
P = Kt·i·w + losses and P = a·torque·w + losses, losses = R·i² + s·|i| + b·|w| + c·w² + P0. The
first tells the torque constant without a torque sensor; which of the two the meter follows closer
says whose side it takes. Between the sides Kt·i·w = r·torque·w + drag: the loss of a gear follows
the direction of the power, the scale of a sensor does not, so that only a drive that is driven,
too, tells them apart. At standstill current and temperature are left: the winding.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product
from typing import Any, Literal

import numpy as np
from power_estimator.effects.fit.blocks import Blocks, drawn_blocks
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.model_file.model import FittedValue
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.judge import Judge
from wattwalk_core.arrays import Floats

Verdict = Literal['agree', 'torque scale or gear loss', 'torque scale', 'gear loss', 'both']

_DRAWS = 400  # bootstraps: ten lie beyond either bound of 95 %
_ROUNDS, _GROSS = 3, 100.0  # blocks of more than so many times the median error are left out
_AGREE = 0.05  # torque sensors are good to 4 %
_DRIVEN = 0.05  # share of rows with power from the joint, and of the largest power, that show it
_SHOWN = 0.02  # of the power's spread, that the motor's power has in a drive that is in motion
_LEAST_R2 = 0.1
_TOO_SMALL = 'its current is too small, or read too seldom, to show in its power'
_NOT_APART = 'load and friction do not separate in this motion'
_FEWEST = 10  # blocks, or points
_ALONE = 1e-3  # share of a column's spread that no other column has
_SHARP = 0.15  # of a torque constant: data sheets do better
_WORSE = 2.0  # times the unexplained power, at which current and torque contradict each other
_WARMED = 5.0  # K by which seconds differ, for a coefficient of temperature
_COLD = 20.0  # °C at which resistances are stated
_BINS = 4  # of speed, and of load
_LEAST_ROWS, _LEAST_POINTS = 25, 3  # in a bin: half a second
_FREE = ('iw', 'tw', 'back', 'one', 'iit', 'i')  # what may be negative


@dataclass(frozen=True)
class Efficiency:
    """Power at the joint over that of the motor in a range of speed and load, while driving."""

    speed: tuple[float, float]  # rad/s
    load: tuple[float, float]  # N·m
    value: float
    rows: int


@dataclass(frozen=True)
class BothSides:
    """Findings on a drive from its current, torque and power; None where they do not show."""

    drive: str
    torque_constant: FittedValue | None = None  # N·m/A at the joint, from the power balance
    by_torque: FittedValue | None = None  # N·m/A, from the torque sensor at standstill
    resistance: FittedValue | None = None  # W/A²; of a winding that warms at 20 °C
    temperature_coefficient: FittedValue | None = None  # 1/K, of the resistance
    inverter: FittedValue | None = None  # W/A
    r2_current: float | None = None  # of the power, with the motor's current
    r2_torque: float | None = None  # with the torque at the joint
    ratio: FittedValue | None = None  # W that the motor makes for each W at the joint
    scale: FittedValue | None = None  # of the torque sensor, where motion tells it from the gear
    gear_loss: FittedValue | None = None  # share of the load, likewise
    drag: tuple[float, float] | None = None  # N·m, and N·m·s/rad, between motor and joint
    loss_w: float | None = None  # mean W between motor and joint, while driving
    verdict: Verdict | None = None
    efficiency: tuple[Efficiency, ...] = ()
    remark: str = ''  # why no more is said

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `fit --json` writes them."""
        return {**asdict(self), 'text': self.lines()}

    def lines(self) -> list[str]:
        """Sentences on the findings, one for each quantity."""
        at = '' if self.temperature_coefficient is None else ' at 20 °C'
        parts = [
            (self.torque_constant, '{} N·m/A at the joint, from the power that its current makes'),
            (self.by_torque, '{} N·m/A by the torque sensor at standstill'),
            (self.resistance, '{} W/A² of motor current in the winding' + at),
            (self.temperature_coefficient, '{}/K of it more when warm (copper: 0.0039)'),
        ]
        lines = [text.format(_shown(value)) for value, text in parts if value is not None]
        lines += [self._between()] if self.verdict is not None else []
        lines += [self.remark] if self.remark else []
        return [f'{self.drive}: {line}' for line in lines]

    def _between(self) -> str:
        assert self.ratio is not None
        head = f'a watt at the joint takes {_shown(self.ratio)} W of the motor'
        if self.r2_current is not None and self.r2_torque is not None:
            sides = (self.r2_current, 'current'), (self.r2_torque, 'torque')
            (r2, closer), (less, other) = sorted(sides, reverse=True)
            head += f'; the power follows the {closer} (R² {r2:.4f}) closer than the '
            head += f'{other} ({less:.4f})'
        if self.verdict == 'agree':
            return f'{head}: current and torque agree'
        if self.scale is not None:
            reads = f'the torque sensor reads {_shown(self.scale)} of the torque'
            if self.gear_loss is not None:
                reads += f', the gear takes {_shown(self.gear_loss)} of the load'
            return f'{head}: {self.verdict}; {reads}'
        share = 1.0 / self.ratio.value
        return (
            f'{head}: {self.verdict}. Either the torque sensor reads {share:.2f} of the torque, '
            f'or the gear loses {1.0 - share:.0%} of the load ({self.loss_w or 0.0:.3g} W in the '
            'mean with its drag). A known weight on a lever decides, or a load that drives the '
            f'motor: a scale stays {share:.2f}, the loss of a gear turns round'
        )


def both_sides(judge: Judge, seed: int = 0) -> dict[str, BothSides]:
    """Compare current and torque by drive, for drives that have both; {} for none.

    The torque is that at the joint. seed: of the bootstraps that give 95 % intervals.
    """
    prepared, settings = judge.prepared, judge.settings.fit
    current, signals = prepared.signals.motor_current, prepared.signals
    if current is None or prepared.whole:
        return {}
    known = np.isfinite(current).any(axis=0) & ~signals.at_motor
    found = {}
    for drive in np.flatnonzero(known).tolist():
        name = signals.names[drive]
        found[name] = _Drive(prepared, settings, drive, seed).found()
        if name in judge.recordings.data.computed_power:
            remark = 'its power is computed from its current: these are figures of that formula'
            found[name] = replace(found[name], remark=remark)
    return found


class _Drive:
    """Products of one drive at 50 Hz, or at its operating points, and regressions on them."""

    def __init__(self, prepared: Prepared, settings: FitSettings, drive: int, seed: int) -> None:
        signals = prepared.signals
        assert signals.motor_current is not None
        known = signals.motor_current, signals.torque, signals.velocity
        amps, torque, speed = (values[:, drive] for values in known)
        self.name, self._steady = signals.names[drive], prepared.steady
        temperature = signals.temperature[:, drive]
        products = {
            'i': amps,
            'iw': amps * speed,
            'ii': amps**2,
            'iit': amps**2 * np.nan_to_num(temperature - _COLD),
            'amps': np.abs(amps),
            'tw': torque * speed,
            'back': np.minimum(torque * speed, 0.0),
            'speed': np.abs(speed),
            'speed2': speed**2,
            'inertia': speed * signals.acceleration[:, drive],
            'one': np.ones_like(amps),
            'torque': torque,
            'temperature': temperature,
        }
        self._all = {name: prepared.reduced(values) for name, values in products.items()}
        self._power = np.asarray(prepared.power[:, :, drive], np.float64)
        blocks = Blocks.of(prepared, settings)
        needed = [own for name, own in self._all.items() if name != 'temperature']
        finite = np.isfinite(np.sum(needed, axis=0))[blocks.rows].all(axis=1)
        self._blocks = blocks.rows[blocks.valid[:, drive] & finite]
        together = 1 if blocks.independent else settings.drawn_together
        self._drawn = drawn_blocks(len(self._blocks), _DRAWS, together, seed)

    def found(self) -> BothSides:
        """All that the recording shows."""
        power = self._power[0][self._blocks.ravel()]
        if len(self._blocks) < _FEWEST or not power.std() > 0.0:
            return BothSides(self.name, remark=_TOO_SMALL)
        columns = np.stack([self._of(name) for name in ('iw', 'ii', 'one')], axis=1)
        slope = float(np.linalg.lstsq(columns, power, rcond=None)[0][0])
        if abs(slope) * self._of('iw').std() < _SHOWN * power.std():
            return self._at_standstill()
        losses = ('ii', 'amps', 'speed', 'speed2', 'one')
        motor, r2 = self._fits(('iw', *losses))
        joint, other = self._fits(('tw', *losses))
        better = motor if r2 > other else joint
        found = BothSides(
            self.name,
            resistance=_shows(_value(better[:, 1])),
            inverter=_shows(_value(better[:, 2])),
            r2_current=r2,
            r2_torque=other,
        )
        if max(r2, other) < _LEAST_R2:
            return BothSides(self.name, remark=_TOO_SMALL)
        constant = _value(motor[:, 0])
        if 1.0 - r2 > _WORSE * (1.0 - other):
            remark = (
                f'the power follows the torque (R² {other:.4f}) and not the current ({r2:.4f}): '
                'its readings are noisy, or it makes more than torque (field weakening)'
            )
            return replace(found, remark=remark)
        wide = np.ptp(constant.interval) > _SHARP * constant.value
        if constant.value <= 0.0 or wide or self._alone('iw', losses) < _ALONE:
            remark = 'load and speed vary together: the power does not tell Kt'
            return replace(found, resistance=None, inverter=None, remark=remark)
        efficiency = self._efficiency(constant.value)
        between = self._between(motor[:, 0])
        return replace(found, torque_constant=constant, efficiency=efficiency, **between)

    def _at_standstill(self) -> BothSides:
        blocks = self._all['temperature'][self._blocks].mean(axis=1)
        warmed = bool(np.isfinite(blocks).all()) and float(np.ptp(blocks)) > _WARMED
        power, r2 = self._fits(('ii', *(('iit',) if warmed else ()), 'one'))
        by_torque, _ = self._fits(('i', 'one'), self._all['torque'])
        resistance = _shows(_value(power[:, 0]))
        if resistance is None:
            return BothSides(self.name, remark=_TOO_SMALL)
        warm = _value(power[:, 1] / np.maximum(power[:, 0], 1e-12)) if warmed else None
        return BothSides(
            self.name,
            by_torque=_shows(_value(by_torque[:, 0])),
            resistance=resistance,
            temperature_coefficient=warm,
            r2_current=r2,
        )

    def _between(self, constants: Floats) -> dict[str, Any]:
        """Find what lies between motor and joint; constants: N·m/A [1 + R] of the bootstraps."""
        drag = ('speed', 'speed2', *(() if self._steady else ('inertia',)))
        shaft, motor = self._of('tw'), constants[0] * self._of('iw')
        sides, _ = self._fits(('tw', *drag), self._all['iw'])
        found: dict[str, Any] = {'ratio': _value(constants * sides[:, 0])}
        found['drag'] = tuple(float(f'{constants[0] * drag:.4g}') for drag in sides[0, 1:3])
        if found['ratio'].value <= 0.0:
            return {'remark': _NOT_APART}
        driving = shaft > 0.0
        found['loss_w'] = float((motor - shaft)[driving].mean()) if driving.any() else 0.0
        driven = float((shaft < -_DRIVEN * np.quantile(np.abs(shaft), 0.95)).mean())
        if min(driven, float(driving.mean())) < _DRIVEN:
            if found['ratio'].value < 1.0 - _AGREE:  # no gear gains
                scale = _value(1.0 / (constants * sides[:, 0]))
                return {**found, 'scale': scale, 'verdict': 'torque scale'}
            agree = abs(found['ratio'].value - 1.0) < _AGREE
            return {**found, 'verdict': 'agree' if agree else 'torque scale or gear loss'}
        # Kt·i·w = (torque·w + c·|torque·w|)/scale + drag, and |x| = x − 2·min(x, 0).
        sides, _ = self._fits(('tw', 'back', *drag), self._all['iw'])
        ahead, turned = constants * sides[:, 0], -constants * sides[:, 1] / 2
        found['ratio'] = _value(ahead)
        scale = found['scale'] = _value(1.0 / (ahead - turned))
        loss = found['gear_loss'] = _value(turned / (ahead - turned))
        if min(found['ratio'].value, scale.value) <= 0.0 or loss.value < -_AGREE:
            return {'remark': _NOT_APART}
        off = abs(scale.value - 1.0) > _AGREE and not scale.interval[0] <= 1.0 <= scale.interval[1]
        lost = loss.value > _AGREE and loss.interval[0] > 0.0
        verdicts = {(1, 1): 'both', (1, 0): 'torque scale', (0, 1): 'gear loss', (0, 0): 'agree'}
        return {**found, 'verdict': verdicts[off, lost]}

    def _efficiency(self, constant: float) -> tuple[Efficiency, ...]:
        speed, load = self._of('speed'), np.abs(self._of('torque'))
        shaft, motor = self._of('tw'), constant * self._of('iw')
        used = (shaft > 0.0) & (motor > 0.0)
        if not used.any():
            return ()
        shares = np.linspace(0.02, 0.98, _BINS + 1)
        edges = [np.unique(np.quantile(own[used], shares)).tolist() for own in (speed, load)]
        least, found = _LEAST_POINTS if self._steady else _LEAST_ROWS, []
        for (slow, fast), (light, heavy) in product(*map(pairwise, edges)):
            own = used & (slow <= speed) & (speed <= fast) & (light <= load) & (load <= heavy)
            if own.sum() >= least:
                value = float(shaft[own].sum() / motor[own].sum())
                found.append(Efficiency((slow, fast), (light, heavy), value, int(own.sum())))
        return tuple(found)

    def _of(self, name: str) -> Floats:
        """Values of the rows that count."""
        return self._all[name][self._blocks.ravel()]

    def _alone(self, name: str, others: Sequence[str]) -> float:
        """Share of the spread of a column that no linear combination of others has."""
        own, table = self._of(name), np.stack([self._of(other) for other in others], axis=1)
        table = table / np.maximum(np.abs(table).max(axis=0), 1e-12)
        left = own - table @ np.linalg.lstsq(table, own, rcond=None)[0]
        return float(left.var() / own.var())

    def _fits(self, names: Sequence[str], target: Floats | None = None) -> tuple[Floats, float]:
        """Coefficients [1 + R, m] of all blocks and of each bootstrap, and R².

        target: [N], without one the power at the delay that leaves the least error. Losses are
        not negative.
        """
        columns = np.stack([self._all[name] for name in names], axis=1)[self._blocks]
        least = np.array([-np.inf if name in _FREE else 0.0 for name in names])
        bounds = least, np.full(len(names), np.inf)
        gram = columns.transpose(0, 2, 1) @ columns
        best: tuple[float, Floats, Floats, Floats] | None = None
        for values in self._power if target is None else target[None]:
            own = values[self._blocks]
            moment = (columns.transpose(0, 2, 1) @ own[..., None])[..., 0]
            weights = np.ones(len(own))
            for _ in range(_ROUNDS):
                sums = np.einsum('b,bij->ij', weights, gram)[None], (weights @ moment)[None]
                found = bounded_solve(*sums, *bounds)[0]
                error = np.square(own - columns @ found).mean(axis=1)
                weights = (error <= _GROSS * np.median(error)).astype(np.float64)
            size = float(error @ weights / weights.sum())
            if best is None or size < best[0]:
                best = size, moment, own, weights
        assert best is not None
        _, moment, own, weights = best
        counted = np.vstack([np.ones(len(gram)), self._drawn]) * weights
        grams = (counted @ gram.reshape(len(gram), -1)).reshape(-1, len(names), len(names))
        solved = bounded_solve(grams, counted @ moment, *bounds)
        own, columns = own[weights > 0.0], columns[weights > 0.0]
        left = np.square(own - columns @ solved[0]).mean()
        return solved, 1.0 - float(left / own.var())


def _value(draws: Floats) -> FittedValue:
    """The first of the draws, with the middle 95 % of the others."""
    low, high = np.quantile(draws[1:], [0.025, 0.975]).tolist()
    return FittedValue(float(draws[0]), (low, high))


def _shows(found: FittedValue) -> FittedValue | None:
    """A value that differs from 0; None for others."""
    low, high = found.interval
    return found if low * high > 0.0 else None


def _shown(found: FittedValue) -> str:
    return '{:.3g} ({:.3g} … {:.3g})'.format(found.value, *found.interval)
