"""Trained networks on disk: one safetensors file with a YAML card inside, never a pickle."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from power_estimator.drive_types import DriveType
from power_estimator.network.features import FEATURES, Scaling
from power_estimator.network.intervals import Intervals
from power_estimator.network.lstm import Weights
from power_estimator.network.out_of_distribution import OutOfDistributionScore

Floats = NDArray[np.float32]
FILE = 'model.safetensors'
FORMAT = 'power_prediction_network/1'
_TENSORS = ('input', 'recurrent', 'bias', 'output', 'output_bias')


@dataclass(frozen=True)
class NetworkConfig:
    """Shape and timing of the network; the defaults are the paper's (Section III-B)."""

    hidden: int = 100
    history: int = 60  # samples of the windowed form, 0.3 s at 200 Hz
    warm_up: int = 15  # samples after a reset without an estimate
    rate: float = 200.0  # Hz, of input and output
    block: int = 4  # outputs averaged into one estimate, 50 Hz

    def __post_init__(self) -> None:
        limits = {
            'hidden': (1, 1024),
            'history': (4, 2000),
            'warm_up': (0, 2000),
            'rate': (10.0, 1000.0),
            'block': (1, 100),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise InputError(f'{name} = {value!r} is not a number')
            if not low <= value <= high:
                raise InputError(f'{name} = {value} is not within {low} … {high}')
        if self.warm_up >= self.history:
            raise InputError(f'warm_up = {self.warm_up} is not below history = {self.history}')


@dataclass(frozen=True)
class Network:
    """What was learned about one drive type."""

    type: DriveType
    scaling: Scaling
    low: tuple[float, float, float]  # of each feature in the training data
    high: tuple[float, float, float]
    weights: Weights
    intervals: Intervals | None = None  # older files have neither
    likeness: OutOfDistributionScore | None = None


@dataclass(frozen=True)
class TrainingRecording:
    """A recording that the networks were trained on."""

    name: str
    sha256: str
    card: Mapping[str, Any] = field(default_factory=dict)
    held_out: Mapping[str, list[list[float]]] = field(default_factory=dict)  # s, by drive type


@dataclass(frozen=True)
class Checkpoint:
    """Networks by drive type, how they were trained and on what."""

    config: NetworkConfig
    networks: tuple[Network, ...]
    recordings: tuple[TrainingRecording, ...] = ()
    training: Mapping[str, Any] = field(default_factory=dict)
    software: str = ''

    def save(self, path: Path) -> None:
        """Write atomically; InputError if the folder cannot be written."""
        tensors = {
            f'{network.type.name}/{name}': np.ascontiguousarray(getattr(network.weights, name))
            for network in self.networks
            for name in _TENSORS
        }
        card = {
            'format': FORMAT,
            'software': self.software,
            'features': list(FEATURES),
            'config': asdict(self.config),
            'types': {n.type.name: _type_card(n) for n in self.networks},
            'training': dict(self.training),
            'recordings': [asdict(recording) for recording in self.recordings],
        }
        write_whole(path, save(tensors, {'card': yaml.safe_dump(card, sort_keys=False)}))

    @classmethod
    def load(cls, path: Path) -> 'Checkpoint':
        """Read FILE or RUN/model.safetensors; InputError names the file and what is wrong."""
        file = path / FILE if path.is_dir() else path
        try:
            tensors, card = _read(file)
            return _checkpoint(tensors, card)
        except InputError as error:
            raise InputError(f'{file}: {error}') from None
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f'{file}: its card is incomplete or damaged ({error!r})') from None


def _type_card(network: Network) -> dict[str, Any]:
    card: dict[str, Any] = {
        'patterns': list(network.type.patterns),
        'feature_mean': list(network.scaling.mean),
        'feature_scale': list(network.scaling.scale),
        'power_mean_w': network.scaling.power_mean,
        'power_scale_w': network.scaling.power_scale,
        'low': list(network.low),
        'high': list(network.high),
    }
    if network.intervals is not None:
        card['intervals'] = network.intervals.content()
    if network.likeness is not None:
        card['likeness'] = network.likeness.content()
    return card


def _read(file: Path) -> tuple[dict[str, Floats], dict[str, Any]]:
    try:
        with file.open('rb') as stream:
            head = stream.read(9)
    except FileNotFoundError:
        raise InputError('there is no such file; train writes it when it is done') from None
    except OSError as error:
        raise InputError(f'cannot be read ({error.strerror})') from None
    if head[8:] != b'{' and (head[:2] == b'PK' or head[:1] == b'\x80'):
        raise InputError('is a pickle (torch.save); only safetensors is read, it runs no code')
    try:
        with safe_open(file, framework='np') as tensors:
            metadata = tensors.metadata() or {}
            values = {key: tensors.get_tensor(key) for key in tensors.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(f'is damaged or not safetensors ({error})') from None
    try:
        card = yaml.safe_load(metadata.get('card', ''))
    except yaml.YAMLError:
        raise InputError('its card is not valid YAML') from None
    if not isinstance(card, dict) or card.get('format') != FORMAT:
        raise InputError(f'is not a Power Prediction Network of format {FORMAT}')
    return values, card


def _checkpoint(tensors: dict[str, Floats], card: dict[str, Any]) -> Checkpoint:
    if tuple(card['features']) != FEATURES:
        raise InputError(f'features {card["features"]} are not {list(FEATURES)}')
    config = NetworkConfig(**card['config'])
    networks = []
    for name, entry in card['types'].items():
        missing = [t for t in _TENSORS if f'{name}/{t}' not in tensors]
        if missing:
            raise InputError(f'tensor {name}/{missing[0]} is missing')
        weights = Weights(**{t: tensors[f'{name}/{t}'] for t in _TENSORS})
        if weights.hidden != config.hidden:
            raise InputError(f'{name} has {weights.hidden} units, the card says {config.hidden}')
        scaling = Scaling(
            _three(entry['feature_mean']),
            _three(entry['feature_scale']),
            float(entry['power_mean_w']),
            float(entry['power_scale_w']),
        )
        kind = DriveType(str(name), tuple(str(p) for p in entry['patterns']))
        intervals = Intervals.of(entry['intervals']) if 'intervals' in entry else None
        likeness = OutOfDistributionScore.of(entry['likeness']) if 'likeness' in entry else None
        low, high = _three(entry['low']), _three(entry['high'])
        networks.append(Network(kind, scaling, low, high, weights, intervals, likeness))
    if not networks:
        raise InputError('holds no network')
    return Checkpoint(
        config,
        tuple(networks),
        tuple(TrainingRecording(**recording) for recording in card['recordings']),
        dict(card['training']),
        str(card['software']),
    )


def _three(values: Any) -> tuple[float, float, float]:
    a, b, c = (float(v) for v in values)
    return a, b, c
