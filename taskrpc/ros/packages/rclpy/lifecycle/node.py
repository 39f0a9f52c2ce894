"""Lifecycle nodes: their transitions and callbacks, and the services that request transitions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypedDict, cast

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

if TYPE_CHECKING:
    from srvgen.stubs.lifecycle_msgs import srv

_PACKAGE = "lifecycle_msgs"
_CALLBACKS = {
    CONFIGURING: "on_configure",
    CLEANING_UP: "on_cleanup",
    SHUTTING_DOWN: "on_shutdown",
    ACTIVATING: "on_activate",
    DEACTIVATING: "on_deactivate",
    ERROR_PROCESSING: "on_error",
}
"""The callback in each transition state; its result selects the next transition."""
_EVENTS_DEPTH = 10


class CreateLifecyclePublisherArgs(TypedDict, total=False):
    """The options of `create_lifecycle_publisher`, for annotations."""

    callback_group: CallbackGroup | None
    event_callbacks: Any
    qos_overriding_options: Any


class LifecycleNodeArgs(TypedDict, total=False):
    """The options of `LifecycleNode` that `Node` takes too, for annotations."""

    context: Any
    cli_args: list[str] | None
    namespace: str | None
    use_global_arguments: bool
    enable_rosout: bool
    start_parameter_services: bool
    parameter_overrides: list[Any] | None
    allow_undeclared_parameters: bool
    automatically_declare_parameters_from_overrides: bool
    enable_logger_service: bool


class LifecycleNodeMixin(ManagedEntity):
    """The methods that a lifecycle node adds to `Node`; its class derives from both.

    Arguments:
        enable_communication_interface: whether to offer five services, with which other programs
            read the state and request transitions.
        callback_group: the callback group of these services.
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
        self._managed_entities: dict[ManagedEntity, None] = {}
        self._callbacks: dict[int, Callable[[LifecycleState], Any]] = {
            state.id: getattr(self, name) for state, name in _CALLBACKS.items()
        }
        self._rclpy_events: Any = None
        self._state_machine = LifecycleStateMachine(self._rclpy_changed, _log_refusal)
        if enable_communication_interface:
            self._rclpy_offer(callback_group)

    # Transitions that the program triggers

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure the node. All `trigger_` methods raise RCLError if not possible now."""
        return self._rclpy_trigger("configure")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Release what was configured."""
        return self._rclpy_trigger("cleanup")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut the node down, from any state except a transition state."""
        return self._rclpy_trigger("shutdown")

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate the node."""
        return self._rclpy_trigger("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate the node."""
        return self._rclpy_trigger("deactivate")

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Run the callbacks of this entity in every transition; TypeError for another object."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities[entity] = None

    # Callbacks that programs override

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure. As in all callbacks, `super()` runs the callbacks of managed entities."""
        return self._rclpy_call_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release what was configured."""
        return self._rclpy_call_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down."""
        return self._rclpy_call_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate."""
        return self._rclpy_call_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        return self._rclpy_call_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Handle the error of another callback; SUCCESS means that the error is handled."""
        return self._rclpy_call_entities("on_error", state)

    # Publishers

    def create_lifecycle_publisher(self, *args: Any, **settings: Any) -> LifecyclePublisher:
        """Create a publisher that works only while the node is active; see `create_publisher`."""
        if "publisher_class" in settings:
            raise TypeError(
                "create_publisher() got an unexpected keyword argument 'publisher_class'"
            )
        node = cast("Node", self)
        made = Node.create_publisher(node, *args, **settings, publisher_class=LifecyclePublisher)
        publisher = cast("LifecyclePublisher", made)
        self._managed_entities[publisher] = None
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a publisher; returns whether it belonged to this node."""
        self._managed_entities.pop(publisher, None)
        return Node.destroy_publisher(cast("Node", self), publisher)

    # Internal

    def _rclpy_call_entities(
        self, callback: str, state: LifecycleState
    ) -> TransitionCallbackReturn:
        """Run a callback of all managed entities, until one of them does not succeed."""
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

    def _rclpy_trigger(self, label: str) -> TransitionCallbackReturn:
        for transition in self._state_machine.available_transitions:
            if transition.label == label:
                return self._rclpy_change(transition.id)
        if label not in _NUMBERS:
            raise RCLError(f"{label.capitalize()} transition not possible")
        return self._rclpy_change(_NUMBERS[label])  # raises RCLError

    def _rclpy_change(self, transition_id: int) -> TransitionCallbackReturn:
        """Make a transition, run its callback, and make the transition that the result selects."""
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

    def _rclpy_on_change(
        self, request: srv.ChangeState.Request, response: srv.ChangeState.Response
    ) -> srv.ChangeState.Response:
        number = request.transition.id
        if request.transition.label:
            try:
                number = self._state_machine.get_transition_by_label(request.transition.label)
            except RCLError:
                response.success = False
                return response
        try:
            response.success = self._rclpy_change(number) is TransitionCallbackReturn.SUCCESS
        except RCLError as error:  # an invalid request must not end the spin of this node
            if explain.like_ros():
                raise
            explain.impossible_transition(node_name(self), number, error)
        return response

    def _rclpy_on_get_state(
        self, request: srv.GetState.Request, response: srv.GetState.Response
    ) -> srv.GetState.Response:
        response.current_state = _state(self._state_machine.current_state)
        return response

    def _rclpy_on_get_available_states(
        self, request: srv.GetAvailableStates.Request, response: srv.GetAvailableStates.Response
    ) -> srv.GetAvailableStates.Response:
        response.available_states = [_state(one) for one in self._state_machine.available_states]
        return response

    def _rclpy_on_get_available_transitions(
        self,
        request: srv.GetAvailableTransitions.Request,
        response: srv.GetAvailableTransitions.Response,
    ) -> srv.GetAvailableTransitions.Response:
        response.available_transitions = _described(self._state_machine.available_transitions)
        return response

    def _rclpy_on_get_transition_graph(
        self,
        request: srv.GetAvailableTransitions.Request,
        response: srv.GetAvailableTransitions.Response,
    ) -> srv.GetAvailableTransitions.Response:
        response.available_transitions = _described(self._state_machine.transition_graph)
        return response


class LifecycleNode(LifecycleNodeMixin, Node):
    """A node that does not work until it is configured and activated.

    Takes the arguments of `Node` and of `LifecycleNodeMixin`.
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
    described, transition = _load("msg/TransitionDescription"), _load("msg/Transition")
    return [
        described(
            transition=transition(id=one.id, label=one.label),
            start_state=_state(one.start),
            goal_state=_state(one.goal),
        )
        for one in transitions
    ]


_NUMBERS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}
"""The numbers of the transitions that begin in one state only."""


def _log_refusal(sentence: str) -> None:
    output.warn("rcl_lifecycle", sentence)
