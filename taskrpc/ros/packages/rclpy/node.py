"""Nodes: the class that programs derive from, with the methods that create everything else.

Its methods for parameters and for the graph are in `_impl.parameters.node_methods` and
`_impl.graph.node_graph`.
"""

from __future__ import annotations

import weakref
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

from taskrpc.message_types import MsgT, RequestT, ResponseT, Srv
from taskrpc.spi import names

from ._impl import cells
from ._impl.arguments import Arguments, Remapping, parse
from ._impl.bridge import Bridge
from ._impl.diagnostics import watchdog
from ._impl.execution.entity import callback_name, current_callback
from ._impl.graph.node_graph import GraphMethods
from ._impl.log.rosout import Rosout
from ._impl.node_entities import NodeEntities
from ._impl.node_interface import NodeHandle, NodeInterface
from ._impl.parameters.node_methods import ParameterMethods
from ._impl.parameters.node_parameters import NodeParameters
from ._impl.reexports import names_of
from .callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from .client import Client
from .clock import Clock, ROSClock
from .context import Context
from .exceptions import NotInitializedException
from .guard_condition import GuardCondition
from .impl.rcutils_logger import RcutilsLogger
from .logging import get_logger
from .logging_service import LoggingService
from .parameter import Parameter
from .parameter_service import ParameterService
from .publisher import Publisher
from .qos import QoSProfile, qos_profile_rosout_default, qos_profile_services_default
from .service import Service
from .subscription import Subscription, SubscriptionCallback
from .subscription_content_filter_options import ContentFilterOptions
from .time_source import TimeSource
from .timer import Rate, Timer
from .type_description_service import TypeDescriptionService
from .utilities import get_default_context
from .validate_namespace import validate_namespace
from .validate_node_name import validate_node_name
from .waitable import Waitable

if TYPE_CHECKING:
    from .executors import Executor


HIDDEN_NODE_PREFIX = "_"
"""The prefix of hidden node names; listings omit them by default."""


class _Unset:
    """Replaces an attribute until `Node.__init__` sets it; reading it explains the mistake."""

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._name = name

    def __get__(self, node: object | None, owner: type[object]) -> Any:
        if node is None:
            return self
        raise AttributeError(
            f"{type(node).__name__!r} object has no attribute {self._name!r};"
            " call super().__init__('a_name') before anything else of the node"
        )


class BaseNode(ParameterMethods, GraphMethods):
    """The name, the parameters and the services of a node; `Node` and `AsyncNode` run callbacks.

    Arguments:
        node_name, namespace: follow the rules of ROS; `__node` and `__ns` on the command line
            replace them.
        context: the context of `rclpy.init` by default.
        cli_args: arguments of this node alone; they take precedence over those of the program.
        use_global_arguments: whether the arguments of the program apply, too.
        enable_rosout, rosout_qos_profile: whether and how it publishes its log on `/rosout`.
        start_parameter_services: whether other programs may get and set its parameters.
        parameter_overrides: values that take precedence over declared ones.
        allow_undeclared_parameters: whether undeclared parameters can be set.
        automatically_declare_parameters_from_overrides: whether to declare all overrides.
        enable_logger_service: whether other programs may get and set the levels of its loggers.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
        start_parameter_services: bool = True,
        parameter_overrides: Sequence[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        node = cast("NodeInterface", self)  # a subclass has the other methods
        self._rclpy_begin()
        self._rclpy_entities = self._rclpy_entities_class(node)
        self._context = get_default_context() if context is None else context
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        given = [parse(cli_args)] if cli_args is not None else []
        if use_global_arguments:
            given.append(self._context.arguments)
        handle = self._rclpy_handle = self._rclpy_join(node_name, namespace or "", given)
        self._clock = self._rclpy_create_clock()
        self._logger = get_logger(handle.full_name.strip("/").replace("/", "."))
        self._rclpy_rosout: Rosout | None = None
        if enable_rosout and self._context.arguments.rosout_logs is not False:
            self._rclpy_rosout = Rosout(handle, self._logger.name, rosout_qos_profile)
        self._context.track_node(self)
        # The arguments of the program come first, so that those of the node replace them.
        parameters = NodeParameters(
            node, given[::-1], parameter_overrides, allow_undeclared_parameters
        )
        self._rclpy_keep(parameters)
        if automatically_declare_parameters_from_overrides:
            parameters.declare_overrides()
        self._time_source = TimeSource(node=node)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(node)
        self._type_description_service = TypeDescriptionService(node)
        if enable_logger_service:
            self._logging_service = LoggingService(node)
        self._rclpy_begun()

    def _rclpy_begin(self) -> None:
        """Set what the entities of a subclass need, before the first of them."""

    def _rclpy_begun(self) -> None:
        """Continue the creation of a subclass, after the entities of every node."""

    _rclpy_entities_class: ClassVar[type[NodeEntities]] = NodeEntities
    """Creates and keeps the entities."""

    def _rclpy_create_clock(self) -> ROSClock:
        return ROSClock()

    def _rclpy_join(self, node_name: str, namespace: str, given: list[Arguments]) -> NodeHandle:
        """Join the network under the name and the namespace after remapping."""
        remapping = Remapping(rule for one in given for rule in one.remaps)
        validate_node_name(node_name)
        if namespace:
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
        name = remapping.node_name(node_name)
        namespace = remapping.namespace(namespace, name)
        if cells.current is not None:
            full_name = names.fully_qualified(f"/{namespace.strip('/')}", name)
            cells.current.node_joins(cast("NodeInterface", self), full_name)
        bridge = Bridge(name, namespace, self._context.get_domain_id())
        return NodeHandle(self, name, bridge.namespace, remapping, bridge)

    # A program that uses the node before `super().__init__` reads one of these.
    _rclpy_handle: NodeHandle = _Unset()  # type: ignore[assignment]
    _rclpy_entities: NodeEntities = _Unset()  # type: ignore[assignment]
    _rclpy_parameters: NodeParameters = _Unset()  # type: ignore[assignment]
    _parameters: dict[str, Parameter] = _Unset()  # type: ignore[assignment]
    _parameter_overrides: dict[str, Parameter] = _Unset()  # type: ignore[assignment]
    _logger: RcutilsLogger = _Unset()  # type: ignore[assignment]
    _clock: Clock = _Unset()  # type: ignore[assignment]

    # Identity

    @property
    def context(self) -> Context:
        """Its context."""
        return self._context

    @property
    def handle(self) -> NodeHandle:
        """Its handle, which becomes invalid when the node is destroyed."""
        return self._rclpy_handle

    def get_name(self) -> str:
        """Its name, without the namespace."""
        self._rclpy_handle.check()
        return self._rclpy_handle.name

    def get_namespace(self) -> str:
        """Its namespace, which begins with `/`."""
        self._rclpy_handle.check()
        return self._rclpy_handle.namespace

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""
        self._rclpy_handle.check()
        return self._rclpy_handle.full_name

    def get_clock(self) -> Clock:
        """Its clock: the system time, or simulated time with `use_sim_time`."""
        return self._clock

    def get_logger(self) -> RcutilsLogger:
        """Its logger, which is named `namespace.name`."""
        return self._logger

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """The absolute name of a topic, after remapping unless `only_expand`."""
        return self._rclpy_handle.resolve(topic, is_service=False, only_expand=only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """The absolute name of a service, after remapping unless `only_expand`."""
        return self._rclpy_handle.resolve(service, is_service=True, only_expand=only_expand)

    def destroy_node(self) -> None:
        """Destroy its entities and leave the network; a second call does nothing."""
        if not self._rclpy_handle.valid:
            return
        self._context.untrack_node(self)
        self._rclpy_entities.destroy_all()
        if self._rclpy_rosout is not None:
            self._rclpy_rosout.destroy()
        self._rclpy_handle.destroy_when_not_in_use()
        self._rclpy_leave()

    def _rclpy_leave(self) -> None:
        """Leave the network."""
        self._rclpy_handle.bridge.close()


class Node(BaseNode):
    """A participant: has services, clients, publishers, subscriptions, timers and parameters.

    Its callbacks run while a thread spins it. It exists until `destroy_node`, or until the shutdown
    of its context. The arguments are those of BaseNode.
    """

    def _rclpy_begin(self) -> None:
        self._default_callback_group = MutuallyExclusiveCallbackGroup()
        self._rclpy_executor = None

    def _rclpy_begun(self) -> None:
        watchdog.watch(self)

    _rclpy_executor: Any = _Unset()
    _default_callback_group: CallbackGroup = _Unset()  # type: ignore[assignment]

    @property
    def executor(self) -> Executor | None:
        """The executor that runs its callbacks; None while it has none."""
        return None if self._rclpy_executor is None else self._rclpy_executor()

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        """Move the node to another executor; None removes it from its executor."""
        current = self.executor
        if current is new_executor:
            return
        if current is not None:
            current.remove_node(self)
            callback = current_callback()
            if callback is not None and callback.executor is current:
                self._rclpy_handle.taken_by = callback_name(callback)
        if new_executor is None:
            self._rclpy_executor = None
        else:
            new_executor.add_node(self)
            self._rclpy_executor = weakref.ref(new_executor)
            self._rclpy_handle.was_spun = True

    def destroy_node(self) -> None:
        """Destroy its entities and leave the network; a second call does nothing."""
        if self._rclpy_handle.valid:
            watchdog.ends(self)
            super().destroy_node()
            self._wake_executor()

    def _rclpy_leave(self) -> None:
        callback = current_callback()
        answering = None if callback is None else callback.entity
        if isinstance(answering, Service) and answering.parent_node is self:
            # The response of this callback must still be sent.
            answering.when_answered(self._rclpy_handle.bridge.close)
        else:
            super()._rclpy_leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.destroy_node()

    # Entities

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of entities that were created without one: one callback at a time."""
        return self._default_callback_group

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        """Its publishers."""
        return iter(self._rclpy_entities.publishers)

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        """Its subscriptions."""
        return iter(self._rclpy_entities.subscriptions)

    @property
    def clients(self) -> Iterator[Client[Any, Any]]:
        """Its clients."""
        return iter(self._rclpy_entities.clients)

    @property
    def services(self) -> Iterator[Service[Any, Any]]:
        """Its services."""
        return iter(self._rclpy_entities.services)

    @property
    def timers(self) -> Iterator[Timer]:
        """Its timers."""
        return iter(self._rclpy_entities.timers)

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """Its guard conditions."""
        return iter(self._rclpy_entities.guards)

    @property
    def waitables(self) -> Iterator[Waitable[Any]]:
        """Its waitables."""
        return iter(self._rclpy_entities.waitables)

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        publisher_class: type[Publisher[Any]] = Publisher,
    ) -> Publisher[MsgT]:
        """Create a publisher of a topic; a number as `qos_profile` is the depth."""
        return self._rclpy_entities.create_publisher(
            msg_type,
            topic,
            qos_profile,
            callback_group,
            event_callbacks,
            qos_overriding_options,
            publisher_class,
        )

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: SubscriptionCallback[MsgT],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> Subscription[MsgT]:
        """Create a subscription, which calls `callback(message)` for each message of a topic.

        A callback with two parameters also receives a `MessageInfo`; with `raw`, messages are CDR.
        `content_filter_options` select messages by content; see `Subscription.set_content_filter`.
        """
        return self._rclpy_entities.create_subscription(
            msg_type,
            topic,
            callback,
            qos_profile,
            callback_group,
            event_callbacks,
            qos_overriding_options,
            raw,
            content_filter_options,
        )

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client[RequestT, ResponseT]:
        """Create a client of a service."""
        return self._rclpy_entities.create_client(srv_type, srv_name, qos_profile, callback_group)

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callable[[RequestT, ResponseT], ResponseT | Awaitable[ResponseT]],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service[RequestT, ResponseT]:
        """Offer a service: `callback(request, response)` returns the response of a request.

        Raises NameInUse when another program offers the service.
        """
        return self._rclpy_entities.create_service(
            srv_type, srv_name, callback, qos_profile, callback_group
        )

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call `callback()` every `timer_period_sec` seconds, first after one period."""
        return self._rclpy_entities.create_timer(
            timer_period_sec, callback, callback_group, clock, autostart
        )

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Create a guard condition, which calls `callback()` when it is triggered."""
        return self._rclpy_entities.create_guard_condition(callback, callback_group)

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Create a rate of `frequency` hertz, for a thread other than the spinning one.

        Raises ValueError for a frequency of 0 or below.
        """
        return self._rclpy_entities.create_rate(frequency, clock)

    def add_waitable(self, waitable: Waitable[Any]) -> None:
        """Add a waitable, an entity that the program defines itself."""
        self._rclpy_entities.add_waitable(waitable)

    def remove_waitable(self, waitable: Waitable[Any]) -> None:
        """Remove a waitable."""
        self._rclpy_entities.remove_waitable(waitable)

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Destroy a publisher; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(publisher, entities.publishers)

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        """Destroy a subscription; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(subscription, entities.subscriptions)

    def destroy_client(self, client: Client[Any, Any]) -> bool:
        """Destroy a client; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(client, entities.clients)

    def destroy_service(self, service: Service[Any, Any]) -> bool:
        """Destroy a service; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(service, entities.services)

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(timer, entities.timers)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Destroy a guard condition; returns whether it belonged to this node."""
        entities = self._rclpy_entities
        return entities.destroy(guard, entities.guards)

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate and wake its sleepers; returns whether it belonged to this node."""
        return self._rclpy_entities.destroy_rate(rate)

    # Internal

    def _wake_executor(self) -> None:
        self._rclpy_entities.wake_executor()


__getattr__ = names_of(
    __name__,
    __package__,
    {
        "rcl_interfaces/msg": "FloatingPointRange IntegerRange ListParametersResult"
        " ParameterDescriptor ParameterEvent SetParametersResult",
        "rcl_interfaces/srv": "ListParameters",
        ".parameter": "PARAMETER_SEPARATOR_STRING ParameterMsg ParameterType ParameterValue",
        ".callback_groups": "CallbackGroup MutuallyExclusiveCallbackGroup ReentrantCallbackGroup",
        ".client": "Client",
        ".publisher": "Publisher",
        ".subscription": "MessageInfo Subscription",
        ".timer": "Rate Timer TimerInfo",
        ".guard_condition": "GuardCondition",
        ".waitable": "Waitable",
        ".executors": "Executor",
        ".task": "Future",
        ".exceptions": "InvalidHandle InvalidParameterTypeException InvalidParameterValueException"
        " InvalidTopicNameException NodeNameNonExistentError ParameterAlreadyDeclaredException"
        " ParameterImmutableException ParameterNotDeclaredException"
        " ParameterUninitializedException",
        ".qos": "qos_profile_parameter_events qos_profile_services_default",
        ".constants": "S_TO_NS",
        ".expand_topic_name": "expand_topic_name",
        ".topic_endpoint_info": "TopicEndpointInfo",
        ".event_handler": "PublisherEventCallbacks SubscriptionEventCallbacks",
        ".qos_overriding_options": "QoSOverridingOptions",
        ".type_support": "MsgType SrvType SrvTypeRequest SrvTypeResponse check_is_valid_msg_type"
        " check_is_valid_srv_type",
        ".validate_full_topic_name": "validate_full_topic_name",
        ".validate_parameter_name": "validate_parameter_name",
        ".validate_topic_name": "validate_topic_name",
    },
)
