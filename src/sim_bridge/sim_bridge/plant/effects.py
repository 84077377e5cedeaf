"""Switch and strength of each physical effect of the simulated hardware."""

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Annotated

from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity, parse, schema


@schema
class SimulatedEffect:
    """One effect; its strength multiplies the parameter that drives it (1: as in the file)."""

    enabled: bool = True
    strength: Annotated[float, Quantity(0.0, 10.0, '', 'multiplier of the effect')] = 1.0

    @property
    def scale(self) -> float:
        """Strength, or 0 when switched off."""
        return self.strength if self.enabled else 0.0


_ON = SimulatedEffect()
_OFF = SimulatedEffect(enabled=False)


@schema
class Effects:
    """
    Effects by the names of power_estimator's catalogue, plus three unmodelled effects.

    Unmodelled: `position_rub` (friction at certain angles), `fan` (power drawn over time, whatever
    the joint does) and `cross_talk` (a neighbour's current in a drive's reading). Of real drives
    and off unless a plant has them on: `torque_loop` (closed on the spring's deflection),
    `torque_ripple`, `dead_time` (of the inverter), `magnet_heating` (the torque constant falls),
    `battery` (a source with internal resistance), and of the instruments `encoder_eccentricity`,
    `torque_hysteresis` and `meter_filter` (a slow meter).
    """

    copper_loss: SimulatedEffect = _ON
    winding_heating: SimulatedEffect = _ON
    coulomb_friction: SimulatedEffect = _ON
    viscous_friction: SimulatedEffect = _ON
    stribeck_friction: SimulatedEffect = _ON
    load_friction: SimulatedEffect = _ON
    rotor_inertia: SimulatedEffect = _ON
    iron_loss: SimulatedEffect = _ON
    inverter_loss: SimulatedEffect = _ON
    idle: SimulatedEffect = _ON
    line_resistance: SimulatedEffect = _ON
    regeneration_efficiency: SimulatedEffect = _ON
    regeneration_limit: SimulatedEffect = _ON
    field_weakening: SimulatedEffect = _ON
    cogging: SimulatedEffect = _ON
    spring: SimulatedEffect = _OFF
    position_rub: SimulatedEffect = _OFF
    fan: SimulatedEffect = _OFF
    cross_talk: SimulatedEffect = _OFF
    torque_loop: SimulatedEffect = _OFF
    torque_ripple: SimulatedEffect = _OFF
    dead_time: SimulatedEffect = _OFF
    magnet_heating: SimulatedEffect = _OFF
    battery: SimulatedEffect = _OFF
    encoder_eccentricity: SimulatedEffect = _OFF
    torque_hysteresis: SimulatedEffect = _OFF
    meter_filter: SimulatedEffect = _OFF

    def __post_init__(self) -> None:
        if self.spring.enabled and not self.rotor_inertia.scale:
            raise InputError('effects: spring is on without rotor_inertia; switch both on')
        if self.torque_loop.enabled and not self.spring.enabled:
            raise InputError(
                'effects: torque_loop is on without spring, whose deflection it reads'
            )

    def __iter__(self) -> Iterator[tuple[str, SimulatedEffect]]:
        for entry in fields(self):
            yield entry.name, getattr(self, entry.name)

    @classmethod
    def parse(cls, values: object) -> 'Effects':
        """
        Build from names mapped to true, false, a strength, or {enabled, strength}.

        Absent names keep their default. InputError for an unknown name or a bad value.
        """
        return parse(cls, expand(values), 'effects')

    @classmethod
    def none(cls) -> 'Effects':
        """Return all effects switched off: electrical power is mechanical power."""
        return cls(**{entry.name: _OFF for entry in fields(cls)})


def expand(values: object) -> object:
    """Write the short forms of effects (true, false, a strength) as {enabled, strength}."""
    if not isinstance(values, Mapping):
        return values
    return {name: _expanded(value) for name, value in values.items()}


def _expanded(value: object) -> object:
    if isinstance(value, bool):
        return {'enabled': value}
    if isinstance(value, int | float):
        return {'enabled': value != 0, 'strength': value or 1.0}
    return value
