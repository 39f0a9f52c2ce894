"""What the parts of a node see of it: its state, `NodeHandle`, and its methods, `NodeInterface`.

Clients, services, publishers and the other parts are created by a node and need it in turn. They
import this module instead of `rclpy.node`, which imports them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.spi import names

from ..context import Context
from ..handle import Handle
from ..parameter import Parameter
from .arguments import Remapping
from .graph.names import checked, kind_of

if TYPE_CHECKING:
    from .bridge import Bridge


class NodeHandle(Handle):
    """`Node.handle`: the names and the state of a node that its parts and the diagnostics use."""

    def __init__(
        self, owner: Any, name: str, namespace: str, remapping: Remapping, bridge: Bridge
    ) -> None:
        super().__init__(owner)
        self.name = name
        self.namespace = namespace
        self.full_name = names.fully_qualified(namespace, name)
        self.remapping = remapping
        """The rules of the command line that apply to the names of this node."""
        self.bridge = bridge
        """The native node on the background event loop."""
        self.was_spun = False
        """Whether the node was ever added to an executor."""
        self.taken_by = ""
        """The callback that removed the node from the executor that ran it; empty without one."""
        self.no_waitables = ""
        """The reason why the node has no waitables, such as actions; empty if it can have them."""

    def check_waitables(self) -> None:
        """Raise TypeError if the node cannot have waitables, such as action servers."""
        if self.no_waitables:
            raise TypeError(self.no_waitables)

    def resolve(self, name: str, *, is_service: bool, only_expand: bool) -> str:
        """The absolute name of a topic or service, after remapping unless `only_expand`.

        Raises InvalidHandle, TypeError, InvalidTopicNameException, InvalidServiceNameException.
        """
        self.check()
        kind = kind_of(is_service)
        expand = partial(names.expand, namespace=self.namespace, node=self.name, kind=kind)
        full = checked(kind, name, expand)
        if only_expand:
            return full
        remap = self.remapping.service if is_service else self.remapping.topic
        return remap(full, self.namespace, self.name)


class NodeInterface(Protocol):
    """The methods of `rclpy.node.Node` that its parts use."""

    executor: Any
    """The executor that runs its callbacks; None while it is in no executor."""

    @property
    def handle(self) -> NodeHandle:
        """Its names and its state."""

    @property
    def context(self) -> Context:
        """The context that it belongs to."""

    @property
    def default_callback_group(self) -> Any:
        """The callback group of entities that were created without one."""

    @property
    def clients(self) -> Iterator[Any]:
        """Its clients."""

    @property
    def services(self) -> Iterator[Any]:
        """Its services."""

    def get_name(self) -> str:
        """Its name, without the namespace."""

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""

    def get_logger(self) -> Any:
        """Its logger."""

    def get_clock(self) -> Any:
        """Its clock."""

    def resolve_topic_name(self, topic: str) -> str:
        """The absolute name of a topic, after remapping."""

    def resolve_service_name(self, service: str) -> str:
        """The absolute name of a service, after remapping."""

    @property
    def create_timer(self) -> Callable[..., Any]:
        """Creates a timer."""

    @property
    def destroy_timer(self) -> Callable[..., bool]:
        """Destroys a timer."""

    @property
    def destroy_rate(self) -> Callable[..., bool]:
        """Destroys a rate."""

    @property
    def create_publisher(self) -> Callable[..., Any]:
        """Creates a publisher."""

    @property
    def create_subscription(self) -> Callable[..., Any]:
        """Creates a subscription."""

    @property
    def create_service(self) -> Callable[..., Any]:
        """Creates a service."""

    @property
    def destroy_publisher(self) -> Callable[..., bool]:
        """Destroys a publisher."""

    @property
    def destroy_subscription(self) -> Callable[..., bool]:
        """Destroys a subscription."""

    @property
    def add_waitable(self) -> Callable[[Any], None]:
        """Adds a waitable."""

    @property
    def remove_waitable(self) -> Callable[[Any], None]:
        """Removes a waitable."""

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is declared."""

    @property
    def declare_parameter(self) -> Callable[..., Any]:
        """Declares a parameter."""

    @property
    def declare_parameters(self) -> Callable[..., list[Parameter]]:
        """Declares several parameters."""

    def get_parameter_type(self, name: str) -> Any:
        """The number of the type of a parameter."""

    def get_parameter_or(self, name: str) -> Parameter:
        """A parameter, or an unset one."""

    def describe_parameter(self, name: str) -> Any:
        """The descriptor of a parameter."""

    def get_parameter(self, name: str) -> Parameter:
        """A parameter."""

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Several parameters."""

    def get_parameter_types(self, names: Sequence[str]) -> list[Any]:
        """The types of parameters."""

    def describe_parameters(self, names: Sequence[str]) -> list[Any]:
        """The descriptors of parameters."""

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """The names of parameters."""

    def set_parameters_atomically(self, parameter_list: Sequence[Any]) -> Any:
        """Set all parameters or none."""

    @property
    def add_on_set_parameters_callback(self) -> Callable[..., None]:
        """Adds a callback that accepts or rejects values."""
