"""The handles of goals that an action server has accepted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Generic, Protocol

from taskrpc import GoalState
from taskrpc.message_types import FeedbackT, GoalT, ResultT
from taskrpc.spi import GoalEvent, GoalRecord, InvalidTransition, bytes_of, nanoseconds_of

from .._impl.actions.server_parts import ServerParts
from ..exceptions import RCLError


class Server(Protocol):
    """What a handle needs of its action server."""

    _parts: ServerParts

    @property
    def action_type(self) -> Any:
        """The type of the action."""

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Let the executor of the node run the execute callback for a goal."""

    def _accept(self, key: bytes, goal: Any, stamp: int) -> GoalRecord: ...
    def _change(self, record: GoalRecord, event: GoalEvent) -> None: ...
    def _set_result(self, goal_handle: Any, result: Any) -> None: ...


class ServerGoalHandle(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that an action server has accepted; its callbacks receive it.

    The methods may be called from any thread. After `destroy`, they do nothing.
    """

    def __init__(
        self,
        action_server: Server,
        goal_info: Any,
        goal_request: GoalT,
    ) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        key, stamp = bytes_of(goal_info.goal_id), nanoseconds_of(goal_info.stamp)
        self._record: GoalRecord | None = action_server._accept(key, goal_request, stamp)
        """The goal in the ledger of the server; None after `destroy`."""
        self._lock = threading.Lock()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ServerGoalHandle) and self.goal_id == other.goal_id

    __hash__ = None  # type: ignore[assignment]  # as in ROS

    @property
    def request(self) -> GoalT:
        """The goal message that the client sent."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """The id of the goal, a `unique_identifier_msgs.msg.UUID`."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """Whether the goal has not ended."""
        return self._state.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether a client has cancelled the goal, and the server has accepted this."""
        return self._state is GoalState.CANCELING

    @property
    def status(self) -> int:
        """The state of the goal, a constant of `action_msgs.msg.GoalStatus`."""
        return int(self._state)

    @property
    def _state(self) -> GoalState:
        record = self._record
        return GoalState.UNKNOWN if record is None else record.state

    def executing(self) -> None:
        """Mark the goal as being executed, unless a client has cancelled it already."""
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)

    def execute(
        self, execute_callback: Callable[[ServerGoalHandle[Any, Any, Any]], Any] | None = None
    ) -> None:
        """Run the execute callback for this goal, on the thread or threads that spin the node.

        `execute_callback` replaces the callback of the server for this goal.
        """
        self.executing()
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: FeedbackT) -> None:
        """Send a feedback message to the client; raises TypeError for a message of another type."""
        expected = self._action_server.action_type.Feedback
        if not isinstance(feedback, expected):
            raise TypeError(f"expected a {expected.__name__}, got {describe(feedback)}")
        if self._record is not None:
            self._action_server._parts.publish_feedback(self.goal_id, feedback)

    def succeed(self, response: ResultT | None = None) -> None:
        """End the goal: the server completed it. `response` is the result if no callback runs.

        Raises RCLError in a state that does not allow this.
        """
        self._update_state(GoalEvent.SUCCEED, response)

    def abort(self, response: ResultT | None = None) -> None:
        """End the goal without completing it. `response` is the result if no callback runs.

        Raises RCLError in a state that does not allow this.
        """
        self._update_state(GoalEvent.ABORT, response)

    def canceled(self, response: ResultT | None = None) -> None:
        """End the goal after its cancellation. `response` is the result if no callback runs.

        Raises RCLError if no cancellation was accepted.
        """
        self._update_state(GoalEvent.CANCELED, response)

    def destroy(self) -> None:
        """Forget the goal: its status becomes unknown."""
        with self._lock:
            self._record = None

    def _update_state(self, event: GoalEvent, response: ResultT | None = None) -> None:
        with self._lock:
            if self._record is None:
                return
            try:
                self._action_server._change(self._record, event)
            except InvalidTransition as error:
                raise RCLError(
                    "Failed to update goal state: goal_handle attempted invalid transition from"
                    f" state {error.state} with event {error.event}"
                ) from None
        if response is not None:
            self._action_server._set_result(self, response)


def describe(value: Any) -> str:
    """Describe a value that is no message of the expected type, for an error."""
    if isinstance(value, type):
        return f"the class {value.__name__} (write `{value.__name__}()`)"
    return "nothing" if value is None else f"a value of the type {type(value).__name__}"
