"""The switch and the strength of each physical effect of the simulated hardware."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields

from wattwalk_core.errors import InputError

from sim_bridge.plant.config_fields import bounded, check, from_mapping


@dataclass(frozen=True)
class Effect:
    """One effect; its strength multiplies the parameter that drives it (1 = as the file says)."""

    enabled: bool = True
    strength: float = bounded(1.0, 0.0, 10.0, '', 'multiplier of the effect')

    @property
    def scale(self) -> float:
        """Strength, or 0 when switched off."""
        return self.strength if self.enabled else 0.0


_ON = Effect()
_OFF = Effect(enabled=False)


@dataclass(frozen=True)
class Effects:
    """
    Every effect by the name that the lab uses, plus three strangers that it has no name for.

    Strangers: `position_rub` (a rub at certain angles), `fan` (draws in time, whatever the joint
    does) and `cross_talk` (a neighbour's current in a drive's reading).
    """

    copper_loss: Effect = _ON
    winding_heating: Effect = _ON
    coulomb_friction: Effect = _ON
    viscous_friction: Effect = _ON
    stribeck_friction: Effect = _ON
    load_friction: Effect = _ON
    rotor_inertia: Effect = _ON
    iron_loss: Effect = _ON
    inverter_loss: Effect = _ON
    idle: Effect = _ON
    line_resistance: Effect = _ON
    regeneration_efficiency: Effect = _ON
    regeneration_limit: Effect = _ON
    field_weakening: Effect = _ON
    cogging: Effect = _ON
    spring: Effect = field(default=_OFF)
    position_rub: Effect = field(default=_OFF)
    fan: Effect = field(default=_OFF)
    cross_talk: Effect = field(default=_OFF)

    def __post_init__(self) -> None:
        for name, effect in self:
            check(effect, f'effects.{name}')
            if not isinstance(effect.enabled, bool):
                raise InputError(
                    f'effects.{name}.enabled is {effect.enabled!r}; it must be true or false'
                )
        if self.spring.enabled and not self.rotor_inertia.scale:
            raise InputError('effects.spring is on without rotor_inertia; switch both on')

    def __iter__(self) -> Iterator[tuple[str, Effect]]:
        for entry in fields(self):
            yield entry.name, getattr(self, entry.name)

    @classmethod
    def parse(cls, values: object) -> 'Effects':
        """
        From a mapping of names to true, false, a strength, or {enabled, strength}.

        What is absent keeps its default. InputError for an unknown name or a bad value.
        """
        if not isinstance(values, Mapping):
            raise InputError(f'effects is {values!r}; it must be a mapping')
        names = [entry.name for entry in fields(cls)]
        for name in values:
            if name not in names:
                raise InputError(f'there is no effect {name!r}; there are {", ".join(names)}')
        return cls(**{name: _parse(value, name) for name, value in values.items()})

    @classmethod
    def none(cls) -> 'Effects':
        """Nothing but an ideal shaft: electrical power is mechanical power."""
        return cls(**{entry.name: _OFF for entry in fields(cls)})


def _parse(value: object, name: str) -> Effect:
    if isinstance(value, bool):
        return Effect(enabled=value)
    if isinstance(value, int | float):
        return Effect(enabled=value != 0, strength=float(value) or 1.0)
    return from_mapping(Effect, value, f'effects.{name}')
