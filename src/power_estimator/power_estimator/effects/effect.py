"""Interface of a physical effect."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from power_estimator.effects.signals.scale import STANDSTILL, DriveScale
from power_estimator.effects.signals.state import Signals

Floats = NDArray[np.float64]
Shape = Mapping[str, float]


_ROWS = 20_000  # that quantiles are taken of


@dataclass(frozen=True)
class Term:
    """
    One coefficient of an effect: symbol, SI unit and physical bounds.

    Bounds, prior and least are those of the reference drive (`DriveScale`).
    """

    symbol: str
    unit: str
    lower: float = 0.0
    upper: float = np.inf
    prior: float = np.inf  # spread known beforehand; finite for measurement terms
    least: float = 0.0  # a smaller coefficient is not named
    attained: bool = False  # real drives may lie at the upper bound


@dataclass(frozen=True)
class Excitation:
    """A motion that tells an effect from similar ones; SI units."""

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
    through the motor's speed and through every effect that depends on the motor's torque: for
    friction f that is f·w + 2·k·torque·f + k·f². One that acts on 'speed' gives extra speed of the
    motor in rad/s per unit coefficient.

    To make an effect of your own, derive from this class in a file, give the attributes
    without a default and `regressors`, and name the file with --effects-path.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    formula: ClassVar[str]
    terms: ClassVar[tuple[Term, ...]]
    excitation: ClassVar[Excitation]
    acts_on: ClassVar[Literal['power', 'torque', 'speed']] = 'power'
    kind: ClassVar[Literal['physics', 'measurement', 'discrepancy']] = 'physics'
    needs_joint_torque: ClassVar[bool] = False
    """The torque of the motor contains the effect already."""
    ties: ClassVar[tuple[str, ...]] = ()  # effects that no recording can tell from it
    near: ClassVar[tuple[str, ...]] = ()  # effects that only its excitation tells from it
    rests_on: ClassVar[tuple[str, ...]] = ()  # effects that it changes: it cannot stand for them
    shapes: ClassVar[tuple[Shape, ...]] = ({},)
    fixed: ClassVar[float | None] = None  # a coefficient that physics fixes
    follows: ClassVar[frozenset[str]] = frozenset()  # estimates it uses: motor_torque, drawn
    per_drive: ClassVar[bool] = False
    """
    Each drive's regressors come from its own signals alone. Fits then go drive by drive, several
    at once, with Signals of one drive.
    """
    remembers: ClassVar[bool] = False
    """
    The regressors follow what was seconds before (heat, backlash, rest) from each gap on, so
    that a recording must not be cut into pieces.
    """

    def __init_subclass__(cls) -> None:
        """Let each class say `per_drive` itself: an override may look at other drives."""
        super().__init_subclass__()
        cls.per_drive = bool(vars(cls).get('per_drive', False))

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.name == getattr(other, 'name', None)

    def __hash__(self) -> int:
        return hash(self.name)

    @abstractmethod
    def regressors(self, signals: Signals, **shape: float) -> Floats:
        """Return [T, D, n] for the n terms: W, N·m or rad/s per unit coefficient, by acts_on."""

    def torque_slope(self, signals: Signals, coefficients: Floats) -> Floats | None:
        """Derivative of this effect's power by the motor's torque, W/(N·m) [T, D]."""
        return None

    def drawn_slope(self, signals: Signals, coefficients: Floats, **shape: float) -> Floats | None:
        """Derivative of this effect's power by the power drawn without it [T, D]."""
        return None

    discrepancy_limit: ClassVar[float] = 0.0
    """Largest departure from the formula, as a share of the first coefficient."""

    def discrepancy(self, signals: Signals, **shape: float) -> Floats | None:
        """
        Typical departure of real drives from the formula, [T, D] in the regressors' unit.

        A diagnosis fits it beside every active effect before it names a further effect.
        """
        return None

    def usable(self, signals: Signals, **shape: float) -> bool:
        """Return whether the signals that this shape needs were recorded."""
        return not (self.needs_joint_torque and signals.at_motor.all())

    def factors(self, scale: DriveScale) -> Floats:
        """Factor [D, n] by which the bounds of each term differ from the reference drive's."""
        of_sensor = self.kind == 'measurement'
        return np.stack([scale.factor(t.unit, of_sensor=of_sensor) for t in self.terms], axis=-1)

    def shapes_of(self, scale: DriveScale) -> tuple[Shape, ...]:
        """Return the shapes to be tried for drives of this scale."""
        return self.shapes


def log_speed(velocity: Floats) -> Floats:
    """Return the logarithm of the speed over its maximum, as a small change of an exponent."""
    speed = np.abs(velocity)
    top = np.maximum(_top(speed), STANDSTILL)
    return np.log(np.clip(speed / top, 0.01, None))


def share_of_top(values: Floats) -> Floats:
    """Return the magnitude over its maximum, 0 to about 1."""
    size = np.abs(values)
    return size / np.maximum(_top(size), 1e-9)


def _top(sizes: Floats) -> Floats:
    """Return the 99.5 % quantile of each column of sizes, of every so many rows."""
    every = max(1, len(sizes) // _ROWS)
    return np.asarray(np.quantile(sizes[::every], 0.995, axis=0))


def smooth_sign(velocity: Floats, standstill: Floats | float = STANDSTILL) -> Floats:
    """Return the sign of the velocity [T, D], which fades out below standstill in rad/s."""
    return np.asarray(np.tanh(velocity / standstill))
