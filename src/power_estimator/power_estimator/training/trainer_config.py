"""Settings of a network's training."""

from dataclasses import dataclass
from typing import Annotated

from wattwalk_core.schema import CheckedFields, Quantity


@dataclass(frozen=True)
class TrainerConfig(CheckedFields):
    """Settings of the training; the defaults were chosen on walking data (docs/how-to/ppn.md)."""

    epochs: Annotated[int, Quantity(1, 10_000)] = 20
    batch: Annotated[int, Quantity(1, 4096)] = 16  # sequences side by side
    chunk: Annotated[int, Quantity(20, 10_000, 'samples')] = 50  # between updates
    learning_rate: Annotated[float, Quantity(1e-6, 1.0)] = 5e-3
    final_learning_rate: Annotated[float, Quantity(0.0, 1.0)] = 1e-4
    reset_probability: Annotated[float, Quantity(0.0, 1.0)] = 0.05  # per sequence and chunk
    mirror: bool = True  # a drive that turns the other way under the opposite load draws the same
    patience: Annotated[int, Quantity(1, 10_000)] = 8  # epochs without a better validation
    gradient_norm: Annotated[float, Quantity(1e-6, 1e6)] = 1.0
    seed: Annotated[int, Quantity(0, 2**31 - 1)] = 0
