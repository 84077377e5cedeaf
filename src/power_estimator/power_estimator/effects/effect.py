"""Specification of a physical effect."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.signals.scale import STANDSTILL, DriveScale
from power_estimator.effects.signals.state import Signals

Shape = Mapping[str, float]
LEVERS = ('gear_ratio', 'supply_voltage', 'winding_resistance', 'friction', 'idle', 'payload')
"""Changes of a drive, as factors, whose effect on the power a model may tell."""
_ROWS = 20_000  # that quantiles are taken of


@dataclass(frozen=True)
class Term:
    """One coefficient of an effect: symbol, SI unit and physical bounds.

    Bounds and prior are those of the reference drive (`DriveScale`).
    """

    symbol: str
    unit: str
    lower: float = 0.0
    upper: float = np.inf
    prior: float = np.inf  # spread known beforehand; finite for measurement terms
    attained: bool = False  # real drives may lie at the upper bound
    of_recording: bool = False  # a state at its start, which no other recording has
    formerly: str | None = None  # the unit by which files may have the same value


@dataclass(frozen=True)
class Excitation:
    """Motion that tells an effect from similar ones; SI units. mode: what is controlled."""

    text: str
    mode: Literal['velocity', 'position', 'torque'] = 'velocity'
    speeds: tuple[float, ...] = ()  # rad/s, each held
    loads: tuple[float, ...] = (0.0,)  # N·m
    seconds: float = 3.0  # for each speed and load
    frequency: float = 0.0  # Hz, for reversals
    amplitude: float = 0.0  # rad, for reversals
    supply: tuple[float, ...] = ()  # V, bus voltages to repeat the motion at
    alone: str = ''  # the text where there is one drive, '' for the same

    def told(self, drives: int) -> str:
        """Return the motion in words for a number of drives."""
        return self.alone or self.text if drives == 1 else self.text


@dataclass(frozen=True, eq=False, kw_only=True)
class Effect:
    """A physical effect, linear in its coefficients once its shape parameters are fixed.

    `acts_on` says what the regressors give for each unit of a coefficient: 'power' W, 'torque'
    extra motor torque in N·m, 'speed' extra motor speed in rad/s. The model turns extra torque f
    into power f·w + 2·k·torque·f + k·f², with motor speed w and copper loss k in W/(N·m)², and
    likewise through every other effect that depends on the motor's torque.

    To add an effect, put it into a file and name the file with --effects-path: either
    `Effect(name=…, physics=…, formula=…, terms=…, regressors=…)`, or a class derived from Effect
    with these as attributes and methods. Calling the class returns an Effect; methods `usable`,
    `factors` and `shapes_of` that it overrides become the fields `recorded`, `sizes` and `scaled`.
    """

    name: str
    physics: str
    formula: str
    terms: tuple[Term, ...]
    regressors: Callable[..., Floats]
    """(signals, **shape) → [T, D, n] for n terms: W, N·m or rad/s per unit, by acts_on."""
    excitation: Excitation = Excitation('not given by its author')
    acts_on: Literal['power', 'torque', 'speed'] = 'power'
    kind: Literal['physics', 'measurement', 'discrepancy'] = 'physics'
    needs_joint_torque: bool = False  # the torque of the motor contains the effect already
    ties: tuple[str, ...] = ()  # effects that no recording can tell from it
    near: tuple[str, ...] = ()  # effects that only its excitation tells from it
    shapes: tuple[Shape, ...] = ({},)
    fixed: float | None = None  # a coefficient that physics fixes
    follows: frozenset[str] = frozenset()  # estimates it uses: motor_torque, drawn
    per_drive: bool = False
    """
    Each drive's regressors come from its own signals alone. Fits then go drive by drive, several
    at once, with Signals of one drive.
    """
    together_by: str = ''  # shape parameter with which it is one effect of all drives
    remembers: bool = False
    """
    The regressors follow what was seconds before (heat, backlash, rest) from each gap on, so
    that a recording must not be cut into pieces.
    """
    needs_time: bool = False  # operating points do not show it: it acts while something changes
    torque_slope: Callable[[Signals, Floats], Floats | None] | None = None
    """(signals, coefficients) → derivative of its power by the motor's torque, W/(N·m) [T, D]."""
    drawn_slope: Callable[..., Floats | None] | None = None
    """(signals, coefficients, **shape) → derivative by the power drawn without it [T, D]."""
    discrepancy: Callable[..., Floats] | None = None
    """
    (signals, **shape) → typical departure of real drives from the formula, [T, D] in the
    regressors' unit. A diagnosis fits it beside every active effect before it names another.
    """
    discrepancy_limit: float = 0.0
    """Largest departure from the formula, as a share of the first coefficient."""
    recorded: Callable[..., bool] | None = None
    """(signals, **shape) → whether the signals that the shape needs were recorded."""
    proposed: Callable[[Signals], bool] | None = None
    """Signals → whether a diagnosis may name it there; None: wherever it is usable."""
    sizes: Callable[[DriveScale], Floats] | None = None
    """Scale → factors [D, n] of the bounds, where they do not follow from the terms' units."""
    scaled: Callable[[DriveScale], tuple[Shape, ...]] | None = None
    """Scale → shapes to be tried, where they depend on the drives."""
    enough: Callable[[Signals, Shape], bool] | None = None
    """(signals, shape) → whether these show the shape so well that no other is tried."""
    part_of: str = ''  # the effect without which it cannot be, of whose watts it is a part
    departs_from: str = ''  # the effect whose departure a discrepancy is
    scaling: Mapping[str, tuple[float, ...] | None] | None = None
    """
    By lever, the power of its factor that each coefficient goes with at the same motion of the
    joint; none of those that change nothing, None for what is not known.
    """
    per_recording: bool = False  # a coefficient for each recording
    made: tuple[Callable[..., 'Effect'], tuple[Any, ...]] | None = None
    """Function and arguments that make it again in another process; None for those shipped."""

    def __new__(cls, *_: object, **__: object) -> 'Effect':  # type: ignore[misc]
        """Make an effect, of a derived class the one that it states."""
        return object.__new__(cls) if cls is Effect else _stated_by(cls)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Effect):
            return NotImplemented
        return self.name == other.name and self.terms == other.terms

    def __hash__(self) -> int:
        return hash(self.name)

    def usable(self, signals: Signals, **shape: float) -> bool:
        """Return whether signals can show the effect with this shape."""
        if self.needs_joint_torque and signals.at_motor.all():
            return False
        if signals.steady and (self.needs_time or self.remembers):
            return False
        return self.recorded is None or self.recorded(signals, **shape)

    def factors(self, scale: DriveScale) -> Floats:
        """Return factors [D, n] from the terms' bounds to those for drives of a scale."""
        if self.sizes is not None:
            return self.sizes(scale)
        return factors_by_unit(self.terms, scale, self.kind == 'measurement')

    def shapes_of(self, scale: DriveScale) -> tuple[Shape, ...]:
        """Return the shapes to be tried for drives of this scale."""
        return self.shapes if self.scaled is None else self.scaled(scale)

    def tried_on(self, signals: Signals) -> tuple[Shape, ...]:
        """Return the shapes to be tried on signals: those that these can show, or show best."""
        usable = [each for each in self.shapes_of(signals.scale) if self.usable(signals, **each)]
        return tuple([each for each in usable if self.shown_by(signals, each)] or usable)

    def shown_by(self, signals: Signals, shape: Shape) -> bool:
        """Return whether signals show a shape so well that no other is tried."""
        return self.enough is not None and self.enough(signals, shape)


def _stated_by(form: type[Effect]) -> Effect:
    """Return the effect that a class states; `per_drive` counts only in the class itself."""
    own: Any = object.__new__(form)
    stated = {f.name: getattr(own, f.name) for f in fields(Effect) if hasattr(own, f.name)}
    methods = {'usable': 'recorded', 'factors': 'sizes', 'shapes_of': 'scaled'}
    for method, field in methods.items():
        if getattr(form, method) is not getattr(Effect, method):
            stated[field] = getattr(own, method)
    return Effect(**stated | {'per_drive': vars(form).get('per_drive', False)})


def factors_by_unit(terms: Sequence[Term], scale: DriveScale, of_sensor: bool = False) -> Floats:
    """Return the factors [D, n] of terms in drives of a scale, by `DriveScale.factor`."""
    return np.stack([scale.factor(t.unit, of_sensor=of_sensor) for t in terms], axis=-1)


def in_proportion(
    shapes: tuple[Shape, ...], size: Callable[[DriveScale], Floats]
) -> Callable[[DriveScale], tuple[Shape, ...]]:
    """Return a function of a drive scale that gives the shapes times each distinct size [D]."""

    def scaled(scale: DriveScale) -> tuple[Shape, ...]:
        factors = sorted(set(size(scale).tolist()))
        return tuple({k: v * f for k, v in shape.items()} for f in factors for shape in shapes)

    return scaled


def log_speed(velocity: Floats) -> Floats:
    """Return log(speed / its 99.5 % quantile) [T, D], at least log 0.01, to change exponents."""
    return np.log(np.clip(share_of_top(velocity, STANDSTILL), 0.01, None))


def share_of_top(values: Floats, least: float = 1e-9) -> Floats:
    """Return the magnitude of values [T, D] over its 99.5 % quantile, or over the least if larger.

    The quantile is of every so many rows.
    """
    size = np.abs(values)
    top = np.quantile(size[:: max(1, len(size) // _ROWS)], 0.995, axis=0)
    return np.asarray(size / np.maximum(top, least))


def smooth_sign(velocity: Floats, standstill: Floats | float = STANDSTILL) -> Floats:
    """Return the sign of the velocity [T, D], which fades out below standstill in rad/s."""
    return np.asarray(np.tanh(velocity / standstill))
