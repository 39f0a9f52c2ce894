"""Callbacks for changes of parameters, of this node and other nodes."""

from __future__ import annotations

import itertools
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from taskrpc.spi import names

from ._impl.parameters.node_parameters import PARAMETER_EVENTS, ParameterEvent
from .callback_groups import CallbackGroup
from .qos import QoSProfile, qos_profile_parameter_events

if TYPE_CHECKING:
    from .node import Node


class ParameterCallbackHandle:
    """The registration of a callback for one parameter of one node; needed to remove it."""

    def __init__(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
    ) -> None:
        self.parameter_name = parameter_name
        self.node_name = node_name
        self.callback = callback
        self.mutex = threading.Lock()


class ParameterEventCallbackHandle:
    """The registration of a callback for all changes; needed to remove it."""

    def __init__(self, callback: Callable[[Any], object]) -> None:
        self.callback = callback
        self.mutex = threading.Lock()


class ParameterEventHandler:
    """Runs callbacks when parameters change, while a thread spins the node.

    Args:
        node: subscribes to `/parameter_events`; the next arguments are for this subscription.
        qos_profile: the profile.
        callback_group: the callback group.
        event_callbacks: callbacks for events such as incompatible publishers.
        qos_overriding_options: the policies that parameters can set.
        raw: whether the callbacks receive the events as bytes.
    """

    class Callbacks:
        """The callbacks; the callback that was added last runs first."""

        def __init__(self) -> None:
            self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = (
                defaultdict(list)
            )
            self.event_callbacks: list[ParameterEventCallbackHandle] = []
            self.mutex = threading.Lock()

        def event_callback(self, event: Any) -> None:
            """Run the callbacks for the parameters in an event, then those for all events."""
            with self.mutex:
                by_parameter = [(key, list(all_)) for key, all_ in self.parameter_callbacks.items()]
                by_event = list(self.event_callbacks)
            for (parameter_name, node_name), handles in by_parameter:
                parameter = ParameterEventHandler.get_parameter_from_event(
                    event, parameter_name, node_name
                )
                for handle in handles if parameter is not None else ():
                    with handle.mutex:
                        handle.callback(parameter)
            for registered in by_event:
                with registered.mutex:
                    registered.callback(event)

        def add_parameter_callback(
            self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
        ) -> ParameterCallbackHandle:
            """Add a callback for a parameter of a node, given the full name of the node."""
            handle = ParameterCallbackHandle(parameter_name, node_name, callback)
            with self.mutex:
                self.parameter_callbacks[parameter_name, node_name].insert(0, handle)
            return handle

        def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
            """Remove a callback. Raises RuntimeError for one that was not added."""
            key = (handle.parameter_name, handle.node_name)
            with self.mutex:
                if handle not in self.parameter_callbacks.get(key, ()):
                    raise RuntimeError("Callback doesn't exist")
                self.parameter_callbacks[key].remove(handle)
                if not self.parameter_callbacks[key]:
                    del self.parameter_callbacks[key]

        def add_parameter_event_callback(
            self, callback: Callable[[Any], object]
        ) -> ParameterEventCallbackHandle:
            """Add a callback for every event."""
            handle = ParameterEventCallbackHandle(callback)
            with self.mutex:
                self.event_callbacks.insert(0, handle)
            return handle

        def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
            """Remove a callback. Raises RuntimeError for one that was not added."""
            with self.mutex:
                if handle not in self.event_callbacks:
                    raise RuntimeError("Callback doesn't exist")
                self.event_callbacks.remove(handle)

    def __init__(
        self,
        node: Node,
        qos_profile: QoSProfile | int = qos_profile_parameter_events,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
    ) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = ParameterEventHandler.Callbacks()
        self._node_filter: frozenset[str] = frozenset()
        """The only nodes whose events are used; empty for all nodes."""
        self.parameter_event_subscription = node.create_subscription(
            ParameterEvent,
            PARAMETER_EVENTS,
            self._on_event,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def destroy(self) -> None:
        """Stop receiving events."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """The message of a parameter that an event says is new or changed; None otherwise."""
        if event.node != node_name:
            return None
        for parameter in ParameterEventHandler.get_parameters_from_event(event):
            if parameter.name == parameter_name:
                return parameter
        return None

    @staticmethod
    def get_parameters_from_event(event: Any) -> Iterable[Any]:
        """The messages of all parameters that an event says are new or changed."""
        return itertools.chain(event.new_parameters, event.changed_parameters)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
    ) -> ParameterCallbackHandle:
        """Call `callback(parameter message)` when a parameter of a node is set.

        A node name without a leading slash is in this node's namespace; "" means this node.
        """
        return self._callbacks.add_parameter_callback(
            parameter_name, self._resolve_path(node_name), callback
        )

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError for one that was not added."""
        self._callbacks.remove_parameter_callback(handle)

    def add_parameter_event_callback(
        self, callback: Callable[[Any], object]
    ) -> ParameterEventCallbackHandle:
        """Call `callback(event message)` for every event."""
        return self._callbacks.add_parameter_event_callback(callback)

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError for one that was not added."""
        self._callbacks.remove_parameter_event_callback(handle)

    def configure_nodes_filter(self, node_names: list[str] | None = None) -> bool:
        """Use only the events of these nodes, given their full names; without names, of all nodes.

        Always returns True, as ROS does if the middleware supports filters.
        """
        self._node_filter = frozenset(node_names or ())
        return True

    def _on_event(self, event: Any) -> None:
        if not self._node_filter or event.node in self._node_filter:
            self._callbacks.event_callback(event)

    def _resolve_path(self, node_path: str | None = None) -> str:
        """The full name of a node."""
        if not node_path:
            return self.node.get_fully_qualified_name()
        if node_path.startswith("/"):
            return node_path
        return names.fully_qualified(self.node.get_namespace(), node_path)
