"""Lifecycle nodes: their callbacks and steps, and the services by which others ask for these."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, cast

import srvgen

from .._impl.diagnostics import explain
from .._impl.execution.entity import node_name
from .._impl.lifecycle_states import (
    ACTIVATING,
    CLEANING_UP,
    CONFIGURING,
    DEACTIVATING,
    ERROR_PROCESSING,
    SHUTTING_DOWN,
    LifecycleState,
    LifecycleStateMachine,
    Transition,
)
from .._impl.lifecycle_states import TransitionCallbackReturnType as TransitionCallbackReturn
from .._impl.log import output
from ..callback_groups import CallbackGroup
from ..exceptions import RCLError
from ..node import Node
from .managed_entity import ManagedEntity
from .publisher import LifecyclePublisher

_PACKAGE = "lifecycle_msgs"
_CALLBACKS = {
    CONFIGURING: "on_configure",
    CLEANING_UP: "on_cleanup",
    SHUTTING_DOWN: "on_shutdown",
    ACTIVATING: "on_activate",
    DEACTIVATING: "on_deactivate",
    ERROR_PROCESSING: "on_error",
}
"""What is called in each state on the way; what it returns leads on."""
_EVENTS_DEPTH = 10


class LifecycleNodeMixin(ManagedEntity):
    """What a lifecycle node has beyond a node; its class derives from both.

    Arguments:
        enable_communication_interface: whether others may ask for steps, by five services.
        callback_group: of these services.
    """

    def __init__(
        self,
        *,
        enable_communication_interface: bool = True,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        if not isinstance(enable_communication_interface, bool):
            raise TypeError(
                "enable_communication_interface: expected True or False,"
                f" got {enable_communication_interface!r}"
            )
        self._managed_entities: set[ManagedEntity] = set()
        self._callbacks: dict[int, Callable[[LifecycleState], Any]] = {
            state.id: getattr(self, name) for state, name in _CALLBACKS.items()
        }
        self._rclpy_events: Any = None
        self._state_machine = LifecycleStateMachine(self._rclpy_changed, _log_refusal)
        if enable_communication_interface:
            self._rclpy_offer(callback_group)

    # What others and the program itself ask for

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Set up. Raises RCLError where that is not possible now, as all of these do."""
        return self._rclpy_step("configure")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Give back what was set up."""
        return self._rclpy_step("cleanup")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """End, from any state that is not on the way to another."""
        return self._rclpy_step("shutdown")

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Begin to work."""
        return self._rclpy_step("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Pause."""
        return self._rclpy_step("deactivate")

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Have something told of every step, too. Raises TypeError for what cannot be told."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities.add(entity)

    # Callbacks, for programs to override: what they manage is told by super()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set up; override it and call it by `super()` to have publishers told, as all of these."""
        return self._rclpy_told("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give back what was set up."""
        return self._rclpy_told("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End."""
        return self._rclpy_told("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        return self._rclpy_told("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause."""
        return self._rclpy_told("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Put right what made another callback end with an error."""
        return self._rclpy_told("on_error", state)

    # Publishers

    def create_lifecycle_publisher(self, *args: Any, **settings: Any) -> LifecyclePublisher:
        """A publisher that is silent while the node is not active; arguments as for any other."""
        if "publisher_class" in settings:
            raise TypeError(
                "create_publisher() got an unexpected keyword argument 'publisher_class'"
            )
        node = cast("Node", self)
        made = Node.create_publisher(node, *args, **settings, publisher_class=LifecyclePublisher)
        publisher = cast("LifecyclePublisher", made)
        self._managed_entities.add(publisher)
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Publish no more; whether it was this node's."""
        self._managed_entities.discard(publisher)
        return Node.destroy_publisher(cast("Node", self), publisher)

    # Inside

    def _rclpy_told(self, callback: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in self._managed_entities:
            returned = getattr(entity, callback)(state)
            if not isinstance(returned, TransitionCallbackReturn):
                raise TypeError(
                    f"{callback}() return value of class {type(entity)} should be"
                    " `TransitionCallbackReturn`.\n"
                    f"Instance of the class that caused the failure: {entity}"
                )
            if returned is not TransitionCallbackReturn.SUCCESS:
                return returned
        return TransitionCallbackReturn.SUCCESS

    def _rclpy_step(self, label: str) -> TransitionCallbackReturn:
        for step in self._state_machine.available_transitions:
            if step.label == label:
                return self._rclpy_change(step.id)
        if label not in _NUMBERS:
            raise RCLError(f"{label.capitalize()} transition not possible")
        return self._rclpy_change(_NUMBERS[label])  # which tells why not

    def _rclpy_change(self, transition_id: int) -> TransitionCallbackReturn:
        """Take a step with its callback, and the one that the callback's return leads to."""
        number, label = self._state_machine.current_state
        before = LifecycleState(label=label, state_id=number)
        self._state_machine.trigger_transition_by_id(transition_id, True)
        result = self._rclpy_call(before)
        if result is TransitionCallbackReturn.ERROR:
            self._rclpy_call(before)
        return result

    def _rclpy_call(self, before: LifecycleState) -> TransitionCallbackReturn:
        callback = self._callbacks[self._state_machine.current_state.id]
        name = getattr(callback, "__name__", repr(callback))
        result: Any
        try:
            result = callback(before)
        except Exception as error:
            explain.transition_callback_raised(node_name(self), name, error)
            result = TransitionCallbackReturn.ERROR
        if not isinstance(result, TransitionCallbackReturn):
            raise AttributeError(
                f"{name} returned {result!r}, expected a TransitionCallbackReturn,"
                " which has 'to_label'"
            )
        self._state_machine.trigger_transition_by_label(result.to_label(), True)
        return result

    def _rclpy_changed(self, transition: Transition) -> None:
        if self._rclpy_events is not None:
            event = _load("msg/TransitionEvent")(
                start_state=_state(transition.start), goal_state=_state(transition.goal)
            )
            self._rclpy_events.publish(event)

    # Services

    def _rclpy_offer(self, group: CallbackGroup | None) -> None:
        node = cast("Node", self)
        self._rclpy_events = node.create_publisher(
            _load("msg/TransitionEvent"), "~/transition_event", _EVENTS_DEPTH
        )

        def offer(srv_type: str, name: str, callback: Callable[..., Any]) -> Any:
            return node.create_service(
                _load(f"srv/{srv_type}"), f"~/{name}", callback, callback_group=group
            )

        transitions = "GetAvailableTransitions"
        self._service_change_state = offer("ChangeState", "change_state", self._rclpy_on_change)
        self._service_get_state = offer("GetState", "get_state", self._rclpy_on_get_state)
        self._service_get_available_states = offer(
            "GetAvailableStates", "get_available_states", self._rclpy_on_get_available_states
        )
        self._service_get_available_transitions = offer(
            transitions, "get_available_transitions", self._rclpy_on_get_available_transitions
        )
        self._service_get_transition_graph = offer(
            transitions, "get_transition_graph", self._rclpy_on_get_transition_graph
        )

    def _rclpy_on_change(self, request: Any, response: Any) -> Any:
        number = request.transition.id
        if request.transition.label:
            try:
                number = self._state_machine.get_transition_by_label(request.transition.label)
            except RCLError:
                response.success = False
                return response
        try:
            response.success = self._rclpy_change(number) is TransitionCallbackReturn.SUCCESS
        except RCLError as error:  # what others ask for must not end this node
            if explain.like_ros():
                raise
            explain.impossible_transition(node_name(self), number, error)
        return response

    def _rclpy_on_get_state(self, request: Any, response: Any) -> Any:
        response.current_state = _state(self._state_machine.current_state)
        return response

    def _rclpy_on_get_available_states(self, request: Any, response: Any) -> Any:
        response.available_states = [_state(one) for one in self._state_machine.available_states]
        return response

    def _rclpy_on_get_available_transitions(self, request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._state_machine.available_transitions)
        return response

    def _rclpy_on_get_transition_graph(self, request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._state_machine.transition_graph)
        return response


class LifecycleNode(LifecycleNodeMixin, Node):
    """A node that waits for somebody to configure and activate it.

    Takes the arguments of `Node`, and whether others may ask for its steps.
    """

    def __init__(
        self, node_name: str, *, enable_communication_interface: bool = True, **settings: Any
    ) -> None:
        Node.__init__(self, node_name, **settings)
        LifecycleNodeMixin.__init__(
            self, enable_communication_interface=enable_communication_interface
        )


def _load(name: str) -> Any:
    return srvgen.load(f"{_PACKAGE}/{name}")


def _state(state: tuple[int, str]) -> Any:
    number, label = state
    return _load("msg/State")(id=number, label=label)


def _described(transitions: Iterable[Transition]) -> list[Any]:
    described, step = _load("msg/TransitionDescription"), _load("msg/Transition")
    return [
        described(
            transition=step(id=one.id, label=one.label),
            start_state=_state(one.start),
            goal_state=_state(one.goal),
        )
        for one in transitions
    ]


_NUMBERS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}
"""Of the steps that lead from one state only."""


def _log_refusal(sentence: str) -> None:
    output.warn("rcl_lifecycle", sentence)
