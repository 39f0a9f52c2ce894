"""Runs a service's callback: one call at a time unless told otherwise, in order of arrival."""

from __future__ import annotations

import asyncio
import contextvars
import inspect
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Hashable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec

from taskrpc.callinfo import Denied, answering
from taskrpc.deadline import TICK
from taskrpc.errors import (
    DeadlineExceeded,
    HandlerError,
    HandlerFailed,
    OutcomeUnknown,
    PermissionDenied,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.execution.fair_queue import Turns
from taskrpc.execution.stepping import Stepper
from taskrpc.given_types import RequestT, ResponseT
from taskrpc.request_ids.ids import CompletionStore
from taskrpc.security.roles import Role
from taskrpc.transport.base import IncomingCall, Mode, Offer, Transport
from taskrpc.transport.codec import ServiceType, codec_of
from taskrpc.transport.connection.deadline_timer import clock_of
from taskrpc.transport.connection.incoming_call import answer_unexpected
from taskrpc.wire.messages import DEFAULT_LIMITS

if TYPE_CHECKING:
    from taskrpc.exactly_once import Effect, OnceDesk
    from taskrpc.execution.daemon_threads import DaemonThreads
    from taskrpc.observer import Observer, ServiceStatus

log = logging.getLogger("taskrpc.server")

Returned: TypeAlias = "ResponseT | Effect[ResponseT]"
"""What a callback returns; an Effect only where the service is exactly-once."""

Callback: TypeAlias = Callable[
    [RequestT, ResponseT], "Returned[ResponseT] | Awaitable[Returned[ResponseT]]"
]
"""`callback(request, response)`, plain or async; returns the response."""

QUEUE_LIMIT = 1024
"""Calls that wait for their turn; more are refused as ServerBusy."""

MEASURED = 16
"""Calls whose quickest tells how long a call takes at least."""

RETRY_AFTER = 0.1
HOLDS_LOOP_AFTER = 0.25
"""Seconds on the loop after which a callback is named in a warning."""


class Service:
    """A service that a node offers; made by `Node.create_service`."""

    def __init__(
        self,
        transport: Transport,
        srv_type: ServiceType,
        name: str,
        node: str,
        callback: Callback[Any, Any],
        *,
        concurrency: int | None = None,
        threaded: bool = False,
        mode: Mode = Mode.AT_MOST_ONCE,
        store: CompletionStore | None = None,
        join: bool = False,
        observer: Observer | None = None,
        role: Role = Role.SUBMIT,
    ) -> None:
        if concurrency is None:
            # As many as a caller may have in flight, so that a store can commit them together.
            concurrency = 1 if store is None else DEFAULT_LIMITS.calls
        if concurrency < 1:
            raise ValueError(f"concurrency: expected at least 1, got {concurrency}")
        self.srv_type = srv_type
        self.service_name = name
        self._callback = callback
        self._concurrency = concurrency
        self._running = 0
        self._waiting: Turns[IncomingCall] = Turns()
        self._jobs: dict[IncomingCall, tuple[asyncio.Future[Any], float]] = {}
        self._durations: deque[float] = deque(maxlen=MEASURED)
        """Seconds of the latest calls, measured while others wait."""
        self._loop = asyncio.get_running_loop()
        self._now = clock_of(self._loop)
        self._stepper = Stepper(self._loop, self._held_loop)
        self._response = srv_type.Response
        self._destroyed = False
        self.finished: asyncio.Future[None] = self._loop.create_future()
        """Done once the service is destroyed and has answered its last call."""
        self._threads = _threads(name, concurrency) if threaded else None
        self._warned = False
        self._transport = transport
        self._desk = self._desk_before(store)
        self._offer = self._offered(node, mode, join, observer, role)
        try:
            transport.offer(self._offer)
        except BaseException:
            self._close_desk()
            raise

    def _desk_before(self, store: CompletionStore | None) -> OnceDesk | None:
        if store is None:
            return None
        from taskrpc.exactly_once import OnceDesk  # few services are exactly-once

        codec = codec_of(self.srv_type.Response)
        return OnceDesk(store, codec, self._arrived)

    def _offered(
        self, node: str, mode: Mode, join: bool, observer: Observer | None, role: Role
    ) -> Offer:
        serve, store_id, desk = self._arrived, None, self._desk
        if desk is not None:
            serve, store_id, mode = desk.arrived, desk.store_id, Mode.EXACTLY_ONCE
        name, srv_type = self.service_name, self.srv_type
        return Offer(name, srv_type, node, serve, mode, join, store_id, observer, role)

    def _close_desk(self) -> None:
        if self._desk is not None:
            self._desk.close()

    def destroy(self) -> None:
        """Stop offering the service; calls that have arrived are still answered."""
        self._transport.withdraw(self._offer)
        self._destroyed = True
        self._finish_if_idle()

    def observe(self, observer: Observer | None) -> None:
        """Tell another observer of the calls that come from now on."""
        if not self._destroyed:
            offer = msgspec.structs.replace(self._offer, observer=observer)
            self._transport.replace(self._offer, offer)
            self._offer = offer

    def status(self) -> ServiceStatus:
        """How many calls run and wait."""
        from taskrpc.observer import ServiceStatus  # few programs ask

        once = None if self._desk is None else self._desk.status()
        return ServiceStatus(self.service_name, self._running, self._waiting.count, once)

    def abandon(self) -> None:
        """Stop at once: calls that wait go elsewhere, what became of running ones is unknown."""
        self.destroy()
        while self._waiting.count:
            self._waiting.take().fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
        for call, (job, _) in list(self._jobs.items()):
            call.cancel()
            call.fail(OutcomeUnknown("the server was shut down while it ran this call"))
            # A thread runs on; but nobody may wait for it, least of all a loop that has ended.
            job.cancel()
        self._finish_if_idle()

    # A call's way: arrived, (waits), started, run here, in a task or in a thread, answered.

    def _arrived(self, call: IncomingCall) -> None:
        if self._destroyed:
            call.fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
        elif self._running < self._concurrency and not self._waiting.count:
            self._start(call)
        else:
            self._wait(call)

    def _wait(self, call: IncomingCall) -> None:
        lane = call.lane
        if self._waiting.count >= QUEUE_LIMIT:
            # Whoever has most calls waiting loses one, so that a runaway loop refuses itself.
            surplus = self._waiting.take_surplus(lane) or call
            surplus.on_cancel = None
            message = f"{self.service_name} has {QUEUE_LIMIT} calls waiting"
            surplus.fail(ServerBusy(message, retry_after=RETRY_AFTER))
            if surplus is call:
                return
        call.on_cancel = partial(self._leave_queue, lane, call)
        self._waiting.add(lane, call)

    def _start(self, call: IncomingCall) -> bool:
        """Run a call; False where its deadline passed before it could begin."""
        began = self._now()
        if call.deadline is not None and call.deadline <= began:
            problem = "the deadline passed before the call began"
            call.fail(DeadlineExceeded(problem, not_executed=True))
            return False
        call.started = True
        call.on_cancel = None
        self._running += 1
        if self._threads is not None:
            self._run_in_thread(self._threads, call, self._response(), began)
            return True
        token = answering.set(call)
        try:
            result = self._callback(call.request, self._response())
            if result.__class__ is not self._response and hasattr(result, "__await__"):
                if self._run_async(call, result, began):
                    return True
            else:
                self._returned(call, result)
        except BaseException as error:
            self._raised(call, error)
            if isinstance(error, SystemExit | KeyboardInterrupt):
                # From a turn of its own: uvloop swallows what a protocol raises, and here the
                # call would count as running for ever, so that a drain waits for it.
                self._loop.call_soon(_end_program, error)
        finally:
            answering.reset(token)
            if (held := self._now() - began) > HOLDS_LOOP_AFTER:
                self._held_loop(held)
        desk = self._desk
        if desk is not None and desk.storing and self._waits_for_store(desk, call, began):
            return True
        self._running -= 1
        if self._waiting.count or self._destroyed:
            self._finished(began)
        return True

    def _run_async(self, call: IncomingCall, result: Awaitable[Any], began: float) -> bool:
        """Run an awaitable; returns whether it needs more time."""
        coroutine: Coroutine[Any, Any, Any]
        if inspect.iscoroutine(result):
            coroutine = result
        elif isinstance(result, asyncio.Future) and result.get_loop() is self._loop:
            if result.done():
                self._returned(call, result.result())
                return False
            call.on_cancel = result.cancel
            self._await(result, call, began)
            return True
        else:
            coroutine = _awaited(result)
        try:
            job = self._stepper.step(partial(answering.set, call), coroutine)
        except StopIteration as done:
            self._returned(call, done.value)
            return False
        call.on_cancel = job.cancel
        self._await(job, call, began)
        return True

    def _run_in_thread(
        self, threads: DaemonThreads, call: IncomingCall, response: Any, began: float
    ) -> None:
        token = answering.set(call)
        context = contextvars.copy_context()
        answering.reset(token)
        job = self._loop.run_in_executor(
            threads, lambda: context.run(_run_to_end, self._callback, call.request, response)
        )
        self._await(job, call, began)

    def _await(self, job: asyncio.Future[Any], call: IncomingCall, began: float) -> None:
        self._jobs[call] = job, began
        job.add_done_callback(partial(self._job_done, call))

    def _job_done(self, call: IncomingCall, done: asyncio.Future[Any]) -> None:
        _, began = self._jobs.pop(call)
        call.on_cancel = None  # the job has the call in its context: left to each other, both stay
        if done.cancelled():
            if call.cancelled:
                call.fail(TaskRpcError("cancelled by the caller"))
            else:
                self._raised(call, asyncio.CancelledError())
        elif (error := done.exception()) is not None:
            self._raised(call, error)
        else:
            self._returned(call, done.result())
        if self._desk is None or not self._waits_for_store(self._desk, call, began):
            self._stored(began)

    def _waits_for_store(self, desk: OnceDesk, call: IncomingCall, began: float) -> bool:
        """Whether a call keeps its place until its effect is stored, for the next one to see."""
        if call not in desk.storing:
            return False
        desk.storing[call] = partial(self._stored, began)
        return True

    def _stored(self, began: float) -> None:
        self._running -= 1
        self._finished(began)

    def _returned(self, call: IncomingCall, response: Any) -> None:
        try:
            call.reply(response)
        except Exception as error:
            problem: Exception = ValueError(f"the response cannot be sent: {error}")
            if response is None:
                name = getattr(self._callback, "__qualname__", "the callback")
                text = f"{name} returned None; a service callback must `return response`"
                problem = TypeError(text)
            answer_unexpected(call, problem)

    def _raised(self, call: IncomingCall, error: BaseException) -> None:
        if isinstance(error, Denied):
            call.fail(PermissionDenied(str(error)))
            return
        if not isinstance(error, HandlerError):
            answer_unexpected(call, error)
            return
        try:
            failed = HandlerFailed(error.code, str(error.message))
        except Exception as problem:  # a subclass need not have called HandlerError's __init__
            problem.__cause__ = error
            answer_unexpected(call, problem)
        else:
            call.fail(failed)

    def _finished(self, began: float) -> None:
        if self._waiting.count:
            self._durations.append(self._now() - began)
            # Not from here: a chain of short calls would grow the stack and starve the loop.
            self._loop.call_soon(self._start_waiting)
        elif self._destroyed:
            self._finish_if_idle()

    def _start_waiting(self) -> None:
        while self._waiting.count and self._running < self._concurrency:
            call = self._waiting.take()
            if call.must_wait():
                self._postpone(call)
            elif self._is_in_vain(call):
                problem = "too little time was left when the call's turn came"
                # Not DeadlineExceeded: the caller's deadline has not come yet.
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))
            elif self._start(call):
                return
        self._finish_if_idle()

    def _is_in_vain(self, call: IncomingCall) -> bool:
        """Whether a call has hardly the time that the quickest of many took, and others wait.

        Without this, a service that lags behind by its callers' deadline begins each call just
        in time to be too late, and answers nobody any more.
        """
        if call.deadline is None or not self._waiting.count or len(self._durations) < MEASURED:
            return False
        return call.deadline - self._now() < 1.25 * min(self._durations) + TICK

    def _postpone(self, call: IncomingCall) -> None:
        """Let a call come again once there is room for its answer, and what follows it too."""
        following = self._waiting.remove_all(call.lane, lambda each: each.must_wait())
        for each in (call, *following):
            each.postpone()

    def _leave_queue(self, lane: Hashable, call: IncomingCall) -> None:
        self._waiting.remove(lane, call)
        self._finish_if_idle()

    def _finish_if_idle(self) -> None:
        is_busy = self._running or self._waiting.count
        if self._destroyed and not is_busy and not self.finished.done():
            self.finished.set_result(None)
            self._stepper.close()
            self._close_desk()
            if self._threads is not None:
                self._threads.shutdown()

    def _held_loop(self, seconds: float) -> None:
        if seconds > HOLDS_LOOP_AFTER and not self._warned:
            self._warned = True
            log.warning(
                "the callback of %s held the event loop for %.2f s, so that nothing else ran;"
                " create the service with threaded=True, or let it await instead of blocking",
                self.service_name,
                seconds,
                extra={"service": self.service_name},
            )


def _threads(name: str, concurrency: int) -> DaemonThreads:
    from taskrpc.execution.daemon_threads import DaemonThreads  # few services need threads

    return DaemonThreads(concurrency, f"taskrpc {name}")


async def _awaited(result: Awaitable[Any]) -> Any:
    return await result


def _end_program(error: BaseException) -> None:
    raise error


def _run_to_end(callback: Callback[Any, Any], request: Any, response: Any) -> Any:
    try:
        result = callback(request, response)
        return asyncio.run(result) if inspect.iscoroutine(result) else result
    except StopIteration as error:
        # A future cannot carry it; generators turn it into the same error.
        raise RuntimeError("the callback raised StopIteration") from error
