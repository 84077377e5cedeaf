"""Events of the middleware: readers and writers that do not fit each other."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import DDSStatus

from rclpy.qos import DDS_POLICIES, QoSPolicyKind


@dataclass(frozen=True)
class QoSRequestedIncompatibleQoSInfo:
    """Number of peers with incompatible QoS, and the policy that differed last."""

    total_count: int
    total_count_change: int
    last_policy_kind: QoSPolicyKind


@dataclass(frozen=True)
class SubscriptionEventCallbacks:
    """Callbacks of a subscription's events; without a callback a warning is logged."""

    incompatible_qos: Callable[[QoSRequestedIncompatibleQoSInfo], None] | None = None
    use_default_callbacks: bool = True


REQUESTED = (
    "New publisher discovered on topic '{topic}', offering incompatible QoS. "
    'No messages will be received from it. Last incompatible policy: {policy}'
)
OFFERED = (
    "New subscription discovered on topic '{topic}', requesting incompatible QoS. "
    'No messages will be sent to it. Last incompatible policy: {policy}'
)


class IncompatibleQos:
    """Watches a DDS reader or writer for peers with incompatible QoS."""

    def __init__(self, endpoint: Any, is_reader: bool, topic: str, events: Any, logger: Any):
        self.entity = endpoint
        self._text = REQUESTED if is_reader else OFFERED
        self._topic, self._events, self._logger = topic, events, logger
        if is_reader:
            self._status = endpoint.get_requested_incompatible_qos_status
            endpoint.set_status_mask(DDSStatus.RequestedIncompatibleQos)
        else:
            self._status = endpoint.get_offered_incompatible_qos_status
            endpoint.set_status_mask(DDSStatus.OfferedIncompatibleQos)

    def check(self) -> list[Any]:
        """Call back, or log a warning, if new incompatible peers appeared; leave nothing due."""
        status = self._status()
        if status.total_count_change <= 0:
            return []
        policy = DDS_POLICIES.get(status.last_policy_id, QoSPolicyKind.INVALID)
        callback = self._events.incompatible_qos if self._events else None
        if callback is not None:
            info = (status.total_count, status.total_count_change, policy)
            callback(QoSRequestedIncompatibleQoSInfo(*info))
        elif self._events is None or self._events.use_default_callbacks:
            self._logger.warn(self._text.format(topic=self._topic, policy=policy.name))
        return []
