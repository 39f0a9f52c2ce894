"""Callbacks for changes of parameters, of this node or any other."""

from __future__ import annotations

import itertools
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from taskrpc import names

from ._impl.parameters.node_parameters import PARAMETER_EVENTS, ParameterEvent
from .callback_groups import CallbackGroup
from .qos import QoSProfile, qos_profile_parameter_events

if TYPE_CHECKING:
    from .node import Node


class ParameterCallbackHandle:
    """A callback for one parameter of one node: keep it to remove the callback."""

    def __init__(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
    ) -> None:
        self.parameter_name = parameter_name
        self.node_name = node_name
        self.callback = callback
        self.mutex = threading.Lock()


class ParameterEventCallbackHandle:
    """A callback for all changes: keep it to remove the callback."""

    def __init__(self, callback: Callable[[Any], object]) -> None:
        self.callback = callback
        self.mutex = threading.Lock()


class ParameterEventHandler:
    """Calls back when parameters change, while somebody spins the node.

    Args:
        node: reads `/parameter_events`.
        qos_profile: of that subscription.
        callback_group: of that subscription.
        event_callbacks: of that subscription.
        qos_overriding_options: of that subscription.
        raw: whether events are handed on as bytes.
    """

    class Callbacks:
        """What is called when; the one that was added last comes first."""

        def __init__(self) -> None:
            self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = (
                defaultdict(list)
            )
            self.event_callbacks: list[ParameterEventCallbackHandle] = []
            self.mutex = threading.Lock()

        def event_callback(self, event: Any) -> None:
            """Call whoever is concerned by an event."""
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
            for told in by_event:
                with told.mutex:
                    told.callback(event)

        def add_parameter_callback(
            self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
        ) -> ParameterCallbackHandle:
            """Call back when this node's parameter changes; the node by its full name."""
            handle = ParameterCallbackHandle(parameter_name, node_name, callback)
            with self.mutex:
                self.parameter_callbacks[parameter_name, node_name].insert(0, handle)
            return handle

        def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
            """Call it no more. Raises RuntimeError for one that is not there."""
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
            """Call back for every event."""
            handle = ParameterEventCallbackHandle(callback)
            with self.mutex:
                self.event_callbacks.insert(0, handle)
            return handle

        def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
            """Call it no more. Raises RuntimeError for one that is not there."""
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
        self._wanted: frozenset[str] = frozenset()
        self.parameter_event_subscription = node.create_subscription(
            ParameterEvent,
            PARAMETER_EVENTS,
            self._came,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def destroy(self) -> None:
        """Call nobody any more."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """The message of a node's parameter, if an event says that it is new or changed."""
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
        """Have `callback(parameter message)` called when a node's parameter is set.

        A name without a slash in front is in this node's namespace; an empty one is this node.
        """
        return self._callbacks.add_parameter_callback(
            parameter_name, self._resolve_path(node_name), callback
        )

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Call it no more. Raises RuntimeError for one that is not there."""
        self._callbacks.remove_parameter_callback(handle)

    def add_parameter_event_callback(
        self, callback: Callable[[Any], object]
    ) -> ParameterEventCallbackHandle:
        """Have `callback(event message)` called for every event."""
        return self._callbacks.add_parameter_event_callback(callback)

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Call it no more. Raises RuntimeError for one that is not there."""
        self._callbacks.remove_parameter_event_callback(handle)

    def configure_nodes_filter(self, node_names: list[str] | None = None) -> bool:
        """Heed the events of these nodes only, by their full names; without names, of all again.

        Always True, as ROS says where its middleware can do so.
        """
        self._wanted = frozenset(node_names or ())
        return True

    def _came(self, event: Any) -> None:
        if not self._wanted or event.node in self._wanted:
            self._callbacks.event_callback(event)

    def _resolve_path(self, node_path: str | None = None) -> str:
        """The full name of a node."""
        if not node_path:
            return self.node.get_fully_qualified_name()
        if node_path.startswith("/"):
            return node_path
        return names.fully_qualified(self.node.get_namespace(), node_path)
