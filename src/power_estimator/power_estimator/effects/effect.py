"""What a physical effect is to a power model."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.signals import Signals

Floats = NDArray[np.float64]
Shape = Mapping[str, float]

STANDSTILL = 0.05
"""Speed in rad/s below which the sign of the velocity fades out, as friction's does."""


@dataclass(frozen=True)
class Term:
    """One coefficient of an effect: its symbol, its SI unit and the bounds physics sets it."""

    symbol: str
    unit: str
    lower: float = 0.0
    upper: float = np.inf
    prior: float = np.inf  # spread known beforehand; finite for measurement terms


@dataclass(frozen=True)
class Excitation:
    """A motion that sets an effect apart from its look-alikes; units are SI."""

    text: str
    mode: Literal['velocity', 'position', 'torque'] = 'velocity'
    speeds: tuple[float, ...] = ()  # rad/s, each held
    loads: tuple[float, ...] = (0.0,)  # N·m
    seconds: float = 3.0  # for each speed and load
    frequency: float = 0.0  # Hz, for reversals
    amplitude: float = 0.0  # rad, for reversals
    supply: tuple[float, ...] = ()  # V, bus voltages to repeat the motion at


class Effect(ABC):
    """
    A physical effect with coefficients that are linear in the power once its shape is fixed.

    An effect that acts on 'power' gives watts per unit coefficient. One that acts on 'torque'
    gives the extra motor torque in N·m per unit coefficient; the model turns it into power
    through the motor's speed and through every effect that depends on the motor's torque
    (facts on friction: f·w + 2·k·torque·f + k·f²).

    To make an effect of your own, derive from this class in a file, give the attributes
    without a default and `regressors`, and name the file with --effects-path.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    formula: ClassVar[str]
    terms: ClassVar[tuple[Term, ...]]
    excitation: ClassVar[Excitation]
    acts_on: ClassVar[Literal['power', 'torque']] = 'power'
    kind: ClassVar[Literal['physics', 'measurement']] = 'physics'
    ties: ClassVar[tuple[str, ...]] = ()  # cannot be told apart in any recording
    near: ClassVar[tuple[str, ...]] = ()  # told apart by its excitation only
    shapes: ClassVar[tuple[Shape, ...]] = ({},)
    fixed: ClassVar[float | None] = None  # a coefficient that physics fixes

    @abstractmethod
    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """[T, D, n] for the n terms: W per unit coefficient, or N·m where acts_on is 'torque'."""

    def torque_slope(self, signals: Signals, coefficients: Floats) -> Floats | None:
        """Derivative of this effect's power by the motor's torque, W/(N·m) [T, D]."""
        return None

    def usable(self, signals: Signals, **shape: float) -> bool:
        """Whether the signals that this shape needs were recorded."""
        return True


def smooth_sign(velocity: Floats) -> Floats:
    """The sign of the velocity, fading out at standstill."""
    return np.tanh(velocity / STANDSTILL)
