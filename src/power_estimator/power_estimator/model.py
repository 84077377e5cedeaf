"""Protocol of all power models."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from power_recordings.alignment.dataset import AlignedDataset


class PowerModel(Protocol):
    """Anything that turns aligned signals into watts per drive."""

    @property
    def name(self) -> str:
        """Name of the model in tables, figures and messages."""

    def predict(self, data: AlignedDataset) -> NDArray[np.float32]:
        """Return the electrical power in W [T, D] on the grid of data; NaN where unknown."""
