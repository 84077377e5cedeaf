"""The network in torch, for training and for batches of robots."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from power_estimator.network.features import FEATURES
from power_estimator.network.lstm import Weights

Floats = NDArray[np.float32]


class PowerLstm(nn.Module):
    """LSTM and linear output on scaled features [T, B, 3] → scaled power [T, B]."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(len(FEATURES), hidden)
        self.output = nn.Linear(hidden, 1)

    def forward(
        self, x: Tensor, state: tuple[Tensor, Tensor] | None = None
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Return outputs and the state (h, c), each [1, B, H], after the last sample."""
        hidden, state = self.lstm(x, state)
        return self.output(hidden)[..., 0], state

    def weights(self) -> Weights:
        """Return the weights as numpy arrays."""
        arrays = {k: v.detach().numpy().copy() for k, v in self.state_dict().items()}
        return Weights(
            arrays['lstm.weight_ih_l0'],
            arrays['lstm.weight_hh_l0'],
            arrays['lstm.bias_ih_l0'] + arrays['lstm.bias_hh_l0'],
            arrays['output.weight'][0],
            arrays['output.bias'],
        )

    def set_weights(self, weights: Weights) -> None:
        """Set the weights, of the same size."""
        arrays = {
            'lstm.weight_ih_l0': weights.input,
            'lstm.weight_hh_l0': weights.recurrent,
            'lstm.bias_ih_l0': weights.bias,
            'lstm.bias_hh_l0': np.zeros_like(weights.bias),
            'output.weight': weights.output[None],
            'output.bias': weights.output_bias,
        }
        self.load_state_dict({k: torch.tensor(v) for k, v in arrays.items()})
