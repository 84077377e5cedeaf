"""The graph of nodes as rmw_dds_common exchanges it on `ros_discovery_info`."""

import threading
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState
from rosidl_embedded import deserialize, message_class, serialize

from rclpy.impl.transport import Participant, raw_type
from rclpy.qos import DurabilityPolicy, QoSProfile

TOPIC = 'ros_discovery_info'
TYPE = 'rmw_dds_common/msg/ParticipantEntitiesInfo'
PREFIXES = {'rt': 'topic', 'rq': 'request', 'rr': 'reply'}
BUILTIN = {
    'participant': BuiltinTopicDcpsParticipant,
    'writer': BuiltinTopicDcpsPublication,
    'reader': BuiltinTopicDcpsSubscription,
}
LIMIT = 20_000
Gids = tuple[list[bytes], list[bytes]]  # of readers and of writers


@dataclass
class NodeEntities:
    """A node's endpoints: the gids of its readers and writers."""

    name: str
    namespace: str
    readers: list[bytes] = field(default_factory=list)
    writers: list[bytes] = field(default_factory=list)


@dataclass(frozen=True)
class Endpoint:
    """A DDS reader or writer of the domain; kind: topic, request, reply or '' (not ROS)."""

    gid: bytes
    kind: str
    name: str
    type_name: str
    qos: Any


def ros_name(dds_name: str) -> tuple[str, str]:
    """Return (kind, name) of a DDS topic: `rt/a` is ('topic', '/a'), foreign ones ('', name)."""
    prefix, _, rest = dds_name.partition('/')
    kind = PREFIXES.get(prefix, '')
    if not kind or not rest:
        return '', dds_name
    if kind != 'topic':
        rest = rest.removesuffix('Request' if kind == 'request' else 'Reply')
    return kind, f'/{rest}'


def ros_type(dds_type: str) -> str:
    """Return `pkg/msg/Name` of `pkg::msg::dds_::Name_`; services without _Request, _Response."""
    name = dds_type.replace('::dds_::', '::').replace('::', '/').removesuffix('_')
    if '/srv/' in name:
        name = name.removesuffix('_Request').removesuffix('_Response')
    return name


def _qos(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Graph:
    """Announces this process's nodes to the domain and lists nodes, topics and services in it."""

    def __init__(self, participant: Participant):
        self._participant = participant
        self.lock = threading.RLock()
        self.nodes: list[NodeEntities] = []
        self._raw: Any = raw_type(TYPE)
        self._writer: Any = participant.writer(TOPIC, TYPE, _qos(1))
        self._reader: Any = None
        self._builtin: dict[str, Any] = {}
        self._heard: dict[bytes, list[NodeEntities]] = {}

    def close(self) -> None:
        """Release the graph's own DDS reader and writer."""
        self._writer = self._reader = None
        self._builtin.clear()

    def publish(self) -> None:
        """Send the list of this process's nodes to the domain."""
        make_gid = message_class('rmw_dds_common', 'Gid')
        make_node = message_class('rmw_dds_common', 'NodeEntitiesInfo')
        make_all = message_class('rmw_dds_common', 'ParticipantEntitiesInfo')

        def gid(data: bytes) -> Any:
            return make_gid(data=list(data))

        with self.lock:
            if self._writer is None:
                return
            nodes = [
                make_node(
                    node_namespace=node.namespace,
                    node_name=node.name,
                    reader_gid_seq=[gid(data) for data in node.readers],
                    writer_gid_seq=[gid(data) for data in node.writers],
                )
                for node in self.nodes
            ]
            info = make_all(gid=gid(self._participant.gid), node_entities_info_seq=nodes)
            self._writer.write(self._raw(serialize(info)))

    def _listen(self) -> None:
        if self._reader is None:
            self._reader = self._participant.reader(TOPIC, TYPE, _qos(1000))
            dds = self._participant.dds
            self._builtin = {
                kind: BuiltinDataReader(dds, topic) for kind, topic in BUILTIN.items()
            }

    def _alive(self, kind: str) -> list[Any]:
        self._listen()
        samples = self._builtin[kind].read(LIMIT)
        return [s for s in samples if s.sample_info.instance_state == InstanceState.Alive]

    def participants(self) -> list[NodeEntities]:
        """Return the nodes of all living participants, this process's own included."""
        with self.lock:
            self._listen()
            cls = message_class('rmw_dds_common', 'ParticipantEntitiesInfo')
            while samples := self._reader.take(100):
                for sample in samples:
                    if isinstance(sample, bytes):
                        info = deserialize(sample, cls)
                        self._heard[bytes(info.gid.data)] = [
                            NodeEntities(
                                node.node_name,
                                node.node_namespace,
                                [bytes(gid.data) for gid in node.reader_gid_seq],
                                [bytes(gid.data) for gid in node.writer_gid_seq],
                            )
                            for node in info.node_entities_info_seq
                        ]
            alive = {s.key.bytes for s in self._alive('participant')}
            self._heard = {gid: nodes for gid, nodes in self._heard.items() if gid in alive}
            others = [
                n for gid, ns in self._heard.items() for n in ns if gid != self._participant.gid
            ]
            return self.nodes + others

    def endpoints(self, kind: str) -> list[Endpoint]:
        """Return all readers (`reader`) or writers (`writer`) of the domain."""
        with self.lock:
            found = []
            for sample in self._alive(kind):
                name_kind, name = ros_name(sample.topic_name)
                type_name = ros_type(sample.type_name)
                found.append(Endpoint(sample.key.bytes, name_kind, name, type_name, sample.qos))
            return found

    def topics(self) -> dict[str, list[str]]:
        """Return the type names of each topic, by absolute topic name."""
        return _types('topic', [*self.endpoints('writer'), *self.endpoints('reader')])

    def services(self) -> dict[str, list[str]]:
        """Return the type names of each service that has a server, by absolute name."""
        return _types('request', self.endpoints('reader'))

    def count(self, kind: str, topic: str) -> int:
        """Count the readers (`reader`) or writers (`writer`) of a topic."""
        return sum(e.kind == 'topic' and e.name == topic for e in self.endpoints(kind))


def _types(kind: str, endpoints: Sequence[Endpoint]) -> dict[str, list[str]]:
    types: defaultdict[str, set[str]] = defaultdict(set)
    for end in endpoints:
        if end.kind == kind:
            types[end.name].add(end.type_name)
    return {name: sorted(found) for name, found in sorted(types.items())}
