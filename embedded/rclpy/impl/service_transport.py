"""Services on DDS as rmw_cyclonedds does them: a header before request and reply."""

import struct
import time
from itertools import count
from typing import Any

from cyclonedds.core import DDSException
from rosidl_embedded import codec

from rclpy.exceptions import InvalidHandle
from rclpy.impl.graph import Gids
from rclpy.impl.transport import Participant, Sample, raw_type, unread
from rclpy.qos import QoSProfile

HEADER = struct.Struct('<Qq')
MATCH_PATIENCE = 0.1
_sequence = count(1)


class ServiceEnd:
    """One end of a service (client or server): a DDS writer and reader with a common id."""

    def __init__(
        self, participant: Participant, srv_type: Any, name: str, qos: QoSProfile, is_server: bool
    ):
        codec.warm(srv_type.Request)
        codec.warm(srv_type.Response)
        request, reply = f'rq{name}Request', f'rr{name}Reply'
        self._incoming = srv_type.Request if is_server else srv_type.Response
        outgoing = srv_type.Response if is_server else srv_type.Request
        topic_in, topic_out = (request, reply) if is_server else (reply, request)
        name_in, name_out = self._incoming._type_name, outgoing._type_name
        user_data = f'{"serviceid" if is_server else "clientid"}={participant.next_end_id()};'
        self._raw: Any = raw_type(name_out)
        self._writer: Any = participant.writer(topic_out, name_out, qos, user_data)
        self.reader: Any = participant.reader(topic_in, name_in, qos, user_data)
        self.unread = unread(self.reader)
        self.gids: Gids = [self.reader.guid.bytes], [self._writer.guid.bytes]
        self.handle = self._writer.instance_handle & 0xFFFF_FFFF_FFFF_FFFF

    def send(self, message: Any, guid: int, sequence: int) -> None:
        """Send a request or reply with its header: the client's handle and sequence number."""
        self._writer.write(self._raw(codec.serialize(message, HEADER.pack(guid, sequence))))

    def request(self, message: Any) -> int:
        """Send a request and return the sequence number, which its reply will carry."""
        sequence = next(_sequence)
        self.send(message, self.handle, sequence)
        return sequence

    def take(self) -> list[tuple[int, int, int, Any]]:
        """Return received (client's handle, sequence number, writer's handle, message) tuples.

        Raises ValueError for bytes that are no request or reply.
        """
        taken = []
        for sample in self.reader.take(16):
            if sample.__class__ is Sample and len(sample) >= 4 + HEADER.size:
                guid, sequence = struct.unpack_from('<Qq' if sample[1] else '>Qq', sample, 4)
                message = codec.deserialize(sample, self._incoming, HEADER.size)
                taken.append((guid, sequence, sample.sample_info.publication_handle, message))
        return taken

    def wait_for_client(self, publication: int) -> None:
        """Wait up to 0.1 s for the reader of the client whose writer has handle `publication`."""
        wanted = _user_data(self.reader.get_matched_publication_data, publication, 'clientid')
        deadline = time.monotonic() + MATCH_PATIENCE
        while wanted is not None and time.monotonic() < deadline:
            if wanted in self._others(self._writer, 'clientid'):
                return
            time.sleep(0.005)

    def server_is_there(self) -> bool:
        """Return whether a server has matched both the writer and the reader."""
        readers = self._others(self._writer, 'serviceid')
        writers = self._others(self.reader, 'serviceid')
        return bool(readers & writers)

    @staticmethod
    def _others(endpoint: Any, key: str) -> set[str | None]:
        is_writer = hasattr(endpoint, 'get_matched_subscriptions')
        of_others = f'get_matched_{"subscription" if is_writer else "publication"}'
        look = getattr(endpoint, f'{of_others}_data')
        return {_user_data(look, handle, key) for handle in getattr(endpoint, f'{of_others}s')()}


class ServiceEntity:
    """Common part of clients and servers of a service."""

    def __init__(
        self, node: Any, srv_type: Any, srv_name: str, qos_profile: QoSProfile, is_server: bool
    ):
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self.context = node.context
        self._logger = node.get_logger()
        self._end: ServiceEnd | None = ServiceEnd(
            node.context.participant, srv_type, srv_name, qos_profile, is_server
        )
        self.gids = self._end.gids

    def _alive(self) -> ServiceEnd:
        if self._end is None:
            raise InvalidHandle
        return self._end

    def _conditions(self) -> list[tuple[Any, Any]]:
        return [] if self._end is None else [(self._end.unread, self._take)]

    def _take(self) -> list[tuple[Any, Any]]:
        if self._end is None:
            return []
        try:
            return [(self._execute, taken) for taken in self._end.take() if self._is_mine(taken)]
        except ValueError as error:
            self._logger.error(f"message of service '{self.srv_name}' dropped: {error}")
            return []

    def _is_mine(self, taken: tuple[int, int, int, Any]) -> bool:
        return True

    def _execute(self, taken: tuple[int, int, int, Any]) -> None:
        raise NotImplementedError

    def destroy(self) -> None:
        """Release the DDS reader and writer."""
        self._end = None


def _user_data(look: Any, handle: int, key: str) -> str | None:
    try:
        endpoint = look(handle)
    except (DDSException, TypeError):
        return None
    if endpoint is None:
        return None
    found = [policy for policy in endpoint.qos if policy.__scope__ == 'Userdata']
    text = found[0].data.decode(errors='replace') if found else ''
    pairs = dict(part.split('=', 1) for part in text.split(';') if '=' in part)
    return pairs.get(key, '')
