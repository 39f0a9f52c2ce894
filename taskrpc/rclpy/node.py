"""Nodes: what programs derive their classes from, and what makes everything else."""

from __future__ import annotations

import inspect
import weakref
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from taskrpc import names
from taskrpc.errors import InvalidName

from ._impl.arguments import Arguments, parse
from ._impl.bridge import Bridge
from ._impl.diagnostics import watchdog
from ._impl.execution.entity import callback_name, current_callback
from ._impl.graph.names import kind_of, translated
from ._impl.graph.node_graph import NodeGraph
from ._impl.node_entities import NodeEntities
from ._impl.node_interface import NodeHandle
from ._impl.parameters.node_parameters import NodeParameters
from ._impl.reexports import names_of
from ._impl.remapping import Remapping
from ._impl.rosout import Rosout
from .callback_groups import CallbackGroup
from .clock import Clock, ROSClock
from .context import Context
from .exceptions import NotInitializedException
from .impl.rcutils_logger import RcutilsLogger
from .logging import get_logger
from .logging_service import LoggingService
from .parameter import Parameter
from .parameter_service import ParameterService
from .qos import QoSProfile, qos_profile_rosout_default
from .service import Service
from .time_source import TimeSource
from .type_description_service import TypeDescriptionService
from .utilities import get_default_context
from .validate_namespace import validate_namespace
from .validate_node_name import validate_node_name

if TYPE_CHECKING:
    from .executors import Executor


HIDDEN_NODE_PREFIX = "_"
"""How the names of nodes begin that are not listed unless somebody asks for all."""


class _Unset:
    """Stands for an attribute of a node until `Node.__init__` sets it."""

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._name = name

    def __get__(self, node: object | None, owner: type[object]) -> Any:
        if node is None:
            return self
        raise AttributeError(
            f"{type(node).__name__!r} object has no attribute {self._name!r};"
            " call super().__init__('a_name') before anything else of the node"
        )


class Node(NodeEntities, NodeGraph, NodeParameters):
    """A participant: has services, clients, publishers, subscriptions, timers and parameters.

    Its callbacks run while somebody spins it. It lives until `destroy_node`, or until its context
    is shut down.

    Arguments:
        node_name, namespace: by ROS's rules; remapped by `__node` and `__ns` of the command line.
        context: of `rclpy.init` unless given.
        cli_args: arguments of this node alone, before those of the program, which
            `use_global_arguments=False` leaves out.
        enable_rosout, rosout_qos_profile: whether and how its log goes to `/rosout`, too.
        start_parameter_services: whether others may get and set its parameters.
        parameter_overrides: values that come before those that are declared.
        allow_undeclared_parameters: whether parameters can be set that are not declared.
        automatically_declare_parameters_from_overrides: declare what overrides name.
        enable_logger_service: whether others may get and set its loggers' levels.
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
        NodeEntities.__init__(self)
        self._context = get_default_context() if context is None else context
        self._rclpy_executor = None
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        given = [parse(cli_args)] if cli_args is not None else []
        if use_global_arguments:
            given.append(self._context.arguments)
        handle = self._rclpy_handle = self._rclpy_join(node_name, namespace or "", given)
        self._clock = ROSClock()
        self._logger = get_logger(handle.full_name.strip("/").replace("/", "."))
        self._rclpy_rosout: Rosout | None = None
        if enable_rosout and self._context.arguments.rosout_logs is not False:
            self._rclpy_rosout = Rosout(handle, self._logger.name, rosout_qos_profile)
        self._context.track_node(self)
        # The program's line first: what is given to the node itself replaces it.
        self._init_parameters(given[::-1], parameter_overrides, allow_undeclared_parameters)
        if automatically_declare_parameters_from_overrides:
            self._declare_overrides()
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        self._type_description_service = TypeDescriptionService(self)
        if enable_logger_service:
            self._logging_service = LoggingService(self)
        watchdog.watch(self)

    def _rclpy_join(self, node_name: str, namespace: str, given: list[Arguments]) -> NodeHandle:
        """Join the network under the name and namespace that result from the arguments."""
        remapping = Remapping(rule for one in given for rule in one.remaps)
        validate_node_name(node_name)
        if namespace:
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
        name = remapping.node_name(node_name)
        namespace = remapping.namespace(namespace, name)
        bridge = Bridge(name, namespace, self._context.get_domain_id())
        return NodeHandle(self, name, bridge.namespace, remapping, bridge)

    # The first of these is what a program meets that does too much before `super().__init__`.
    _rclpy_handle: NodeHandle = _Unset()  # type: ignore[assignment]
    _rclpy_executor: Any = _Unset()
    _default_callback_group: CallbackGroup = _Unset()  # type: ignore[assignment]
    _parameters: dict[str, Parameter] = _Unset()  # type: ignore[assignment]
    _parameter_overrides: dict[str, Parameter] = _Unset()  # type: ignore[assignment]
    _logger: RcutilsLogger = _Unset()  # type: ignore[assignment]
    _clock: Clock = _Unset()  # type: ignore[assignment]

    # What it is

    @property
    def context(self) -> Context:
        """The context that it belongs to."""
        return self._context

    @property
    def handle(self) -> NodeHandle:
        """What ROS keeps of it."""
        return self._rclpy_handle

    @property
    def executor(self) -> Executor | None:
        """Who runs its callbacks; None before somebody spins it."""
        return None if self._rclpy_executor is None else self._rclpy_executor()

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        """Let another executor run its callbacks, or none."""
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
        """Its clock: the system's time, or a simulation's with `use_sim_time`."""
        return self._clock

    def get_logger(self) -> RcutilsLogger:
        """Its logger, of the name `namespace.name`."""
        return self._logger

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """The absolute name that a topic name means here, remapped unless `only_expand`."""
        return self._rclpy_resolve(topic, is_service=False, only_expand=only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """The absolute name that a service name means here, remapped unless `only_expand`."""
        return self._rclpy_resolve(service, is_service=True, only_expand=only_expand)

    def destroy_node(self) -> None:
        """Destroy all that it has, and leave the network; nothing happens the second time."""
        if not self._rclpy_handle.valid:
            return
        watchdog.ends(self)
        self._context.untrack_node(self)
        self._rclpy_destroy_entities()
        if self._rclpy_rosout is not None:
            self._rclpy_rosout.destroy()
        self._rclpy_handle.destroy_when_not_in_use()
        callback = current_callback()
        answering = None if callback is None else callback.entity
        if isinstance(answering, Service) and answering.parent_node is self:
            answering.when_answered(
                self._rclpy_handle.bridge.close
            )  # its own answer must still go out
        else:
            self._rclpy_handle.bridge.close()
        self._wake_executor()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.destroy_node()

    # Inside

    def _rclpy_resolve(self, name: str, *, is_service: bool, only_expand: bool = False) -> str:
        kind = kind_of(is_service)
        handle = self._rclpy_handle
        handle.check()
        if not isinstance(name, str):
            raise TypeError(f"expected a {kind} (str), got {name!r}")
        try:
            full = names.expand(name, namespace=handle.namespace, node=handle.name, kind=kind)
        except InvalidName as error:
            raise translated(error) from None
        if only_expand:
            return full
        remap = handle.remapping.service if is_service else handle.remapping.topic
        return remap(full, handle.namespace, handle.name)


for _mixin in Node.__mro__[1:-1]:
    for _method in vars(_mixin).values():
        if inspect.isfunction(_method):  # so that errors and tracebacks name a Node's methods
            _method.__qualname__ = f"Node.{_method.__name__}"


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
