"""LSTM in numpy: one time step for many drives, without torch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from wattwalk_core.arrays import Bools, Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.network.features import FEATURES, Scaling

_LARGEST = 1e6


@dataclass(frozen=True)
class Weights:
    """An LSTM layer and its linear output; gates in the order input, forget, cell, output."""

    input: Singles  # [4H, 3]
    recurrent: Singles  # [4H, H]
    bias: Singles  # [4H]
    output: Singles  # [H]
    output_bias: Singles  # [1]

    @staticmethod
    def shapes(hidden: int) -> dict[str, tuple[int, ...]]:
        """Return the shape of each array by name."""
        return {
            'input': (4 * hidden, len(FEATURES)),
            'recurrent': (4 * hidden, hidden),
            'bias': (4 * hidden,),
            'output': (hidden,),
            'output_bias': (1,),
        }

    def __post_init__(self) -> None:
        for name, shape in self.shapes(self.output.shape[0] if self.output.ndim else 0).items():
            values = getattr(self, name)
            if values.shape != shape:
                raise InputError(f'tensor {name} has shape {values.shape}, not {shape}')
            # With larger ones the scaled weights could become infinite.
            if values.dtype != np.float32 or not np.abs(values).max() <= _LARGEST:
                raise InputError(
                    f'tensor {name} is not made of float32 numbers up to {_LARGEST:g}'
                )

    @property
    def hidden(self) -> int:
        """Number of hidden units H."""
        return int(self.output.shape[0])

    def in_si_units(self, scaling: Scaling) -> dict[str, Floats]:
        """Return the arrays with the scaling folded in, by name: SI units in, watts out."""
        scaled = self.input.astype(float) / np.array(scaling.scale)
        return {
            'input': scaled,
            'recurrent': self.recurrent.astype(float),
            'bias': self.bias - scaled @ np.array(scaling.mean),
            'output': self.output.astype(float) * scaling.power_scale,
            'output_bias': self.output_bias.astype(float) * scaling.power_scale
            + scaling.power_mean,
        }


class LstmBank:
    """Networks of one size, each for drives of its type, with carried state.

    columns: of the D drives, by network. Takes features in SI units and gives watts; drives of no
    network get NaN. ValueError where the sizes differ.
    """

    def __init__(
        self,
        networks: Mapping[str, tuple[Weights, Scaling]],
        columns: Mapping[str, Sequence[int]],
        drives: int,
    ) -> None:
        used = [name for name in networks if len(columns.get(name, ()))]
        sizes = {networks[name][0].hidden for name in used}
        if len(sizes) != 1:
            raise ValueError(f'networks of one size are needed, not of {sorted(sizes)}')
        self._hidden = sizes.pop()
        width = max(len(columns[name]) for name in used)
        self._slot = np.zeros((len(used), width), np.intp)
        self._column = np.concatenate([np.asarray(columns[name], np.intp) for name in used])
        self._filled = np.zeros((len(used), width), bool)
        for k, name in enumerate(used):
            self._slot[k, : len(columns[name])] = columns[name]
            self._filled[k, : len(columns[name])] = True
        folded = [_fold(*networks[name]) for name in used]
        self._input, self._recurrent, self._bias, self._output, self._offset = (
            np.ascontiguousarray(np.stack(parts), np.float32)
            for parts in zip(*folded, strict=True)
        )
        self._drives = drives
        self._h = np.zeros((len(used), width, self._hidden), np.float32)
        self._c = np.zeros_like(self._h)

    def reset(self, drives: Bools | None = None) -> None:
        """Forget the past of the drives marked in [D], or of all."""
        rows = slice(None) if drives is None else drives[self._slot]
        self._h[rows] = 0
        self._c[rows] = 0

    def step(self, features: Singles) -> Singles:
        """Advance all drives by one sample: [D, 3] in rad, N·m, rad/s → W [D]."""
        return self._watts(self._advance(self._project(features[None]))[None])[0]

    def run(self, features: Singles, fresh: Bools | None = None) -> Singles:
        """Advance all drives by T samples: [T, D, 3] → W [T, D].

        fresh [T, D] marks the samples before which a drive forgets its past.
        """
        result = np.empty(features.shape[:2], np.float32)
        resets = np.zeros(len(features), bool) if fresh is None else np.any(fresh, axis=1)
        block = max(1, 200_000 // max(1, self._slot.size * 4 * self._hidden))
        for start in range(0, len(features), block):
            rows = self._project(features[start : start + block])
            hidden = np.empty((len(rows), *self._h.shape), np.float32)
            for t in range(len(rows)):
                if fresh is not None and resets[start + t]:
                    self.reset(fresh[start + t])
                hidden[t] = self._advance(rows[t : t + 1])
            result[start : start + len(rows)] = self._watts(hidden)
        return result

    def _project(self, features: Singles) -> Singles:
        return np.matmul(features[:, self._slot], self._input) + self._bias

    def _advance(self, projected: Singles) -> Singles:
        n = self._hidden
        gates = np.matmul(self._h, self._recurrent)
        gates += projected[0]
        np.tanh(gates, out=gates)
        sigmoid = gates[..., : 3 * n]
        sigmoid *= 0.5
        sigmoid += 0.5
        self._c *= gates[..., n : 2 * n]
        self._c += gates[..., :n] * gates[..., 3 * n :]
        np.tanh(self._c, out=self._h)
        self._h *= gates[..., 2 * n : 3 * n]
        return self._h

    def _watts(self, hidden: Singles) -> Singles:
        power = np.matmul(hidden, self._output)[..., 0] + self._offset
        result = np.full((len(hidden), self._drives), np.nan, np.float32)
        result[:, self._column] = power[:, self._filled]
        return result


def _fold(weights: Weights, scaling: Scaling) -> tuple[Floats, ...]:
    """Fold scaling into the weights, gates to (i, f, o, g), and σ(x) as ½(1 + tanh(x/2))."""
    n = weights.hidden
    order = np.r_[0 : 2 * n, 3 * n : 4 * n, 2 * n : 3 * n]
    halves = np.r_[np.full(3 * n, 0.5), np.ones(n)]
    own = weights.in_si_units(scaling)
    return (
        (own['input'][order] * halves[:, None]).T,
        (own['recurrent'][order] * halves[:, None]).T,
        (own['bias'][order] * halves)[None],
        own['output'][:, None],
        own['output_bias'],
    )
