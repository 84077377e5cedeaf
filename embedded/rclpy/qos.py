"""Quality of service: profiles and policies."""

import warnings
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from cyclonedds.qos import Policy, Qos

from rclpy._rclpy_pybind11 import RCLError
from rclpy.duration import Infinite

LONGEST_BLOCK_NS = 100_000_000


class InvalidQoSProfileException(Exception):  # noqa: N818
    """Raised when a profile is made of invalid arguments."""

    def __init__(self, *args: object):
        super().__init__('Invalid QoSProfile', *args)


class QoSPolicyKind(IntEnum):
    """The policies that a reader and a writer may disagree on."""

    INVALID = 1
    DURABILITY = 2
    DEADLINE = 4
    LIVELINESS = 8
    RELIABILITY = 16
    HISTORY = 32
    LIFESPAN = 64


DDS_POLICIES = {
    2: QoSPolicyKind.DURABILITY,
    4: QoSPolicyKind.DEADLINE,
    8: QoSPolicyKind.LIVELINESS,
    10: QoSPolicyKind.LIFESPAN,
    11: QoSPolicyKind.RELIABILITY,
    13: QoSPolicyKind.HISTORY,
}


class HistoryPolicy(IntEnum):
    """Queueing of samples: the latest `depth`, or all."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(IntEnum):
    """Delivery: lost samples are sent again (RELIABLE), or not."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(IntEnum):
    """Durability: late joiners get earlier samples (TRANSIENT_LOCAL), or not."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class LivelinessPolicy(IntEnum):
    """Way in which a writer asserts that it is alive."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3


_ENUMS: dict[str, Any] = {
    'history': HistoryPolicy,
    'reliability': ReliabilityPolicy,
    'durability': DurabilityPolicy,
    'liveliness': LivelinessPolicy,
}


@dataclass(init=False, repr=False, slots=True)
class QoSProfile:
    """A set of policies; InvalidQoSProfileException unless `depth` or `history` is given."""

    depth: int
    durability: DurabilityPolicy
    history: HistoryPolicy
    liveliness: LivelinessPolicy
    reliability: ReliabilityPolicy

    def __init__(self, **kwargs: Any):
        unknown = sorted(set(kwargs) - set(self.__slots__))
        assert not unknown, f'Invalid arguments passed to constructor: {unknown}'
        if 'history' not in kwargs:
            if 'depth' not in kwargs:
                raise InvalidQoSProfileException('History and/or depth settings are required.')
            kwargs['history'] = HistoryPolicy.KEEP_LAST
        if kwargs['history'] == HistoryPolicy.KEEP_LAST and 'depth' not in kwargs:
            raise InvalidQoSProfileException('History set to KEEP_LAST without a depth setting.')
        self.history = kwargs.pop('history')
        self.depth = kwargs.pop('depth', 10)
        self.reliability = ReliabilityPolicy.RELIABLE
        self.durability = DurabilityPolicy.VOLATILE
        self.liveliness = LivelinessPolicy.SYSTEM_DEFAULT
        for name, value in kwargs.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _ENUMS:
            assert isinstance(value, int)
            value = _ENUMS[name](value)
        elif name == 'depth':
            assert isinstance(value, int)
            if value == 0 and self.history == HistoryPolicy.KEEP_LAST:
                warnings.warn(
                    "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                    'This will be interpreted as SYSTEM_DEFAULT',
                    stacklevel=3,
                )
        object.__setattr__(self, name, value)

    def __str__(self) -> str:
        shown = ', '.join(f'{name}={getattr(self, name)}' for name in self.__slots__)
        return f'QoSProfile({shown})'


def profile_of(qos: QoSProfile | int) -> QoSProfile:
    """Return a profile as given, or a default one of a depth; TypeError, ValueError otherwise.

    RCLError for a profile of negative depth, which only what is made of it refuses.
    """
    if isinstance(qos, QoSProfile):
        if qos.depth < 0:
            raise RCLError('unsupported history depth')
        return qos
    if isinstance(qos, bool) or not isinstance(qos, int):
        raise TypeError(f'Expected QoSProfile or int, but received {type(qos)!r}')
    if qos < 0:
        raise ValueError('history depth must be greater than or equal to zero')
    return QoSProfile(depth=qos)


def to_dds(profile: QoSProfile, user_data: str) -> Qos:
    """Convert a profile to the DDS QoS that rmw_cyclonedds makes; user_data: text sent along."""
    history: Any = Policy.History.KeepAll
    if profile.history != HistoryPolicy.KEEP_ALL:
        history = Policy.History.KeepLast(max(1, profile.depth))
    reliability: Any = Policy.Reliability.Reliable(max_blocking_time=LONGEST_BLOCK_NS)
    if profile.reliability == ReliabilityPolicy.BEST_EFFORT:
        reliability = Policy.Reliability.BestEffort
    durability: list[Any] = [Policy.Durability.Volatile]
    if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        kept = Policy.DurabilityService(0, history, -1, -1, -1)
        durability = [Policy.Durability.TransientLocal, kept]
    manual = profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    liveliness: Any = Policy.Liveliness.ManualByTopic if manual else Policy.Liveliness.Automatic
    return Qos(
        history,
        reliability,
        *durability,
        liveliness(Infinite.nanoseconds),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
        Policy.Userdata(user_data.encode()),
    )


def from_dds(qos: Qos) -> QoSProfile:
    """Convert the DDS QoS of a discovered endpoint to a profile; history and depth are unknown."""
    found = {policy.__scope__: policy for policy in qos}
    profile = QoSProfile(history=HistoryPolicy.UNKNOWN, depth=0)
    if found.get('Reliability') is Policy.Reliability.BestEffort:
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    if found.get('Durability') not in (None, Policy.Durability.Volatile):
        profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if (liveliness := found.get('Liveliness')) is not None:
        manual = isinstance(liveliness, Policy.Liveliness.ManualByTopic)
        kind = LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC
        profile.liveliness = kind
    return profile


qos_profile_services_default = QoSProfile(depth=10)
qos_profile_parameters = QoSProfile(depth=1000)
