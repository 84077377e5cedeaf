"""Protocol of all power models, with their inputs and memory."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Singles


@dataclass(frozen=True)
class Needs:
    """Inputs of a power model, and how long a past of them it needs.

    Inputs are `position_error`, `torque`, `velocity`, `position`, `voltage`, `temperature` (of the
    winding) and `power` (measured, of a proxy without a factor). Each has the effect that needs
    it, '' for the model as a whole.
    """

    inputs: Mapping[str, str]  # without one of them there is no estimate
    rate: float  # Hz, of the samples that are multiplied
    smooth: bool  # low-passed at 12.5 Hz (Section II-A); else as measured
    improved_by: Mapping[str, str] = field(default_factory=dict)  # inputs with a nominal value
    memory: float = 0.0  # s before an estimate; inf for all before it
    remembers: str = ''  # effect that has the longest memory
    carried: bool = True  # that memory can be carried from one block of samples to the next
    together: str = ''  # effect that looks at all drives of a bus at once

    def joined(self, others: Iterable['Needs']) -> 'Needs':
        """Return the joint needs of this and other parts of a model, at this one's rate."""
        whole = self
        for one in others:
            longest = max((whole, one), key=lambda needs: (needs.memory, not needs.carried))
            whole = replace(
                whole,
                inputs={**one.inputs, **whole.inputs},
                improved_by={**one.improved_by, **whole.improved_by},
                memory=longest.memory,
                remembers=longest.remembers,
                carried=longest.carried,
                together=whole.together or one.together,
            )
        return whole

    def lacking(self, available: Collection[str]) -> str:
        """Return what the model needs and is not available, as part of a sentence, or ''."""
        for name, effect in self.inputs.items():
            if name not in available:
                return f'{effect} needs {name}' if effect else f'it needs {name}'
        return ''


class PowerModel(Protocol):
    """Protocol of all models that turn aligned signals into the electrical power of each drive."""

    @property
    def name(self) -> str:
        """Name of the model in tables, figures and messages."""

    @property
    def needs(self) -> Needs:
        """Inputs and memory of the model."""

    def predict(self, data: AlignedDataset) -> Singles:
        """Return the electrical power in W [T, D] on the grid of data; NaN where unknown."""
