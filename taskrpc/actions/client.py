"""Action clients: send goals, receive their feedback, and fetch their results."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Generic, Protocol

from taskrpc.actions.goal_handle import GoalHandle
from taskrpc.actions.goals import CancelCode
from taskrpc.actions.messages import (
    FEEDBACK_QOS,
    STATUS_QOS,
    ActionMessages,
    bytes_of,
    parse_goal_id,
    states_in,
)
from taskrpc.actions.names import names_of
from taskrpc.actions.states import ENDED, GoalState
from taskrpc.client import DEFAULT_TIMEOUT, UNSET, Client, Unset, checked_timeout
from taskrpc.core import names
from taskrpc.core.execution.callbacks import check_count
from taskrpc.core.transport.chance import present_chance
from taskrpc.errors import (
    Code,
    ConnectionLost,
    DeadlineExceeded,
    GoalAborted,
    GoalRejected,
    HandlerFailed,
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.message_types import FeedbackT, GoalT, ResultT
from taskrpc.qos import QoS

if TYPE_CHECKING:
    from taskrpc.core.observer import TopicStatus
    from taskrpc.topic import Subscription

FEEDBACK_DEPTH = 16
"""Feedback messages of one goal that are kept for a program that reads slowly."""
WAITING_CALLS = 8
"""Goals of one client for each of which a call waits for the result. A waiting call is a call in
flight, and their number is limited. So the client fetches the results of further goals only when
the status topic reports that the goal has ended."""
FEEDBACK_PATIENCE = 1.0
"""Seconds for which `send_goal` waits for the topics of feedback and status. Then it sends the
goal, and the first feedback may be lost."""
LATE_FEEDBACK = 0.05
"""Seconds after the result in which feedback still arrives: over a middleware, a result
can overtake feedback."""
RECONNECTS = (0.0, 0.1, 0.2, 0.4, 0.8)
"""Seconds before each new attempt to wait for a result after a lost connection."""
STEADY = 1.0
"""If a call waited for a result for more seconds than this, the connection was good, and the
attempts count from the first again."""
LOST_RESULT = 5.0
"""Seconds without a result, after the status has reported the end of its goal, in which the client
considers the response lost and asks again. Each time it waits twice as long: results can be big."""
CANCEL_TIMEOUT = 5.0
"""Timeout in seconds of a request that cancels a goal whose `send_goal` ended early."""

_IN_DOUBT = asyncio.CancelledError, DeadlineExceeded, ConnectionLost
"""Errors of `send_goal` after which the server may execute the goal."""
_STATES = {state.value: state for state in ENDED}


class ClientNode(Protocol):
    """The part of a node that an action client needs."""

    def resolve_service_name(self, srv_name: str) -> str:
        """Return the absolute name that a service name means for this node."""

    def create_client(
        self, srv_type: Any, srv_name: str, *, timeout: float | None = DEFAULT_TIMEOUT
    ) -> Client[Any, Any]:
        """Return a client of a service."""

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[[Any], object], qos: QoS | int = 10
    ) -> Subscription[Any]:
        """Call a function for each message of a topic."""


class ActionClient(Generic[GoalT, ResultT, FeedbackT]):
    """Sends goals to one action; made by `Node.create_action_client`.

    `timeout` (seconds, None for no deadline) is the default of `send_goal` and `cancel`. `destroy`
    calls `forget`.
    """

    def __init__(
        self,
        node: ClientNode,
        action_type: Any,
        action_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        feedback_depth: int = FEEDBACK_DEPTH,
        forget: Callable[[ActionClient[Any, Any, Any]], object] = lambda _: None,
    ) -> None:
        check_count(f"the feedback_depth of {action_name}", feedback_depth)
        names.check_unexpanded(action_name, "action name")
        self.action_type = action_type
        self.action_name = node.resolve_service_name(action_name)
        self._loop = asyncio.get_running_loop()
        self._timeout = timeout
        self._depth = feedback_depth
        self._forget = forget
        self._messages = messages = ActionMessages(action_type)
        parts = names_of(action_name)
        self._send = node.create_client(messages.send_goal, parts.send_goal, timeout=timeout)
        self._cancel = node.create_client(messages.cancel_goal, parts.cancel_goal, timeout=timeout)
        self._result = node.create_client(messages.get_result, parts.get_result, timeout=None)
        self._feedback = node.create_subscription(
            messages.feedback, parts.feedback, self._on_feedback, FEEDBACK_QOS
        )
        self._status = node.create_subscription(
            messages.status, parts.status, self._on_status, STATUS_QOS
        )
        self._matched = asyncio.Event()
        """Set when the matching publishers change."""
        self._feedback.on_matched = self._status.on_matched = self._matched.set
        self._handles: dict[bytes, GoalHandle[Any, Any]] = {}
        """The goals that have not ended."""
        self._states: dict[bytes, GoalState] = {}
        """The states of the goals in the newest status message."""
        self._tasks: dict[asyncio.Task[None], None] = {}
        """Tasks that fetch results, and tasks that cancel goals whose `send_goal` ended early."""
        self._free_slots = WAITING_CALLS
        self._queue: dict[bytes, asyncio.Future[bool]] = {}
        """The goals without a call that waits for the result. The future becomes True when such a
        call may begin, and False when the goal has ended."""
        self._destroyed = False

    def server_is_ready(self) -> bool:
        """Whether a server of the action is known."""
        return all(
            client.service_is_ready() for client in (self._send, self._cancel, self._result)
        ) and bool(self._feedback.get_publisher_count() and self._status.get_publisher_count())

    async def wait_for_server(self, timeout: float | None = None) -> bool:
        """Wait until a server offers the action; False if none does within `timeout` seconds.

        Raises TaskRpcError after `destroy`.
        """
        if self._destroyed:
            raise self._gone()
        timeout = checked_timeout(timeout, "wait_for_server: timeout")
        deadline = None if timeout is None else self._loop.time() + timeout
        for client in (self._send, self._cancel, self._result):
            left = None if deadline is None else max(0.0, deadline - self._loop.time())
            if not await client.wait_for_service(left):
                return False
        return await self._wait_for_topics(deadline)

    async def send_goal(
        self, goal: GoalT, timeout: float | Unset | None = UNSET, goal_id: str = ""
    ) -> GoalHandle[ResultT, FeedbackT]:
        """Send a goal; return its handle as soon as the server has accepted it.

        `timeout` is in seconds and covers finding the server and its decision, not the execution.
        If the response is lost, the client repeats the request; the server executes the goal once.
        With `goal_id` (a UUID), another program, or this one after a restart, can repeat the
        request: if the server knows the id, it executes nothing, and the caller gets a handle of
        the goal that has this id.

        If the timeout passes or the waiting task is cancelled, the client cancels the goal, unless
        the caller has given a `goal_id`.

        Raises:
            GoalRejected: the server did not accept the goal.
            ServiceUnavailable: no server offers the action.
            DeadlineExceeded: no response in time.
            InvalidRequest, OutcomeUnknown, …: see `taskrpc.errors`.
        """
        seconds = self._timeout if timeout is UNSET else timeout
        deadline = None if seconds is None else self._loop.time() + seconds
        key = parse_goal_id(goal_id) if goal_id else present_chance().randbytes(16)
        request = self._messages.send_goal.Request(goal_id=self._messages.goal_id(key), goal=goal)
        handle: GoalHandle[Any, Any] | None = None
        try:
            await self._send.channel.connect(deadline)
            patience = self._loop.time() + FEEDBACK_PATIENCE
            await self._wait_for_topics(patience if deadline is None else min(patience, deadline))
            handle = self._handle(key)  # feedback may arrive before the response
            left = None if deadline is None else deadline - self._loop.time()
            response = await self._send.call(request, timeout=left)
            if not response.accepted:
                text = f"the server of {self.action_name} rejected the goal and gave no reason"
                raise GoalRejected(Code.FAILED_PRECONDITION, text)
        except BaseException as error:
            if handle is not None:
                self._not_accepted(handle)
            if isinstance(error, HandlerFailed):
                raise GoalRejected(error.code, error.message) from None
            is_in_doubt = isinstance(error, _IN_DOUBT) and not getattr(error, "not_executed", None)
            if is_in_doubt and not goal_id and not self._destroyed:
                self._run(self._give_up(key))
            raise
        handle._requests -= 1
        if not handle._is_accepted:
            handle._is_accepted = True
            if self._states.get(key, GoalState.UNKNOWN).is_ended:
                self._expect_result(handle)  # a repeated request: the status says it no more
            self._run(self._fetch(handle))
        return handle

    def _handle(self, key: bytes) -> GoalHandle[Any, Any]:
        """Return the handle for a request to send a goal; requests with the same id share it."""
        handle = self._handles.get(key)
        if handle is None:
            handle = GoalHandle(key, self.action_name, self._depth, self._cancel_goal)
            self._handles[key] = handle
        handle._requests += 1
        return handle

    def _not_accepted(self, handle: GoalHandle[Any, Any]) -> None:
        handle._requests -= 1
        if not handle._requests and not handle._is_accepted:
            self._handles.pop(handle._goal_id, None)

    def destroy(self) -> None:
        """End the client; goals continue, and their handles get no feedback and no result."""
        if self._destroyed:
            return
        self._destroyed = True
        for task in self._tasks:
            task.cancel()
        error = self._gone()
        for handle in self._handles.values():
            handle._failed(GoalState.UNKNOWN, error)
            handle.feedback._end()
        self._handles.clear()
        for part in (self._send, self._cancel, self._result, self._feedback, self._status):
            part.destroy()
        self._forget(self)

    def _gone(self) -> TaskRpcError:
        return TaskRpcError(f"the action client of {self.action_name} was destroyed")

    def _count_into(self, topics: dict[str, TopicStatus]) -> None:
        """Add nothing: the subscriptions of the node count themselves."""

    def _run(self, coroutine: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(coroutine)
        self._tasks[task] = None
        task.add_done_callback(self._tasks.pop)

    async def _wait_for_topics(self, deadline: float | None) -> bool:
        """Wait until feedback and status can be received; False if not until the deadline."""
        topics = self._feedback, self._status
        while not all(topic.get_publisher_count() for topic in topics):
            self._matched.clear()
            try:
                async with asyncio.timeout_at(deadline):
                    await self._matched.wait()
            except TimeoutError:
                return False
        return True

    def _on_feedback(self, message: Any) -> None:
        if (handle := self._handles.get(bytes_of(message.goal_id))) is not None:
            handle.feedback._arrived(message.feedback)

    def _on_status(self, message: Any) -> None:
        states = self._states = states_in(message)
        for key, handle in self._handles.items():
            state = states.get(key)
            if state is not None and state.is_active:
                handle._advanced(state)
                continue
            if state is not None:
                self._expect_result(handle)
            if (turn := self._queue.get(key)) is not None and not turn.done():
                turn.set_result(False)

    def _expect_result(self, handle: GoalHandle[Any, Any]) -> None:
        """Limit the wait for a result: the server has reported that the goal has ended."""
        handle._is_over = True
        waiting = handle._waiting
        if waiting is not None and waiting.when() is None:
            waiting.reschedule(self._loop.time() + LOST_RESULT)

    async def _cancel_goal(self, key: bytes, timeout: float | Unset | None) -> bool:
        request = self._messages.cancel_goal.Request(goal_info=self._messages.goal_info(key))
        response = await self._cancel.call(request, timeout=timeout)
        accepted = (bytes_of(info.goal_id) for info in response.goals_canceling)
        return response.return_code == CancelCode.NONE and key in accepted

    async def _give_up(self, key: bytes) -> None:
        """Cancel a goal that the server may execute although `send_goal` has raised an error."""
        with contextlib.suppress(TaskRpcError):
            await self._cancel_goal(key, CANCEL_TIMEOUT)

    # Results

    async def _fetch(self, handle: GoalHandle[Any, Any]) -> None:
        """Wait for the end of a goal, and give its handle the result."""
        try:
            response = await self._response_for(handle)
        except HandlerFailed as error:
            handle._failed(GoalState.ABORTED, GoalAborted(error.code, error.message))
        except TaskRpcError as error:
            self._lost(handle, error)
            return
        else:
            if (ended := _STATES.get(response.status)) is not None:
                handle._ended(ended, response)
            else:
                problem = "has no such goal: it was restarted, or the result has expired"
                self._lost(handle, self._unknown(handle, problem))
                return
        self._loop.call_later(LATE_FEEDBACK, self._forget_goal, handle)

    def _lost(self, handle: GoalHandle[Any, Any], error: TaskRpcError) -> None:
        """Forget a goal at once: a repeated request with its id must get a new handle."""
        handle._failed(GoalState.UNKNOWN, error)
        self._forget_goal(handle)

    def _forget_goal(self, handle: GoalHandle[Any, Any]) -> None:
        if self._handles.pop(handle._goal_id, None) is not None:
            handle.feedback._end()

    async def _response_for(self, handle: GoalHandle[Any, Any]) -> Any:
        if self._free_slots:
            self._free_slots -= 1
            has_slot = True
        else:
            self._queue[handle._goal_id] = turn = self._loop.create_future()
            try:
                has_slot = await turn
            finally:
                del self._queue[handle._goal_id]
        try:
            return await self._call_for_result(handle)
        finally:
            if has_slot:
                self._leave_slot()

    def _leave_slot(self) -> None:
        for turn in self._queue.values():
            if not turn.done():
                turn.set_result(True)
                return
        self._free_slots += 1

    async def _call_for_result(self, handle: GoalHandle[Any, Any]) -> Any:
        """Call the service that responds when the goal has ended.

        It calls again if the connection or the response is lost.

        Raises OutcomeUnknown if the server is gone.
        """
        goal_id = self._messages.goal_id(handle._goal_id)
        request = self._messages.get_result.Request(goal_id=goal_id)
        waits = iter(RECONNECTS)
        patience = LOST_RESULT
        while True:
            began = self._loop.time()
            try:
                return await self._call_once(handle, request, patience)
            except TimeoutError:
                patience *= 2
            except (ConnectionLost, ServerBusy, ServiceUnavailable) as error:
                if isinstance(error, ServiceUnavailable) and not self._result.service_is_ready():
                    raise self._unknown(handle, "has ended") from None
                if self._loop.time() - began > STEADY:
                    waits = iter(RECONNECTS)
                wait = next(waits, None)
                if wait is None:
                    raise self._unknown(handle, f"cannot be reached: {error}") from None
                await asyncio.sleep(wait)

    async def _call_once(self, handle: GoalHandle[Any, Any], request: Any, patience: float) -> Any:
        """Call the service; raises TimeoutError if the response seems to be lost."""
        limit = patience if handle._is_over else None
        try:
            async with asyncio.timeout(limit) as handle._waiting:
                return await self._result.call(request, timeout=None)
        finally:
            handle._waiting = None

    def _unknown(self, handle: GoalHandle[Any, Any], problem: str) -> OutcomeUnknown:
        return OutcomeUnknown(
            f"the outcome of the goal {handle.goal_id} is unknown: the server of"
            f" {self.action_name} {problem}"
        )
