"""Cyclone DDS underneath: participants, topics of raw CDR, and the set of entities waited for."""

import ctypes
import os
from functools import cache
from itertools import count
from typing import Any
from weakref import WeakValueDictionary

from cyclonedds.core import Entity, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import uint8
from cyclonedds.internal import c_call, dds_c_t
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosidl_embedded import definitions

from rclpy.qos import QoSProfile, to_dds

MAX_PARTICIPANTS = 100
LOOPBACK = (
    '<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    '<AllowMulticast>false</AllowMulticast></General>'
)
RANGES = ('LOCALHOST', 'SUBNET', 'OFF', 'SYSTEM_DEFAULT')


class Sample(bytes):
    """The CDR bytes of a received sample; the reader adds `sample_info`."""

    sample_info: Any


class RawSample:
    """CDR bytes to be sent, in the form that the DDS writer of cyclonedds accepts."""

    def __init__(self, cdr: bytes):
        self.cdr = cdr

    def serialize(self, **_: Any) -> bytes:
        """Return the CDR bytes; arguments are ignored."""
        return self.cdr


@cache
def raw_type(type_name: str) -> type[IdlStruct]:
    """Return the DDS type of `pkg/msg/Name`, whose samples are uninterpreted CDR bytes."""
    package, kind, name = type_name.split('/')
    dds_name = f'{package}::{kind}::dds_::{name}_'
    idl = make_idl_struct('Raw', dds_name, {'structure': uint8}, dataclassify=False)
    members = {'serialize': RawSample.serialize, '__init__': RawSample.__init__}
    for member, function in members.items():
        setattr(idl, member, function)
    for member in ('deserialize', 'deserialize_key'):
        setattr(idl, member, classmethod(lambda cls, data, **_: Sample(data)))
    return idl


def domain_configuration() -> str:
    """Return Cyclone's configuration for ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS.

    The default is LOCALHOST: the loopback interface and no multicast. Raises RuntimeError for a
    range that ROS does not know.
    """
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') or 'LOCALHOST'
    if reach not in RANGES:
        raise RuntimeError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{reach}', it must be one of {', '.join(RANGES)}"
        )
    if reach == 'SYSTEM_DEFAULT':
        return '<CycloneDDS><Domain Id="any"/></CycloneDDS>'
    if reach == 'OFF':
        discovery = f'<ParticipantIndex>none</ParticipantIndex><Tag>off_{os.getpid()}</Tag>'
        return _configuration(LOOPBACK, discovery)
    peers = [peer for peer in os.environ.get('ROS_STATIC_PEERS', '').split(';') if peer]
    if reach == 'LOCALHOST':
        peers.insert(0, '127.0.0.1')
    discovery = (
        '<ParticipantIndex>auto</ParticipantIndex>'
        f'<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>'
    )
    if peers:
        entries = ''.join(f'<Peer address="{peer}"/>' for peer in peers)
        discovery += f'<Peers>{entries}</Peers>'
    return _configuration(LOOPBACK if reach == 'LOCALHOST' else '', discovery)


def _configuration(general: str, discovery: str) -> str:
    return (
        f'<CycloneDDS><Domain Id="any">{general}<Discovery>{discovery}</Discovery>'
        '</Domain></CycloneDDS>'
    )


_domains: WeakValueDictionary[int, Domain] = WeakValueDictionary()


class Participant:
    """One DDS participant; it makes readers and writers of raw CDR."""

    def __init__(self, domain_id: int, configuration: str, enclave: str = '/'):
        if (domain := _domains.get(domain_id)) is None:
            domain = _domains[domain_id] = Domain(domain_id, configuration)
        self._domain = domain  # which ends with the last that holds it
        user_data = Policy.Userdata(f'enclave={enclave};'.encode())
        self.dds = DomainParticipant(domain_id, Qos(user_data))
        self.gid: bytes = self.dds.guid.bytes
        self._topics: WeakValueDictionary[tuple[str, str], Topic] = WeakValueDictionary()
        self._ends = count(1)

    def next_end_id(self) -> str:
        """Return an id that no other client or server of the domain has."""
        return f'{self.gid.hex(".")}.{next(self._ends)}'

    def _topic(self, name: str, type_name: str) -> Topic:
        if (topic := self._topics.get((name, type_name))) is None:
            topic = self._topics[name, type_name] = Topic(self.dds, name, raw_type(type_name))
        return topic

    def writer(
        self, name: str, type_name: str, qos: QoSProfile, user_data: str = ''
    ) -> DataWriter:
        """Make a writer of a DDS topic, such as `rt/joint_states`; type_name: `pkg/msg/Name`."""
        return DataWriter(self.dds, self._topic(name, type_name), _qos(qos, type_name, user_data))

    def reader(
        self, name: str, type_name: str, qos: QoSProfile, user_data: str = ''
    ) -> DataReader:
        """Make a reader of a DDS topic, such as `rt/joint_states`; type_name: `pkg/msg/Name`."""
        return DataReader(self.dds, self._topic(name, type_name), _qos(qos, type_name, user_data))


def _qos(profile: QoSProfile, type_name: str, user_data: str) -> Qos:
    return to_dds(profile, f'{user_data}typehash={definitions.type_hash(type_name)};')


class EntityWaitSet(WaitSet):
    """A DDS wait set that returns which of its entities triggered."""

    def __init__(self, participant: Participant):
        super().__init__(participant.dds)
        self._slots: Any = (ctypes.c_void_p * 0)()
        self._entities: dict[int, Entity] = {}

    def _refresh(self) -> None:
        self._entities = {ctypes.addressof(mark): entity for entity, mark in self.attached}
        self._slots = (ctypes.c_void_p * max(1, len(self.attached)))()

    def attach(self, entity: Entity) -> None:
        """Add an entity to those waited for."""
        super().attach(entity)
        self._refresh()

    def detach(self, entity: Entity) -> None:
        """Remove an entity from those waited for."""
        super().detach(entity)
        self._refresh()

    def wait_for_entities(self, timeout_ns: int) -> list[Entity]:
        """Block until an entity triggers, at most timeout_ns; return those that triggered."""
        slots, entities = self._slots, self._entities
        count = self._wait_with_marks(self._ref, slots, len(slots), timeout_ns)
        marks = slots[: min(max(count, 0), len(slots))]
        return [entities[mark] for mark in marks if mark in entities]

    @c_call('dds_waitset_wait')
    def _wait_with_marks(
        self,
        waitset: dds_c_t.entity,  # type: ignore[valid-type]
        xs: ctypes.POINTER(dds_c_t.attach),  # type: ignore[valid-type]
        nxs: ctypes.c_size_t,
        reltimeout: dds_c_t.duration,  # type: ignore[valid-type]
    ) -> dds_c_t.returnv:  # type: ignore[valid-type]
        pass


def unread(reader: DataReader) -> ReadCondition:
    """Return a condition that is true while a reader has samples that were not taken."""
    return ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
