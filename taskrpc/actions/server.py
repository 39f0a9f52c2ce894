"""Action servers: accept goals, run the callback for each, and send feedback and results."""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from srvgen import excepthook
from taskrpc.actions.goals import CancelCode, GoalLedger, GoalRecord, goals_to_cancel
from taskrpc.actions.messages import (
    FEEDBACK_QOS,
    STATUS_QOS,
    ActionMessages,
    bytes_of,
    nanoseconds_of,
)
from taskrpc.actions.names import ActionNames, names_of
from taskrpc.actions.server_goal import AcceptCancel, AcceptGoal, Execute, ServerGoal
from taskrpc.actions.states import GoalEvent, GoalState
from taskrpc.core import names
from taskrpc.core.callinfo import current_call
from taskrpc.core.exactly_once.stores import MemoryCompletions
from taskrpc.core.execution.callbacks import (
    HOLDS_LOOP_AFTER,
    check_callback,
    check_count,
    run_to_end,
    threads_for,
)
from taskrpc.core.execution.eager_start import EagerStarter
from taskrpc.core.request_ids.ids import CompletionStore
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import end_program
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.time_of_day import time_of_day_ns
from taskrpc.deferred import DeferredCall, DeferredService
from taskrpc.errors import (
    Code,
    HandlerError,
    HandlerFailed,
    InvalidRequest,
    NameInUse,
    TaskRpcError,
)
from taskrpc.qos import QoS
from taskrpc.service import Service
from taskrpc.topic import Publisher

if TYPE_CHECKING:
    from taskrpc.core.observer import ServiceStatus

log = logging.getLogger("taskrpc.server")

KEEP_RESULTS = 900.0
"""Seconds for which a server keeps the result of a goal: 15 minutes."""
MOST_WAITING = 1024
"""Accepted goals that may wait for other goals to end; the server rejects further goals."""
CANCELS = 64
"""Requests to cancel whose `cancel` callbacks may run at the same time."""
MANY_GOALS, STATUS_EVERY = 30, 0.1
"""With more goals than this, the status is published at most once in so many seconds: the message
lists all goals."""
STATUSES_PER_SECOND = 5000
"""With thousands of goals, the status is published less often still."""


class ServerNode(Protocol):
    """The part of a node that an action server needs."""

    def resolve_service_name(self, srv_name: str) -> str:
        """Return the absolute name that a service name means for this node."""

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        concurrency: int | None = None,
        idempotent: bool = False,
        exactly_once: CompletionStore | None = None,
        role: Role = Role.SUBMIT,
    ) -> Service:
        """Offer a service."""

    def create_deferred_service(
        self,
        srv_type: Any,
        srv_name: str,
        take: Callable[[DeferredCall[Any, Any]], object],
        *,
        role: Role = Role.SUBMIT,
    ) -> DeferredService:
        """Offer a service; the program responds later."""

    def create_publisher(self, msg_type: Any, topic: str, qos: QoS | int = 10) -> Publisher[Any]:
        """Publish messages of a type on a topic."""


class ActionServer:
    """An action that a node offers; made by `Node.create_action_server`.

    `wall_clock` returns the nanoseconds since 1970.
    """

    def __init__(
        self,
        node: ServerNode,
        action_type: Any,
        action_name: str,
        execute: Execute[Any, Any, Any],
        *,
        accept_goal: AcceptGoal[Any] | None = None,
        accept_cancel: AcceptCancel[Any, Any, Any] | None = None,
        concurrency: int = 1,
        threaded: bool = False,
        result_timeout: float = KEEP_RESULTS,
        role: Role = Role.SUBMIT,
        wall_clock: Callable[[], int] = time_of_day_ns,
    ) -> None:
        check_count(f"the concurrency of {action_name}", concurrency)
        if not (isinstance(result_timeout, int | float) and 0 <= result_timeout < math.inf):
            raise ValueError(f"result_timeout: expected seconds from 0, got {result_timeout!r}")
        _check_callbacks(action_name, execute, accept_goal, accept_cancel)
        names.check_unexpanded(action_name, "action name")
        self.action_type = action_type
        self.action_name = node.resolve_service_name(action_name)
        self.finished: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done once the server is destroyed and its last goal has ended."""
        self._loop = asyncio.get_running_loop()
        self._execute = execute
        self._accept_goal = accept_goal
        self._accept_cancel = accept_cancel
        self._concurrency = concurrency
        self._wall_clock = wall_clock
        self._messages = messages = ActionMessages(action_type)
        self._encode_result = codec_of(messages.result).encode
        self._ledger = GoalLedger(result_timeout)
        self._deciding: dict[bytes, asyncio.Future[None]] = {}
        """Goals whose `goal` callback has not decided yet."""
        self._goals: dict[bytes, ServerGoal[Any, Any, Any]] = {}
        """The goals that have not ended."""
        self._waiting: dict[bytes, ServerGoal[Any, Any, Any]] = {}
        """Accepted goals that have not begun, in order."""
        self._jobs: dict[bytes, asyncio.Future[Any] | None] = {}
        """The task of each goal that runs."""
        self._results: dict[bytes, dict[DeferredCall[Any, Any], None]] = {}
        """The calls that wait for the result of a goal."""
        self._expiry: asyncio.TimerHandle | None = None
        self._later_status: asyncio.TimerHandle | None = None
        """The timer that publishes the status when there are many goals."""
        self._grace: asyncio.TimerHandle | None = None
        """The timer that aborts the goals which still run after `stop`."""
        self._cancelling: list[asyncio.Task[bool]] = []
        """The cancellations of `stop`."""
        self._destroyed = self._is_abandoned = self._has_warned = False
        self._starter = EagerStarter(self._loop, self._held_loop)
        self._threads = threads_for(concurrency, action_name, threaded=threaded)
        self.services: list[Service | DeferredService] = []
        """The three services; they end with the action server and not before."""
        parts = names_of(action_name)
        try:
            self._offer_services(node, parts, role)
            self._feedback = node.create_publisher(messages.feedback, parts.feedback, FEEDBACK_QOS)
            self._status = node.create_publisher(messages.status, parts.status, STATUS_QOS)
        except BaseException as error:
            for service in self.services:
                service.destroy()
            if isinstance(error, NameInUse):
                raise error.without_join() from None
            raise

    def _offer_services(self, node: ServerNode, parts: ActionNames, role: Role) -> None:
        # A request that is repeated after a lost response must get the first decision. By the
        # store's id, a client notices that a new server has replaced this one; it then does
        # not repeat the request, so the new server does not execute the goal again.
        self.services.append(
            node.create_service(
                self._messages.send_goal,
                parts.send_goal,
                self._send_goal,
                exactly_once=MemoryCompletions(),
                role=role,
            )
        )
        self.services.append(
            node.create_service(
                self._messages.cancel_goal,
                parts.cancel_goal,
                self._cancel_goals,
                concurrency=CANCELS,
                idempotent=True,
                role=role,
            )
        )
        self.services.append(
            node.create_deferred_service(
                self._messages.get_result, parts.get_result, self._get_result, role=Role.OBSERVE
            )
        )

    def status(self) -> ServiceStatus:
        """Return how many goals run and wait."""
        from taskrpc.core.observer import ServiceStatus  # few programs need it

        return ServiceStatus(self.action_name, len(self._jobs), len(self._waiting), None)

    def destroy(self) -> None:
        """Accept no more goals; goals that run continue, and those that wait are aborted.

        Until the last goal has ended, clients can still cancel goals and wait for results.
        """
        if self._destroyed:
            return
        self._destroyed = True
        self.services[0].destroy()
        error = HandlerFailed(Code.UNAVAILABLE, "the action server ended before the goal began")
        for goal in list(self._waiting.values()):
            del self._waiting[goal._record.goal_id]
            goal._record.change(GoalEvent.EXECUTE)  # only a goal that executes can be ABORTED
            self._end(goal, GoalEvent.ABORT, None, error)
        self._finish_if_idle()

    def stop(self, grace: float) -> None:
        """Destroy the server and cancel its goals; abort goals that run `grace` seconds later.

        The program may refuse to cancel a goal, as when a client asks. The callback of an aborted
        goal is cancelled, but a thread goes on.
        """
        self.destroy()
        if self.finished.done() or self._grace is not None:
            return
        self._grace = self._loop.call_later(grace, self._abort_running, grace)
        self._cancelling = [
            self._loop.create_task(self._cancel(goal._record)) for goal in self._goals.values()
        ]

    def _abort_running(self, grace: float) -> None:
        # Not UNAVAILABLE, which promises that the callback did nothing.
        error = HandlerFailed(Code.OUTCOME_UNKNOWN, "the action server ended before the goal did")
        jobs, self._jobs = self._jobs, {}
        for goal in list(self._goals.values()):
            text = "goal %s of %s has not ended within %g s, so it was aborted"
            log.warning(text, goal.goal_id, self.action_name, grace)
            self._end(goal, GoalEvent.ABORT, None, error)
        for job in jobs.values():
            if job is not None:
                job.cancel()
        self._finish_if_idle()

    def abandon(self) -> None:
        """Stop at once: the callbacks are cancelled, and clients get OutcomeUnknown."""
        self._is_abandoned = True
        for service in self.services:
            service.abandon()
        self.destroy()
        for goal in list(self._goals.values()):
            if goal.state.is_cancelable:
                goal._record.change(GoalEvent.CANCEL_GOAL)  # so a callback in a thread can stop
        for job in list(self._jobs.values()):
            if job is not None and job is not asyncio.current_task():
                job.cancel()
        self._goals.clear()
        self._jobs.clear()
        self._finish_if_idle()

    def _publish_feedback(self, goal: GoalRecord, feedback: Any) -> None:
        """Send the feedback of a goal; any thread may call it.

        Raises InvalidRequest for an invalid message; TaskRpcError once the goal has ended.
        """
        if not goal.state.is_active or self._is_abandoned:
            raise TaskRpcError(f"the goal {goal.goal_id.hex()} has ended: it has no more feedback")
        messages = self._messages
        self._feedback.publish(
            messages.feedback(goal_id=messages.goal_id(goal.goal_id), feedback=feedback)
        )

    # The services. A foreign caller cannot receive errors; it gets the responses that ROS defines.

    async def _send_goal(self, request: Any, response: Any) -> Any:
        goal_id = bytes_of(request.goal_id)
        call = current_call()
        while (deciding := self._deciding.get(goal_id)) is not None:
            await asyncio.wait([deciding])
        record = self._ledger.find(goal_id)
        if record is None:
            if (refusal := self._refusal()) is not None:
                if call.is_foreign:
                    return response
                raise refusal
            record = await self._decide(goal_id, request.goal)
        elif record.request != request.goal:
            if call.is_foreign:
                return response
            text = f"another goal was sent with the id {goal_id.hex()} before"
            raise HandlerError(Code.ALREADY_EXISTS, text)
        if record.is_rejected and record.error is not None and not call.is_foreign:
            raise HandlerError(record.error.code, record.error.message)
        response.accepted = not record.is_rejected
        response.stamp = self._messages.time(record.stamp)
        return response

    def _refusal(self) -> HandlerError | None:
        """Return the error with which the server rejects all goals now; None if it accepts some."""
        if self._destroyed:
            return HandlerError(Code.UNAVAILABLE, "the action server is ending")
        if len(self._waiting) >= MOST_WAITING:
            text = f"{len(self._waiting)} goals of {self.action_name} wait already; try again later"
            return HandlerError(Code.RESOURCE_EXHAUSTED, text)
        return None

    async def _decide(self, goal_id: bytes, request: Any) -> GoalRecord:
        """Ask the program whether it accepts a goal, and queue an accepted one."""
        self._deciding[goal_id] = decided = self._loop.create_future()
        try:
            is_accepted, error = await self._ask(goal_id, request)
        finally:
            del self._deciding[goal_id]
            decided.set_result(None)
        stamp = self._wall_clock()
        if not is_accepted or self._destroyed:
            if self._destroyed:
                error = HandlerFailed(Code.UNAVAILABLE, "the action server is ending")
            record = self._ledger.reject(goal_id, request, stamp, self._loop.time(), error)
            self._schedule_expiry()
            return record
        record = self._ledger.accept(goal_id, request, stamp)
        self._goals[goal_id] = self._waiting[goal_id] = ServerGoal(record, self._publish_feedback)
        self._publish_status()
        self._loop.call_soon(self._begin)  # the client should get its response first
        return record

    async def _ask(self, goal_id: bytes, request: Any) -> tuple[bool, HandlerFailed | None]:
        if self._accept_goal is None:
            return True, None
        try:
            return await _decision("goal", self._accept_goal(request)), None
        except asyncio.CancelledError:
            raise
        except Exception as error:
            if isinstance(error, HandlerError):
                log.info("rejected goal %s of %s: %s", goal_id.hex(), self.action_name, error)
            return False, self._failure(goal_id, error)

    async def _cancel_goals(self, request: Any, response: Any) -> Any:
        info = request.goal_info
        goal_id, stamp = bytes_of(info.goal_id), nanoseconds_of(info.stamp)
        named = self._goals.get(goal_id)
        if named is not None and named.is_cancel_requested and not stamp:
            code, canceling = CancelCode.NONE, [named._record]  # a repeated request
        else:
            code, found = goals_to_cancel(self._ledger.accepted, goal_id, stamp)
            canceling = [record for record in found if await self._cancel(record)]
            if found and not canceling:
                has_ended = all(record.state.is_ended for record in found)
                code = CancelCode.GOAL_TERMINATED if has_ended else CancelCode.REJECTED
        response.return_code = code
        response.goals_canceling = [
            self._messages.goal_info(record.goal_id, record.stamp) for record in canceling
        ]
        return response

    async def _cancel(self, record: GoalRecord) -> bool:
        """Cancel one goal if the program accepts it; return whether it did."""
        goal = self._goals.get(record.goal_id)
        if goal is None or not await self._may_cancel(goal):
            return False
        if not record.state.is_cancelable:  # it ended while the program decided
            return record.state is GoalState.CANCELING
        record.change(GoalEvent.CANCEL_GOAL)
        if self._waiting.pop(record.goal_id, None) is not None:
            self._end(goal, GoalEvent.CANCELED, None, None)
        else:
            self._publish_status()
            goal._cancelled.set()
        return True

    async def _may_cancel(self, goal: ServerGoal[Any, Any, Any]) -> bool:
        if self._accept_cancel is None:
            return True
        try:
            return await _decision("cancel", self._accept_cancel(goal))
        except asyncio.CancelledError:
            raise
        except Exception as error:
            self._failure(goal._record.goal_id, error)
            return False

    def _get_result(self, call: DeferredCall[Any, Any]) -> None:
        call.started()
        goal_id = bytes_of(call.request.goal_id)
        record = self._ledger.find(goal_id)
        if record is None or record.is_rejected:
            call.reply(self._messages.get_result.Response(status=GoalState.UNKNOWN))
        elif record.state.is_ended:
            self._reply(call, record)
        else:
            self._results.setdefault(goal_id, {})[call] = None
            call.info.on_cancel = partial(self._forget_call, goal_id, call)

    def _forget_call(self, goal_id: bytes, call: DeferredCall[Any, Any]) -> None:
        """Forget a call that its caller has cancelled, or whose connection is lost."""
        calls = self._results.get(goal_id, {})
        calls.pop(call, None)
        if not calls:
            self._results.pop(goal_id, None)
        call.fail(TaskRpcError("cancelled by the caller"))

    def _reply(self, call: DeferredCall[Any, Any], record: GoalRecord) -> None:
        call.info.on_cancel = None  # breaks a reference cycle
        if record.error is not None and not call.info.is_foreign:
            call.fail(record.error)
            return
        result = self._messages.result() if record.result is None else record.result
        call.reply(self._messages.get_result.Response(status=record.state, result=result))

    # The callbacks of goals

    def _begin(self) -> None:
        """Begin as many goals as may run."""
        while self._waiting and len(self._jobs) < self._concurrency and not self._destroyed:
            goal_id = next(iter(self._waiting))
            goal = self._waiting.pop(goal_id)
            goal._record.change(GoalEvent.EXECUTE)
            self._jobs[goal_id] = None
            self._publish_status()
            began = self._loop.time()
            try:
                job = self._starter.start(self._run(goal))
            except StopIteration:
                pass
            else:
                self._jobs[goal_id] = job
                job.add_done_callback(partial(self._job_done, goal))
            self._held_loop(self._loop.time() - began)

    async def _run(self, goal: ServerGoal[Any, Any, Any]) -> None:
        """Run the callback of one goal to its end."""
        try:
            if self._threads is not None:
                result = await self._loop.run_in_executor(
                    self._threads, run_to_end, self._execute, goal
                )
            else:
                result = self._execute(goal)
                if hasattr(result, "__await__"):
                    result = await result
            self._check_result(result)
        except BaseException as error:
            if self._is_abandoned or not goal.state.is_active:
                raise
            self._ended(goal, GoalEvent.ABORT, None, self._failure(goal._record.goal_id, error))
            if isinstance(error, SystemExit | KeyboardInterrupt):
                self._loop.call_soon(end_program, error)
        else:
            self._ended(goal, goal._ending, result, None)

    def _job_done(self, goal: ServerGoal[Any, Any, Any], job: asyncio.Future[Any]) -> None:
        if not job.cancelled():
            job.exception()  # marks it as retrieved: no client waits for the error
        elif goal.state.is_active and not self._is_abandoned:  # cancelled before its first step
            self._ended(goal, GoalEvent.ABORT, None, None)

    def _check_result(self, result: Any) -> None:
        expected = self._messages.result
        if not isinstance(result, expected):
            name = getattr(self._execute, "__qualname__", "the callback")
            got = "None" if result is None else f"a {type(result).__name__}"
            raise TypeError(f"{name} returned {got}; the callback must return a {expected._TYPE}")
        try:
            self._encode_result(result)
        except InvalidRequest as error:
            raise ValueError(f"the result cannot be sent: {error}") from None

    def _failure(self, goal_id: bytes, error: BaseException) -> HandlerFailed:
        """Return the error for clients after an exception of a callback; log the traceback."""
        if isinstance(error, HandlerError):
            return HandlerFailed(error.code, str(error.message))
        if isinstance(error, asyncio.CancelledError):  # the program did it, or ends
            log.error(
                "goal %s of %s failed: its callback was cancelled", goal_id.hex(), self.action_name
            )
            return HandlerFailed(Code.INTERNAL, "the callback was cancelled")
        excepthook.explain(error)
        log.error("goal %s of %s failed:", goal_id.hex(), self.action_name, exc_info=error)
        text = f"the callback failed; see the server's log, goal {goal_id.hex()}"
        if isinstance(error, HandlerError.Invalid):
            text += f": {error}"
        return HandlerFailed(Code.INTERNAL, text)

    def _ended(
        self,
        goal: ServerGoal[Any, Any, Any],
        event: GoalEvent,
        result: Any,
        error: HandlerFailed | None,
    ) -> None:
        """End a goal that ran, and begin the next one."""
        if not goal.state.is_active or self._is_abandoned:
            return
        self._jobs.pop(goal._record.goal_id, None)
        self._end(goal, event, result, error)
        self._loop.call_soon(self._begin)
        self._finish_if_idle()

    def _end(
        self,
        goal: ServerGoal[Any, Any, Any],
        event: GoalEvent,
        result: Any,
        error: HandlerFailed | None,
    ) -> None:
        record = goal._record
        self._ledger.end(record, event, self._loop.time(), result=result, error=error)
        del self._goals[record.goal_id]
        self._publish_status()
        for call in self._results.pop(record.goal_id, ()):
            self._reply(call, record)
        self._schedule_expiry()

    # Status, expiry, and the end of the server

    def _publish_status(self) -> None:
        count = len(self._ledger)
        if count <= MANY_GOALS or self._destroyed:
            self._publish_status_now()
        elif self._later_status is None:
            wait = max(STATUS_EVERY, count / STATUSES_PER_SECOND)
            self._later_status = self._loop.call_later(wait, self._publish_status_now)

    def _publish_status_now(self) -> None:
        if self._later_status is not None:
            self._later_status.cancel()
            self._later_status = None
        if not self._is_abandoned:
            self._status.publish(self._messages.statuses(self._ledger.accepted.values()))

    def _schedule_expiry(self) -> None:
        expiry = self._ledger.next_expiry
        if self._expiry is None and expiry is not None and not self.finished.done():
            self._expiry = self._loop.call_at(expiry, self._expire)

    def _expire(self) -> None:
        self._expiry = None
        if self._ledger.expire(self._loop.time()):
            self._publish_status()
        self._schedule_expiry()

    def _finish_if_idle(self) -> None:
        if not self._destroyed or self._goals or self.finished.done():
            return
        self.finished.set_result(None)
        for timer in (self._expiry, self._later_status, self._grace, *self._cancelling):
            if timer is not None:
                timer.cancel()
        for part in (*self.services, self._feedback, self._status):
            part.destroy()
        self._starter.close()
        if self._threads is not None:
            self._threads.shutdown()

    def _held_loop(self, seconds: float) -> None:
        if seconds > HOLDS_LOOP_AFTER and not self._has_warned:
            self._has_warned = True
            log.warning(
                "the callback of %s held the event loop for %.2f s, so that nothing else ran;"
                " create the action server with threaded=True, or let it await instead of blocking",
                self.action_name,
                seconds,
            )


async def _decision(name: str, answer: object) -> bool:
    """The answer of a function of the program that accepts or refuses; it may be a coroutine."""
    if inspect.isawaitable(answer):
        answer = await answer
    if answer is None:
        raise TypeError(f"`{name}=`: expected a function that returns True or False, got None")
    return bool(answer)


def _check_callbacks(
    action_name: str,
    execute: Execute[Any, Any, Any],
    accept_goal: AcceptGoal[Any] | None,
    accept_cancel: AcceptCancel[Any, Any, Any] | None,
) -> None:
    check_callback(execute, f"the callback of {action_name}", ("a goal",))
    if accept_goal is not None:
        check_callback(accept_goal, f"`goal=` of {action_name}", ("a request",))
    if accept_cancel is not None:
        check_callback(accept_cancel, f"`cancel=` of {action_name}", ("a goal",))
