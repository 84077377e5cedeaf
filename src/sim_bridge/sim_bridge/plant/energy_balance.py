"""Energy books: what the supply gave, where it went and what is still stored."""

from collections.abc import Mapping
from dataclasses import dataclass, field

STORED = ('rotor', 'spring', 'capacitor', 'cogging_field')


@dataclass
class Books:
    """
    Energies in J since the start, summed over all drives, by channel.

    `supply` is what the supply gave to the drives (its electronics are outside); every other
    channel is where it went: `shaft` is work done at the joints, STORED are changes of stored
    energy, all others are losses.
    """

    energy: dict[str, float] = field(default_factory=dict)

    def add(self, powers: Mapping[str, float], step: float) -> None:
        """Book sums of powers over steps (W) of step seconds each."""
        for name, power in powers.items():
            self.energy[name] = self.energy.get(name, 0.0) + power * step

    @property
    def supplied(self) -> float:
        """Energy out of the supply, J."""
        return self.energy.get('supply', 0.0)

    @property
    def losses(self) -> dict[str, float]:
        """Energy turned into heat, J by channel."""
        outside = ('supply', 'shaft', *STORED)
        return {name: value for name, value in self.energy.items() if name not in outside}

    @property
    def residual(self) -> float:
        """What the books do not account for, J."""
        return self.supplied - sum(v for name, v in self.energy.items() if name != 'supply')

    @property
    def turnover(self) -> float:
        """The larger of what came in and what moved through the channels, J."""
        spent = sum(abs(value) for name, value in self.energy.items() if name != 'supply')
        return max(abs(self.supplied), spent)
