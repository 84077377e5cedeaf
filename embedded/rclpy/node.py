"""Nodes."""

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ROSClock
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.impl import arguments
from rclpy.impl.graph import NodeEntities
from rclpy.impl.parameters import Parameters
from rclpy.logging import RcutilsLogger, get_logger
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, profile_of, qos_profile_services_default
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource
from rclpy.timer import Timer
from rclpy.utilities import get_default_context

ENDPOINTS = (Publisher, Subscription, Client, Service)


class Node(Parameters):
    """A node: publishers, subscriptions, services, clients, timers and parameters by one name."""

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
    ):
        self._context = get_default_context() if context is None else context
        if not self._context.ok():
            raise NotInitializedException('cannot create node')
        own = arguments.parse(['--ros-args', *(cli_args or [])])
        shared = self._context.arguments
        own.remaps += shared.remaps
        own.parameters = shared.parameters + own.parameters
        self._arguments = own
        self._set_names(node_name, namespace or '')
        given = own.overrides(self.get_fully_qualified_name())
        given |= {parameter.name: parameter.value for parameter in parameter_overrides or []}
        super().__init__(given)
        self._logger = get_logger(self.get_fully_qualified_name()[1:].replace('/', '.'))
        self._default_callback_group = MutuallyExclusiveCallbackGroup()
        self._entities: dict[type, list[Any]] = {kind: [] for kind in (*ENDPOINTS, Timer)}
        self._executor: Any = None
        self._destroyed = False
        self._clock = ROSClock()
        self._graph_entry = NodeEntities(self._name, self._namespace)
        self._context.graph.nodes.append(self._graph_entry)
        self._context._nodes.add(self)
        self._time_source = TimeSource(self, self._clock)
        if start_parameter_services:
            ParameterService(self)
        self._tell()

    def _set_names(self, node_name: str, namespace: str) -> None:
        arguments.validate_node_name(node_name)
        self._name = self._arguments.node_name(node_name)
        arguments.validate_node_name(self._name)
        namespace = self._arguments.namespace(node_name, namespace or '/')
        self._namespace = namespace if namespace.startswith('/') else f'/{namespace}'
        arguments.validate_namespace(self._namespace)

    @property
    def context(self) -> Context:
        """Context of the node."""
        return self._context

    @property
    def executor(self) -> Any:
        """Executor that the node was added to."""
        return self._executor

    @property
    def publishers(self) -> Iterator[Publisher]:
        """Publishers of the node."""
        return iter(list(self._entities[Publisher]))

    @property
    def timers(self) -> Iterator[Timer]:
        """Timers of the node."""
        return iter(list(self._entities[Timer]))

    def get_name(self) -> str:
        """Return the name without namespace."""
        return self._name

    def get_namespace(self) -> str:
        """Return the namespace."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""
        return f'{self._namespace.rstrip("/")}/{self._name}'

    def get_clock(self) -> Clock:
        """Return the clock of ROS time."""
        return self._clock

    def get_logger(self) -> RcutilsLogger:
        """Return the logger."""
        return self._logger

    def _resolve(self, name: str, is_service: bool) -> str:
        absolute = arguments.expand(name, self._name, self._namespace, is_service)
        return self._arguments.topic(absolute, self._name, self._namespace, is_service)

    def resolve_topic_name(self, topic: str) -> str:
        """Return the absolute name of a topic after remapping."""
        return self._resolve(topic, False)

    def resolve_service_name(self, service: str) -> str:
        """Return the absolute name of a service after remapping."""
        return self._resolve(service, True)

    def _add(self, entity: Any) -> Any:
        self._entities[type(entity)].append(entity)
        if type(entity) is not Timer and hasattr(self, '_time_source'):
            self._tell()
        self._wake(changed=True)
        return entity

    def _tell(self) -> None:
        """Tell others of the endpoints that the node has now."""
        graph = self._context._graph
        if graph is None:
            return
        with graph.lock:  # what another thread makes meanwhile is told by its own call
            gids = [entity.gids for kind in ENDPOINTS for entity in self._entities[kind]]
            self._graph_entry.readers = [gid for readers, _ in gids for gid in readers]
            self._graph_entry.writers = [gid for _, writers in gids for gid in writers]
            graph.publish()

    def _alive(self) -> None:
        if self._destroyed:
            raise InvalidHandle
        if not self._context.ok():
            raise NotInitializedException("the node's context is invalid")

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int
    ) -> Publisher:
        """Make a publisher; qos_profile: or a depth. InvalidTopicNameException for bad names."""
        profile = profile_of(qos_profile)
        self._alive()
        name = self._resolve(topic, False)
        return self._add(Publisher(self, msg_type, name, topic, profile))

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        raw: bool = False,
    ) -> Subscription:
        """Make a subscription with a callback (message) or (message, info); `raw`: CDR bytes."""
        profile = profile_of(qos_profile)
        self._alive()
        name = self._resolve(topic, False)
        group = callback_group or self._default_callback_group
        made = Subscription(
            self, msg_type, name, topic, callback, group, profile, raw, event_callbacks
        )
        return self._add(made)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any] | None,
        *,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Make a timer with a period [s] on a clock, the node's if None."""
        self._alive()
        period = int(float(timer_period_sec) * 1_000_000_000)
        timer = Timer(callback, period, clock or self._clock, autostart=autostart)
        timer._wake = self._wake
        return self._add(timer)

    def _wake(self, changed: bool = False) -> None:
        if self._executor is not None:
            self._executor.wake(changed)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
    ) -> Service:
        """Make a server of a service with a callback (request, response) -> response."""
        self._alive()
        name = self._resolve(srv_name, True)
        return self._add(Service(self, srv_type, name, callback, qos_profile))

    def create_client(self, srv_type: Any, srv_name: str) -> Client:
        """Make a client of a service."""
        self._alive()
        name = self._resolve(srv_name, True)
        return self._add(Client(self, srv_type, name, qos_profile_services_default))

    def _remove(self, entity: Any) -> bool:
        """Destroy an entity; False where it is not the node's."""
        known = self._entities[type(entity)]
        if entity not in known:
            return False
        known.remove(entity)
        if type(entity) is not Timer:
            self._tell()
        entity.destroy()
        if self._executor is not None:
            self._executor.forget()
        return True

    destroy_subscription = destroy_client = destroy_timer = _remove

    def destroy_node(self) -> None:
        """Destroy the node with all that it has."""
        self._release()

    def _release(self) -> None:
        if self._destroyed:
            return
        self._destroyed = True
        if self._executor is not None:
            self._executor.remove_node(self)
        for entities in self._entities.values():
            for entity in entities:
                entity.destroy()
            entities.clear()
        graph = self._context._graph
        if graph is not None:
            graph.nodes = [entry for entry in graph.nodes if entry is not self._graph_entry]
            graph.publish()

    def _conditions(self) -> list[tuple[Any, Callable[[], list[Any]]]]:
        """Entities to wait for, each with what gives the callbacks that are then due."""
        entities = [entity for kind in ENDPOINTS for entity in self._entities[kind]]
        return [pair for entity in entities for pair in entity._conditions()]

    def count_publishers(self, topic_name: str) -> int:
        """Return the number of publishers of a topic in the domain."""
        return self._context.graph.count('writer', self.resolve_topic_name(topic_name))

    def count_subscribers(self, topic_name: str) -> int:
        """Return the number of subscriptions to a topic in the domain."""
        return self._context.graph.count('reader', self.resolve_topic_name(topic_name))

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return (name, type names) of each topic of the domain."""
        return list(self._context.graph.topics().items())

    def get_service_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return (name, type names) of each service of the domain."""
        return list(self._context.graph.services().items())
