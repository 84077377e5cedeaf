"""Trained networks on disk: one safetensors file with a YAML card inside, never a pickle."""

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import CheckedFields, Name, Printable, Quantity, parse, schema
from wattwalk_core.tensors import TensorFile, checked_tensors, read_tensors
from wattwalk_core.yaml_file import dump_yaml, parse_yaml

from power_estimator.drive_types import DriveType
from power_estimator.network.features import FEATURES, Scaling
from power_estimator.network.lstm import Weights
from power_estimator.network.out_of_distribution import OutOfDistributionScore

LEVEL = 0.9
_BINS = 8
_IN_A_BIN = 100  # residuals that a quantile of 5 % may rest on
_Watts = Annotated[float, Quantity(-1e9, 1e9, 'W')]


@schema
class Intervals(CheckedFields):
    """Range in which the measured power of an estimate at 50 Hz lies with probability `level`.

    Bins of estimated power have their own widths, from residuals that the network was not
    trained on (split-conformal prediction; Lei et al. 2018, by bin as Boström et al. 2021). The
    level is nominal: residuals that follow each other closely, or that training was stopped by,
    are not exchangeable with new ones, so that no coverage is guaranteed.
    """

    level: Annotated[float, Quantity(0.01, 0.999)]
    edges: tuple[_Watts, ...]  # between the n bins [n − 1]
    below: tuple[_Watts, ...]  # by which the measured power may lie below the estimate [n]
    above: tuple[_Watts, ...]  # by which it may lie above [n]

    def __post_init__(self) -> None:
        super().__post_init__()
        numbers = (*self.edges, *self.below, *self.above)
        sizes = len(self.edges) + 1 == len(self.below) == len(self.above)
        if not sizes or not np.isfinite(numbers).all() or list(self.edges) != sorted(self.edges):
            raise InputError(f'intervals {numbers} are not finite numbers by ascending bins')

    @classmethod
    def fit(
        cls, measured: Singles, estimated: Singles, level: float = LEVEL
    ) -> 'Intervals | None':
        """Fit to pairs [N] at 50 Hz that the network was not trained on; None if there are few.

        Equal estimates stay in one bin, and no bin has fewer than 100 pairs.
        """
        both = np.isfinite(measured) & np.isfinite(estimated)
        y, f = measured[both].astype(float), estimated[both].astype(float)
        bins = min(_BINS, len(y) // _IN_A_BIN)
        if bins < 1:
            return None
        edges = _edges(f, bins)
        index = np.searchsorted(edges, f, side='right')
        below, above = [], []
        for number in range(len(edges) + 1):
            error = np.sort((y - f)[index == number])
            rank = max(1, math.floor((len(error) + 1) * (1 - level) / 2))
            below.append(-float(error[rank - 1]))
            above.append(float(error[-rank]))
        return cls(level, edges, tuple(below), tuple(above))

    def around(self, estimated: Singles) -> tuple[Singles, Singles]:
        """Return the lowest and highest power to be expected, W, in the shape of the estimates."""
        index = np.searchsorted(np.array(self.edges), estimated, side='right')
        low = estimated - np.array(self.below, np.float32)[index]
        return low, estimated + np.array(self.above, np.float32)[index]


def _edges(estimated: Floats, bins: int) -> tuple[float, ...]:
    """Return the edges of at most `bins` bins; fewer where ties would leave one too small."""
    ordered = np.sort(estimated)
    kept: list[float] = []
    begin = 0
    for edge in np.unique(np.quantile(ordered, np.arange(1, bins) / bins)).tolist():
        end = int(np.searchsorted(ordered, edge))
        if min(end - begin, len(ordered) - end) >= _IN_A_BIN:
            kept.append(edge)
            begin = end
    return tuple(kept)


FILE = 'model.safetensors'
SHIPPED = Path(__file__).parent / 'shipped'

_Number = Annotated[float, Quantity(-1e9, 1e9)]
_Scale = Annotated[float, Quantity(1e-6, 1e9)]
_Time = Annotated[float, Quantity(-1e12, 1e12, 's')]


@schema
class NetworkConfig(CheckedFields):
    """Shape and timing of the network; the defaults are the paper's (Section III-B)."""

    hidden: Annotated[int, Quantity(1, 1024)] = 100
    history: Annotated[int, Quantity(4, 2000, 'samples')] = 60  # of the windowed form
    warm_up: Annotated[int, Quantity(0, 2000, 'samples')] = 15  # after a reset, no estimate
    rate: Annotated[float, Quantity(10.0, 1000.0, 'Hz')] = 200.0
    block: Annotated[int, Quantity(1, 100, 'outputs')] = 4  # averaged into one estimate

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.warm_up >= self.history:
            raise InputError(f'warm_up = {self.warm_up} is not below history = {self.history}')


@dataclass(frozen=True)
class Network:
    """The network of one drive type and the ranges of its training data."""

    type: DriveType
    scaling: Scaling
    low: tuple[float, float, float]  # of each feature in the training data
    high: tuple[float, float, float]
    weights: Weights
    intervals: Intervals | None = None  # older files have neither
    out_of_distribution: OutOfDistributionScore | None = None


@schema
class TrainingRecording:
    """Recording that the networks were trained on; held_out: spans in s, by drive type."""

    name: Name
    sha256: Name
    card: dict[str, Any] = field(default_factory=dict)
    held_out: dict[str, tuple[tuple[_Time, _Time], ...]] = field(default_factory=dict)


@schema
class _TypeCard:
    patterns: tuple[Name, ...]
    feature_mean: tuple[_Number, _Number, _Number]
    feature_scale: tuple[_Scale, _Scale, _Scale]
    power_mean_w: _Number
    power_scale_w: _Scale
    low: tuple[_Number, _Number, _Number]
    high: tuple[_Number, _Number, _Number]
    intervals: Intervals | None = None
    likeness: OutOfDistributionScore | None = None


@schema
class _NetworkCard:
    format: Literal['power_prediction_network/1']
    software: Annotated[str, Printable(0)]
    features: tuple[str, ...]
    config: NetworkConfig
    types: dict[str, _TypeCard]
    training: dict[str, Any]
    recordings: tuple[TrainingRecording, ...]

    def __post_init__(self) -> None:
        if self.features != FEATURES:
            raise InputError(f'features {list(self.features)} are not {list(FEATURES)}')
        if not self.types:
            raise InputError('types holds no network')


@dataclass(frozen=True)
class Checkpoint:
    """Networks by drive type, with the settings and recordings of their training."""

    config: NetworkConfig
    networks: tuple[Network, ...]
    recordings: tuple[TrainingRecording, ...] = ()
    training: Mapping[str, Any] = field(default_factory=dict)
    software: str = ''

    def save(self, path: Path) -> None:
        """Write the networks to a file, or nothing; InputError if it cannot be written."""
        from safetensors.numpy import save  # only written files need it

        tensors = {
            f'{network.type.name}/{name}': np.ascontiguousarray(values)
            for network in self.networks
            for name, values in vars(network.weights).items()
        }
        card = asdict(
            _NetworkCard(
                'power_prediction_network/1',
                self.software,
                FEATURES,
                self.config,
                {n.type.name: _type_card(n) for n in self.networks},
                dict(self.training),
                self.recordings,
            )
        )
        # Readers of former versions expect no null.
        for kind, entry in card['types'].items():
            card['types'][kind] = {k: v for k, v in entry.items() if v is not None}
        write_whole(path, save(tensors, {'card': dump_yaml(card)}))

    @classmethod
    def load(cls, path: Path) -> 'Checkpoint':
        """Read FILE, RUN/model.safetensors or a shipped network by its name.

        InputError names the file and what is wrong.
        """
        file = path / FILE if os.path.isdir(path) else path
        if not os.path.lexists(file):
            shipped = sorted(SHIPPED.glob('*.safetensors'))
            if path.name not in [known.stem for known in shipped] or len(path.parts) > 1:
                names = ', '.join(known.stem for known in shipped)
                raise InputError(
                    f'{file}: there is no such file; train writes it when it is done '
                    f'(shipped: {names})'
                )
            file = SHIPPED / f'{path.name}.safetensors'
        content = read_tensors(file, 'network')
        try:
            return _checkpoint(content)
        except InputError as error:
            raise InputError(f'network {file}: {error}') from None


def _type_card(network: Network) -> _TypeCard:
    scaling = network.scaling
    return _TypeCard(
        patterns=network.type.patterns,
        feature_mean=scaling.mean,
        feature_scale=scaling.scale,
        power_mean_w=scaling.power_mean,
        power_scale_w=scaling.power_scale,
        low=network.low,
        high=network.high,
        intervals=network.intervals,
        likeness=network.out_of_distribution,
    )


def _checkpoint(content: TensorFile) -> Checkpoint:
    if 'card' not in content.texts:
        raise InputError('is not a Power Prediction Network: it has no card')
    card = parse(_NetworkCard, parse_yaml(content.texts['card'], 'card'), 'card')
    shapes = Weights.shapes(card.config.hidden)
    tensors = checked_tensors(
        content.tensors,
        {f'{kind}/{name}': shape for kind in card.types for name, shape in shapes.items()},
        'the file',
    )
    networks = tuple(
        Network(
            DriveType(kind, entry.patterns),
            Scaling(
                entry.feature_mean, entry.feature_scale, entry.power_mean_w, entry.power_scale_w
            ),
            entry.low,
            entry.high,
            Weights(**{name: tensors[f'{kind}/{name}'] for name in shapes}),
            entry.intervals,
            entry.likeness,
        )
        for kind, entry in card.types.items()
    )
    return Checkpoint(card.config, networks, card.recordings, card.training, card.software)
