"""Orders of cogging, from periods over the position in what a model leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from wattwalk_core.arrays import Bools, Floats

from power_estimator.effects.effect import Effect, Shape
from power_estimator.effects.fit.fitter import Fit
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.signals.reducer import CUTOFF
from power_estimator.effects.signals.state import Signals

PERIODIC: Final = 'cogging'  # the effect whose order is searched
_LEAST = 6.0  # periods of a turn: the fewest that poles and slots make
_PERIODS = 2.0  # in the span of the position, at least: fewer are any function of it
_SHOWN = 0.1  # share of the moving rows that has to show an order
_PADDED = 8  # places of the spectrum for each order that the span tells apart
_TAKEN = 5  # highest peaks, each of which is fitted
_LOBES = 4.0  # orders that the span tells apart: so near a peak are its lobes, if there are many
_MOST_PLACES = 2**20  # of the position: some 10 ms of FFT


@dataclass(frozen=True)
class Orders:
    """Orders of cogging that stand out, the highest peak first."""

    found: tuple[float, ...] = ()
    tried: float = 1.0  # number of orders that the position tells apart

    def shapes(self, effect: Effect, signals: Signals) -> list[Shape]:
        """Return the shapes of cogging with these orders that signals can show."""
        shapes: list[Shape] = [{'order': order} for order in self.found]
        return [shape for shape in shapes if effect.usable(signals, **shape)]


@dataclass(frozen=True)
class ErrorsByPosition:
    """Errors of a model of a drive's power at K rows of a recording, each by its position."""

    position: Floats  # rad, from 0 [K]
    error: Floats  # W·W/(N·m), times the power's slope by the motor's torque; may be weighted [K]
    shows: Floats  # highest order that passes the low-pass at the speed of each row [K]

    @property
    def highest(self) -> float:
        """Order that a tenth of the rows show."""
        return float(np.quantile(self.shows, 1.0 - _SHOWN))

    def heights(self, orders: Floats, places: int) -> Floats:
        """Squared Fourier transform at orders of equal steps; about 1 where nothing repeats.

        Each octave of orders takes the rows that show its least: faster ones have noise only.
        """
        out, lower, step = np.zeros(len(orders)), _LEAST, orders[1] - orders[0]
        at = (self.position * (places * step / (2 * np.pi))).astype(np.intp) % places
        while lower < self.highest:
            shown = self.shows >= lower
            binned = np.bincount(at[shown], weights=self.error[shown], minlength=places)
            octave = (orders >= lower) & (orders < min(2 * lower, self.highest))
            squares = np.square(np.abs(np.fft.rfft(binned)[octave]))
            out[octave] = squares / max(np.sum(np.square(self.error[shown])), 1e-300)
            lower *= 2
        return out


def errors_by_position(
    prepared: Prepared, rows: NDArray[np.intp] | Bools, error: Floats, slope: Floats
) -> list[ErrorsByPosition]:
    """Return the errors of a meter's model by recording and drive that moves.

    error: W, may be weighted, at rows [K]; slope: of the power by the motor's torque, W/(N·m),
    with the same weight [N, D].
    """
    signals, out = prepared.signals, []
    position = prepared.reduced(signals.position)[rows]
    speed = np.abs(prepared.reduced(signals.velocity))[rows]
    recording = prepared.recording[rows]
    for d in np.flatnonzero(np.isfinite(position).all(axis=0)):
        score = slope[rows, d] * error
        moves = (speed[:, d] > signals.scale.standstill[d]) & (score != 0.0)
        for one in np.unique(recording[moves]):
            own = moves & (recording == one)
            at = position[own, d] - position[own, d].min()
            found = ErrorsByPosition(at, score[own], 2 * np.pi * CUTOFF / speed[own, d])
            if at.max() * found.highest >= _PERIODS * 2 * np.pi:
                out.append(found)
    return out


def orders_of_fit(fit: Fit) -> Orders:
    """Find the orders at which the error of a fit repeats."""
    prepared, error = fit.fitter.prepared, fit.residual()
    at = fit.fitter.builder.point(fit.structure, fit.coefficients).signals
    slope = prepared.reduced(at.motor_velocity + at.torque_cost)
    errors = []
    for m in range(error.shape[1]):
        rows = np.isfinite(error[:, m]) & prepared.resolved[:, m]
        own = slope if prepared.whole else slope[:, [m]]
        one = prepared if prepared.whole else prepared.drive(m)
        errors += errors_by_position(one, rows, error[rows, m], own)
    return orders_of(errors)


def orders_of(errors: Sequence[ErrorsByPosition]) -> Orders:
    """Find the orders at which errors repeat over the position of drives.

    A drive's cogging acts in proportion to the power's slope by the torque. The squared Fourier
    transform of error times slope over the position peaks at its order. A peak that can't be told
    from a whole number gives that, and itself.
    """
    if not errors:
        return Orders()
    span = max(float(one.position.max()) for one in errors)
    apart, length = 2 * np.pi / span, _PADDED * span
    least = max(_LEAST, _PERIODS * apart)
    most = min(max(one.highest for one in errors), _MOST_PLACES * apart / (4 * _PADDED))
    if most <= least:
        return Orders()
    places = next_fast_len(int(np.ceil(2 * length * most / np.pi)), real=True)
    orders = apart / _PADDED * np.arange(places // 2 + 1)
    height = np.zeros(len(orders))
    for one in errors:
        height += one.heights(orders, places)
    height[(orders < least) | (orders > most)] = 0.0
    tried = max((most - least) / apart, 1.0)
    near = min(_LOBES, tried / (2 * _TAKEN))
    found: list[float] = []
    for _ in range(_TAKEN):
        order = float(orders[np.argmax(height)])
        if not height.any():
            break
        height[np.abs(orders - order) < near * apart] = 0.0
        whole = float(round(order))
        found += [whole, order] if abs(order - whole) < apart / 2 else [order]
    return Orders(tuple(dict.fromkeys(found)), tried)
