"""Types of numpy arrays by what they hold."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bools = NDArray[np.bool_]
Stamps = NDArray[np.int64]  # times [ns] of a clock
