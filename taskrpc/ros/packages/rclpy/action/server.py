"""Action servers: accept goals, run a callback for each, and send feedback and results."""

from __future__ import annotations

import math
import threading
import time
import traceback
from collections.abc import Awaitable, Callable
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from srvgen import excepthook
from taskrpc.errors import Code, HandlerFailed
from taskrpc.message_types import Action, FeedbackT, GoalT, ResultT
from taskrpc.spi import (
    ActionMessages,
    GoalEvent,
    GoalLedger,
    GoalRecord,
    bytes_of,
    goals_to_cancel,
    nanoseconds_of,
)

from .._impl.actions.goal_ids import shown
from .._impl.actions.result_clock import ResultClock
from .._impl.actions.result_futures import ResultFutures
from .._impl.actions.server_parts import Profiles, ServerParts, Taken, check_context
from .._impl.diagnostics import explain
from .._impl.node_interface import NodeInterface
from .._impl.reexports import names_of
from ..callback_groups import CallbackGroup
from ..exceptions import RCLError
from ..executors import await_or_execute
from ..handle import Handle
from ..qos import (
    QoSProfile,
    qos_profile_action_status_default,
    qos_profile_default,
    qos_profile_services_default,
)
from ..service import RequestHeader
from ..service_introspection import ServiceIntrospectionState
from ..type_support import check_is_valid_action_type
from ..waitable import NumberOfEntities, Waitable
from .server_goal_handle import (
    ServerGoalHandle as ServerGoalHandle,  # noqa: PLC0414 - programs import it here, as in ROS
)
from .server_goal_handle import describe

if TYPE_CHECKING:
    from ..clock import Clock

_NANOSECOND = 1e-9
_NEVER = float("inf")
_ENDS = frozenset({GoalEvent.SUCCEED, GoalEvent.ABORT, GoalEvent.CANCELED})
"""The events that end a goal."""
_MANY_GOALS, _STATUS_EVERY = 30, 0.1
"""With more goals than this, the status is published at most once in so many seconds: the message
lists all goals."""


class GoalResponse(Enum):
    """Whether a server accepts a goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """Whether a server accepts a cancellation."""

    REJECT = 1
    ACCEPT = 2


def default_handle_accepted_callback(goal_handle: ServerGoalHandle[Any, Any, Any]) -> None:
    """Execute the goal."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Reject every cancellation."""
    return CancelResponse.REJECT


class ActionServer(Waitable[Any], Generic[GoalT, ResultT, FeedbackT]):
    """Executes the goals of one action; its callbacks run while a thread spins the node.

    Arguments:
        execute_callback: `execute_callback(goal_handle)` returns the result, plain or async.
        goal_callback: gets the goal message and decides whether to accept; by default, always.
        handle_accepted_callback: receives each accepted goal; by default, it executes the goal.
        cancel_callback: gets the goal handle and decides whether to cancel; by default, never.
        result_timeout: seconds for which the server keeps a result, in simulated time if the node
            has it.
    """

    is_timer: ClassVar[bool] = True

    def __init__(
        self,
        node: NodeInterface,
        action_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        execute_callback: Callable[
            [ServerGoalHandle[GoalT, ResultT, FeedbackT]], ResultT | Awaitable[ResultT]
        ]
        | None = None,
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: Callable[[Any], Any] | None = default_goal_callback,
        handle_accepted_callback: Callable[[Any], Any] | None = default_handle_accepted_callback,
        cancel_callback: Callable[[Any], Any] | None = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile = qos_profile_default,
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 10,
    ) -> None:
        node.handle.check_waitables()
        group = node.default_callback_group if callback_group is None else callback_group
        super().__init__(group)
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self._execute_callback: Callable[[Any], Any] | None = None
        if execute_callback is not None or handle_accepted_callback in _EXECUTING:
            self.register_execute_callback(execute_callback)
        check_is_valid_action_type(action_type)
        self._node = self.parent_node = node
        self._action_type: Any = action_type
        self._action_name = node.resolve_topic_name(action_name)  # raises for an invalid name
        check_context(node.context, "server")
        self._logger = node.get_logger().get_child("action_server")
        self._handle = Handle(self)
        self._lock = threading.RLock()
        """Guards the ledger."""
        self._ledger = GoalLedger(result_timeout)
        self._result_clock = ResultClock(node.get_clock(), self._time_advanced)
        self._goal_handles: dict[bytes, ServerGoalHandle[GoalT, ResultT, FeedbackT]] = {}
        self._results = ResultFutures(self._send_result)
        self._status_at, self._status_due = -_NEVER, _NEVER
        """When the status was published, and when a status that was put off is due."""
        self._messages = messages = ActionMessages(action_type)
        profiles = Profiles(
            goal_service_qos_profile,
            result_service_qos_profile,
            cancel_service_qos_profile,
            feedback_pub_qos_profile,
            status_pub_qos_profile,
        )
        self._parts = ServerParts(node, messages, self._action_name, group, profiles)
        self.services = self._parts.services
        """The services that it consists of, for the diagnostics."""
        node.add_waitable(self)

    @property
    def action_type(self) -> Any:
        """The type of the action."""
        return self._action_type

    # Callbacks

    def register_handle_accepted_callback(self, callback: Callable[[Any], Any] | None) -> None:
        """Set the callback for the handle of each accepted goal; None: execute the goal at once."""
        explain.callback_parameters(callback, "handle_accepted_callback", "a goal handle")
        self._handle_accepted_callback = callback or default_handle_accepted_callback

    def register_goal_callback(self, callback: Callable[[Any], Any] | None) -> None:
        """Set the callback that decides whether to accept a goal; None: accept all goals."""
        explain.callback_parameters(callback, "goal_callback", "a goal")
        self._goal_callback = callback or default_goal_callback

    def register_cancel_callback(self, callback: Callable[[Any], Any] | None) -> None:
        """Set the callback that decides whether to cancel a goal; None: cancel no goal."""
        explain.callback_parameters(callback, "cancel_callback", "a goal handle")
        self._cancel_callback = callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: Callable[[Any], Any] | None) -> None:
        """Set the callback that executes a goal; raises TypeError if it is not callable."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        explain.callback_parameters(execute_callback, "execute_callback", "a goal handle")
        self._execute_callback = execute_callback

    def notify_execute(
        self,
        goal_handle: ServerGoalHandle[GoalT, ResultT, FeedbackT],
        execute_callback: Callable[[Any], Any] | None,
    ) -> None:
        """Let the executor of the node run the execute callback for a goal."""
        callback = self._execute_callback if execute_callback is None else execute_callback
        executor = self._node.executor
        if callback is not None and executor is not None:
            executor.create_task(self._execute_goal, callback, goal_handle)

    def notify_goal_done(self) -> None:
        """Wake the executor: a goal has ended, so its result will expire."""
        self.notify_executor()

    # Requests

    async def _handle_request(self, taken: Taken) -> None:
        """Handle a request; if a callback raises, send the caller an error, and raise."""
        service, header, request = taken
        try:
            if service is self._parts.goals:
                await self._goal_requested(header, request)
            elif service is self._parts.cancels:
                await self._cancel_requested(header, request)
            else:
                self._result_requested(header, request)
        except BaseException as error:
            service.raised(header.call, error)
            raise

    async def _goal_requested(self, header: RequestHeader, request: Any) -> None:
        key = bytes_of(request.goal_id)
        self._logger.debug(f"New goal request with ID: {shown(key)}")
        handle = None
        if self._ledger.find(key) is None:
            answer = await await_or_execute(self._goal_callback, request.goal)
            if not isinstance(answer, GoalResponse):
                self._logger.warning(
                    "Goal request callback did not return a GoalResponse type. Rejecting goal."
                )
            elif answer is GoalResponse.ACCEPT:
                handle = self._new_goal(key, request.goal)
        response = self._messages.send_goal.Response(accepted=handle is not None)
        if handle is not None:
            response.stamp = handle._goal_info.stamp
        self._parts.goals.send_response(response, header)
        if handle is None:
            self._logger.debug(f"New goal rejected: {shown(key)}")
            return
        self._logger.debug(f"New goal accepted: {shown(key)}")
        self._publish_status()
        await await_or_execute(self._handle_accepted_callback, handle)

    def _new_goal(
        self, key: bytes, goal: GoalT
    ) -> ServerGoalHandle[GoalT, ResultT, FeedbackT] | None:
        info = self._messages.goal_info(key, self._node.get_clock().now().nanoseconds)
        handle: ServerGoalHandle[GoalT, ResultT, FeedbackT]
        try:
            handle = ServerGoalHandle(self, info, goal)
        except ValueError as error:  # accepted on another thread meanwhile
            self._logger.error(f"Failed to accept new goal with ID {shown(key)}: {error}")
            return None
        self._goal_handles[key] = handle
        self._results.add(key)
        return handle

    async def _cancel_requested(self, header: RequestHeader, request: Any) -> None:
        self._logger.debug(f"Cancel request received: {request}")
        info = request.goal_info
        with self._lock:
            code, found = goals_to_cancel(
                self._ledger.accepted, bytes_of(info.goal_id), nanoseconds_of(info.stamp)
            )
        canceling: list[GoalRecord] = []
        try:
            for record in found:
                if await self._cancel(record):
                    canceling.append(record)  # noqa: PERF401 - complete also after an exception
            response = self._messages.cancel_goal.Response(return_code=code)
            response.goals_canceling = [
                self._messages.goal_info(record.goal_id, record.stamp) for record in canceling
            ]
            self._parts.cancels.send_response(response, header)
        finally:
            for record in canceling:
                self._results.release(record.goal_id)

    async def _cancel(self, record: GoalRecord) -> bool:
        """Cancel a goal if the callback agrees; then its result waits for `release`."""
        handle = self._goal_handles.get(record.goal_id)
        if handle is None:
            return False
        answer = await await_or_execute(self._cancel_callback, handle)
        if answer is not CancelResponse.ACCEPT:
            if not isinstance(answer, CancelResponse):
                explain.invalid_cancel_response(self._action_name, describe(answer))
            return False
        if not self._results.hold(record.goal_id):
            return False  # another request cancels it at this moment
        try:
            handle._update_state(GoalEvent.CANCEL_GOAL)
        except RCLError as error:  # the goal ended while the callback decided
            self._results.release(record.goal_id)
            self._logger.debug(f"Failed to cancel goal in cancel callback: {error}")
            return False
        return True

    def _result_requested(self, header: RequestHeader, request: Any) -> None:
        key = bytes_of(request.goal_id)
        self._logger.debug(f"Result request received for goal with ID: {shown(key)}")
        if not self._results.request(key, header, self._node.executor):
            self._logger.warning(
                f"Sending result response for unknown or expired goal ID: {shown(key)}"
            )
            self._send_result(self._messages.get_result.Response(), header)

    def _send_result(self, response: Any, header: RequestHeader) -> None:
        if self._handle.valid:
            self._parts.results.send_response(response, header)

    # Goals

    def _accept(self, key: bytes, goal: GoalT, stamp: int) -> GoalRecord:
        with self._lock:
            return self._ledger.accept(key, goal, stamp)

    def _change(self, record: GoalRecord, event: GoalEvent) -> None:
        """Change the state of a goal and publish the status. Raises InvalidTransition."""
        with self._lock:
            if event in _ENDS:
                self._ledger.end(record, event, self._result_clock.now())
            else:
                record.change(event)
            self._publish_status()
        if record.state.is_ended:
            self.notify_goal_done()

    def _publish_status(self) -> None:
        """Publish the states of all goals; of many goals at most once in `_STATUS_EVERY`."""
        with self._lock:
            if not self._handle.valid:
                return
            now = time.monotonic()
            if len(self._ledger) > _MANY_GOALS and now < self._status_at + _STATUS_EVERY:
                self._status_due = self._status_at + _STATUS_EVERY
                self.notify_executor()
            else:
                self._status_at, self._status_due = now, _NEVER
                self._parts.publish_status(self._ledger.accepted.values())

    async def _execute_goal(
        self,
        execute_callback: Callable[[Any], Any],
        goal_handle: ServerGoalHandle[GoalT, ResultT, FeedbackT],
    ) -> None:
        goal = shown(bytes_of(goal_handle.goal_id))
        self._logger.debug(f"Executing goal with ID {goal}")
        try:
            result = await await_or_execute(execute_callback, goal_handle)
        except Exception as error:
            result = self._action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            if not self._node.context.is_over:  # else the shutdown is the reason
                excepthook.keep_program_frames(error)
                traceback.print_exception(error)
        if goal_handle.is_active:
            self._logger.warning(f"Goal state not set, assuming aborted. Goal ID: {goal}")
            goal_handle.abort()
        self._logger.debug(f"Goal with ID {goal} finished with state {goal_handle.status}")
        self._set_result(goal_handle, result)
        self._parts.settle()

    def _set_result(
        self, goal_handle: ServerGoalHandle[GoalT, ResultT, FeedbackT], result: Any
    ) -> None:
        key = bytes_of(goal_handle.goal_id)
        if not self._results.is_open(key):
            return
        response = self._messages.get_result.Response(status=goal_handle.status)
        try:
            response.result = self._as_result(result)
        except TypeError as error:
            self._results.complete(key, response)
            explain.invalid_result(self._action_name, str(error))
            raise
        self._results.complete(key, response)

    def _as_result(self, value: Any) -> Any:
        """Return the value as a result. As in ROS, any object with the same fields is accepted."""
        expected = self._action_type.Result
        if isinstance(value, expected):
            return value
        fields = expected.get_fields_and_field_types()
        is_class = isinstance(value, type)
        if value is None or is_class or not all(hasattr(value, name) for name in fields):
            problem = f"the execute callback of {self._action_name} returned {describe(value)}"
            if value is None:
                problem += f"; is `return result` ({expected.__name__}) missing at its end?"
            else:
                problem += f", expected {expected.__name__}"
            raise TypeError(problem)
        result = expected()
        for name in fields:
            setattr(result, name, getattr(value, name))
        return result

    # The server itself

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Publish the introspection events of the calls of its three services, or stop."""
        self._handle.check()
        self._parts.configure_introspection(clock, service_event_qos_profile, introspection_state)

    def destroy(self) -> None:
        """Withdraw the action and forget its goals; a callback that executes one runs to its end.

        Clients that wait for a result get an error.
        """
        if not self._handle.valid:
            return
        self._handle.destroy_when_not_in_use()
        self._node.remove_waitable(self)
        self._result_clock.close()
        for goal_handle in list(self._goal_handles.values()):
            goal_handle.destroy()
        gone = HandlerFailed(Code.UNAVAILABLE, f"the server of {self._action_name} was destroyed")
        if not explain.like_ros():
            for header in self._results.take_waiting():
                header.call.fail(gone)
        self._parts.destroy()

    node_destroyed = destroy

    # Waitable

    def has_work(self) -> bool:
        """Whether a request waits to be taken, or a result has expired."""
        return self._parts.has_work() or self._due_in() <= 0

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a request waits to be taken, or a result has expired."""
        return self.has_work()

    def nanoseconds_until_due(self) -> int | None:
        """The time until a result expires; 0 if a request waits, None without a result."""
        if self._parts.has_work():
            return 0
        left = self._due_in()
        if left > 0 and self._result_clock.is_simulated:
            left = self._status_due_in()  # `_time_advanced` wakes the executor for a result
        return None if left == _NEVER else max(0, math.ceil(left / _NANOSECOND))

    def take_data(self) -> list[Callable[[], Any]]:
        """Take one request of each kind; returns the functions that handle them."""
        self._handle.check()
        taken: list[Callable[[], Any]] = [
            partial(self._handle_request, one) for one in self._parts.take()
        ]
        if self._due_in() <= 0:
            taken.append(self._on_time)
        return taken

    async def execute(self, taken_data: list[Callable[[], Any]]) -> None:
        """Call the callbacks for the requests, and forget the results that have expired."""
        for handle in taken_data:
            result = handle()
            if result is not None:
                await result
        self._parts.settle()

    def get_num_entities(self) -> NumberOfEntities:
        """How many services and timers it consists of."""
        return NumberOfEntities(num_timers=1, num_services=3)

    def _due_in(self) -> float:
        """Seconds until a result expires, or until a status that was put off is due."""
        expiry = self._ledger.next_expiry
        if expiry is None:
            return self._status_due_in()
        return min(expiry - self._result_clock.now(), self._status_due_in())

    def _status_due_in(self) -> float:
        return self._status_due - time.monotonic()

    def _time_advanced(self) -> None:
        """Wake the executor if a result has expired in simulated time."""
        if self._due_in() <= 0:
            self.notify_executor()

    def _on_time(self) -> None:
        """Publish a status that was put off, and forget the results that have expired."""
        with self._lock:
            if self._status_due <= time.monotonic():
                self._publish_status()
            self._ledger.expire(self._result_clock.now())
            # The ledger also forgets results when it has too many.
            for key in [key for key in self._goal_handles if self._ledger.find(key) is None]:
                self._goal_handles.pop(key).destroy()
                self._results.forget(key)


_EXECUTING = (None, default_handle_accepted_callback)
"""The callbacks for accepted goals that need an execute callback."""


__getattr__ = names_of(
    __name__,
    __package__,
    {
        "action_msgs/msg": "GoalInfo GoalStatus",
        "action_msgs/srv": "CancelGoal",
        "unique_identifier_msgs/msg": "UUID",
    },
)
