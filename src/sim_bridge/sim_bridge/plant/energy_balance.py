"""Energy balance of the plant: energy supplied, work, losses and storage."""

from collections.abc import Mapping
from dataclasses import dataclass, field

STORED = ('rotor', 'spring', 'capacitor', 'cogging_field')


@dataclass
class EnergyBalance:
    """
    Energy counters since the start, J, summed over all drives, by channel.

    `supply` is the energy from the supply to the drives, electronics excluded. `shaft` is the work
    at the joints, the channels STORED are changes of stored energy, all others are losses.
    """

    energy: dict[str, float] = field(default_factory=dict)

    def add(self, powers: Mapping[str, float], step: float) -> None:
        """Add sums of powers over steps, W, of step seconds each."""
        for name, power in powers.items():
            self.energy[name] = self.energy.get(name, 0.0) + power * step

    @property
    def supplied(self) -> float:
        """Energy from the supply, J."""
        return self.energy.get('supply', 0.0)

    @property
    def losses(self) -> dict[str, float]:
        """Energy turned into heat, J by channel."""
        outside = ('supply', 'shaft', *STORED)
        return {name: value for name, value in self.energy.items() if name not in outside}

    @property
    def residual(self) -> float:
        """Supplied energy that no channel accounts for, J."""
        return self.supplied - sum(v for name, v in self.energy.items() if name != 'supply')

    @property
    def turnover(self) -> float:
        """The larger of the energy supplied and the energy exchanged by the channels, J."""
        spent = sum(abs(value) for name, value in self.energy.items() if name != 'supply')
        return max(abs(self.supplied), spent)
