"""Training of one network: sequences in parallel, carried state, on one core and repeatable."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from wattwalk_core.arrays import Bools, Singles
from wattwalk_core.errors import InputError

from power_estimator import scores
from power_estimator.network.features import FEATURES, Scaling
from power_estimator.network.lstm import Weights
from power_estimator.training.trainer_config import TrainerConfig


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
        """Return the weights as numpy arrays, with the two biases summed."""
        arrays = {k: v.detach().numpy().copy() for k, v in self.state_dict().items()}
        return Weights(
            arrays['lstm.weight_ih_l0'],
            arrays['lstm.weight_hh_l0'],
            arrays['lstm.bias_ih_l0'] + arrays['lstm.bias_hh_l0'],
            arrays['output.weight'][0],
            arrays['output.bias'],
        )


@dataclass(frozen=True)
class Tracks:
    """Gap-free stretches of one drive each, end to end.

    features holds V views of the same motion (filtered with and without a look ahead, …).
    """

    features: Singles  # [V, N, 3]
    power: Singles  # W [N]
    edges: NDArray[np.intp]  # [tracks + 1]

    @classmethod
    def join(cls, tracks: Sequence[tuple[Singles, Singles]]) -> 'Tracks':
        """Join stretches (features [V, n, 3], power W [n]); InputError for none."""
        if not tracks:
            raise InputError('no stretch of data is long enough')
        return cls(
            np.concatenate([x for x, _ in tracks], axis=1),
            np.concatenate([y for _, y in tracks]),
            np.cumsum([0, *(len(y) for _, y in tracks)]),
        )

    def cut(self, length: int) -> 'Tracks':
        """Return the same samples, cut into tracks of at most `length` samples."""
        edges = [np.arange(a, b, length) for a, b in pairwise(self.edges.tolist())]
        return Tracks(self.features, self.power, np.r_[*edges, self.edges[-1]].astype(np.intp))


@dataclass(frozen=True)
class Epoch:
    """Result of one pass over the training data."""

    number: int  # from 1
    loss: float  # mean squared error in units of the power's variance
    r2: float  # at 50 Hz on the validation part
    best: bool


class Trainer:
    """Sequence-to-sequence training of one network; the weights of the best validation are kept.

    Each of `batch` sequences passes through the data chunk by chunk. Its state is carried without
    gradient and reset at gaps and sometimes at random; the warm_up samples after a reset have no
    loss. So estimates are accurate soon after a reset and stay so for hours: the windowed and the
    carried form agree. With a reset before each chunk the network is trained, and validated, on
    windows of that length instead.
    """

    def __init__(
        self,
        training: Tracks,
        validation: Tracks,
        *,
        hidden: int,
        warm_up: int,
        block: int,
        config: TrainerConfig,
    ) -> None:
        self.config = config
        self._warm_up = warm_up
        self._block = block
        self.scaling = Scaling.of(
            training.features.reshape(-1, len(FEATURES)), training.power, config.mirror
        )
        self._training = training
        self._x, self._y = self._scaled(training)
        windows = config.reset_probability == 1
        self._validation = validation.cut(config.chunk) if windows else validation
        self._x_validation, _ = self._scaled(self._validation)
        self.network = PowerLstm(hidden)
        self._initialise(hidden)
        self._optimiser = torch.optim.Adam(self.network.parameters(), config.learning_rate)
        self._carried: tuple[Tensor, Tensor] | None = None
        self.history: list[Epoch] = []
        self.best = self.network.weights()

    @property
    def done(self) -> bool:
        """True once all epochs have passed, or `patience` of them without a better validation."""
        number = len(self.history)
        since = number - max((e.number for e in self.history if e.best), default=number)
        return number >= self.config.epochs or since >= self.config.patience

    def epoch(self) -> Epoch:
        """Pass once over the training data, validate, and return the result."""
        number = len(self.history) + 1
        loss = self._pass(number)
        r2 = self.validate()
        best = r2 > max((e.r2 for e in self.history), default=-math.inf)
        result = Epoch(number, loss, r2, best)
        if best:
            self.best = self.network.weights()
        self.history.append(result)
        return result

    def validate(self) -> float:
        """Return R² at 50 Hz of the network on the validation tracks, with carried state."""
        edges = self._validation.edges
        lengths = np.diff(edges)
        x = torch.zeros(int(lengths.max()), len(lengths), len(FEATURES))
        for column, (start, stop) in enumerate(pairwise(edges)):
            x[: stop - start, column] = self._x_validation[0, start:stop]
        with torch.no_grad():
            y, _ = self.network(x)
        power = y.numpy() * self.scaling.power_scale + self.scaling.power_mean
        estimated, measured = [], []
        for column, (start, length) in enumerate(zip(edges[:-1], lengths, strict=True)):
            run = slice(self._warm_up, int(length))
            estimated.append(scores.block_means(power[:length, column], [run], self._block))
            track = self._validation.power[start : start + length]
            measured.append(scores.block_means(track, [run], self._block))
        return scores.r2(np.concatenate(measured), np.concatenate(estimated))

    def state(self) -> dict[str, Singles]:
        """Return arrays by name from which `restore` continues exactly."""
        tensors = {f'now/{k}': v.numpy().copy() for k, v in self.network.state_dict().items()}
        tensors |= {f'best/{k}': v for k, v in vars(self.best).items()}
        for index, moments in self._optimiser.state_dict()['state'].items():
            tensors |= {f'adam/{index}/{k}': v.numpy().copy() for k, v in moments.items()}
        rows = [(e.loss, e.r2, e.best) for e in self.history]
        return tensors | {'history': np.array(rows, np.float64).reshape(-1, 3)}

    def restore(self, tensors: Mapping[str, NDArray[np.floating]]) -> None:
        """Continue from `state`; KeyError or RuntimeError if it is of another network."""
        self.network.load_state_dict(
            {k: torch.from_numpy(tensors[f'now/{k}'].copy()) for k in self.network.state_dict()}
        )
        best = {k: np.array(tensors[f'best/{k}'], np.float32) for k in vars(self.best)}
        self.best = Weights(**best)
        moments: dict[int, dict[str, Tensor]] = {}
        for key, values in tensors.items():
            if key.startswith('adam/'):
                _, index, name = key.split('/')
                moments.setdefault(int(index), {})[name] = torch.from_numpy(np.array(values))
        groups = self._optimiser.state_dict()['param_groups']
        self._optimiser.load_state_dict({'state': moments, 'param_groups': groups})
        self.history = [
            Epoch(number, float(loss), float(r2), bool(best))
            for number, (loss, r2, best) in enumerate(tensors['history'], 1)
        ]

    def _scaled(self, tracks: Tracks) -> tuple[Tensor, Tensor]:
        s = self.scaling
        x = (torch.from_numpy(tracks.features) - torch.tensor(s.mean)) / torch.tensor(s.scale)
        y = (torch.from_numpy(tracks.power) - s.power_mean) / s.power_scale
        return x, y

    def _initialise(self, hidden: int) -> None:
        rng = np.random.default_rng([self.config.seed, 0])
        bound = hidden**-0.5

        def uniform(*shape: int) -> Singles:
            return rng.uniform(-bound, bound, shape).astype(np.float32)

        bias = uniform(4 * hidden)
        bias[hidden : 2 * hidden] += 1
        arrays = {
            'lstm.weight_ih_l0': uniform(4 * hidden, len(FEATURES)),
            'lstm.weight_hh_l0': uniform(4 * hidden, hidden),
            'lstm.bias_ih_l0': bias,
            'lstm.bias_hh_l0': np.zeros_like(bias),
            'output.weight': uniform(1, hidden),
            'output.bias': np.zeros(1, np.float32),
        }
        self.network.load_state_dict({k: torch.tensor(v) for k, v in arrays.items()})

    def _pass(self, number: int) -> float:
        """Update on all chunks of an epoch in their order; return the mean loss."""
        self._carried = None
        rng = np.random.default_rng([self.config.seed, number])
        starts, fresh = plan(self._training.edges, self.config, rng)
        count = len(self._training.features)
        views: NDArray[np.int64] = np.zeros(starts.shape[1], np.int64)
        signs: Singles = np.ones(starts.shape[1], np.float32)
        losses = []
        for step, (rows, new) in enumerate(zip(starts, fresh, strict=True)):
            views = np.where(new, rng.integers(count, size=len(new)), views)
            if self.config.mirror:
                flips = rng.integers(2, size=len(new)).astype(np.float32) * 2 - 1
                signs = np.where(new, flips, signs)
            done = (number - 1 + step / len(starts)) / self.config.epochs
            low, high = self.config.final_learning_rate, self.config.learning_rate
            rate = low + (high - low) * (1 + math.cos(math.pi * done)) / 2
            view, sign, row, drop = map(torch.from_numpy, (views, signs, rows, new))
            losses.append(self._update(view, sign, row, drop, rate))
        return float(np.mean(losses))

    def _update(
        self, views: Tensor, signs: Tensor, rows: Tensor, fresh: Tensor, rate: float
    ) -> float:
        index = rows + torch.arange(self.config.chunk)[:, None]
        x, y = self._x[views, index] * signs[:, None], self._y[index]
        state = None
        if self._carried is not None:
            keep = (~fresh)[None, :, None]
            state = (self._carried[0] * keep, self._carried[1] * keep)
        estimate, (h, c) = self.network(x, state)
        self._carried = (h.detach(), c.detach())
        bears = torch.ones_like(y)
        bears[: self._warm_up, fresh] = 0
        loss = (bears * (estimate - y).square()).sum() / bears.sum()
        for group in self._optimiser.param_groups:
            group['lr'] = rate
        self._optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), self.config.gradient_norm)
        self._optimiser.step()
        return float(loss.detach())


def plan(
    edges: NDArray[np.intp], config: TrainerConfig, rng: np.random.Generator
) -> tuple[NDArray[np.intp], Bools]:
    """Return the chunks of an epoch: first rows [S, B] and whether the state is reset [S, B].

    edges: first row of each track and the end. Tracks come in random order and are entered at a
    random row, so that chunks differ between epochs. InputError if no track has a chunk.
    """
    pieces = []
    for track in rng.permutation(len(edges) - 1):
        first, last = int(edges[track]), int(edges[track + 1]) - config.chunk
        if last >= first:
            first += int(rng.integers(0, min(config.chunk, last - first + 1)))
            pieces.append(np.arange(first, last + 1, config.chunk))
    if not pieces:
        raise InputError(f'no stretch of data has {config.chunk} samples in a row')
    rows = np.concatenate(pieces)
    fresh = rng.random(len(rows)) < config.reset_probability
    fresh[np.cumsum([0, *(len(piece) for piece in pieces[:-1])])] = True
    batch = min(config.batch, len(rows))
    steps = len(rows) // batch
    shape = (batch, steps)
    result = fresh[: batch * steps].reshape(shape).T.copy()
    result[0] = True
    return rows[: batch * steps].reshape(shape).T, result
