"""A service: runs its handler for each call, by default one call at a time, fair among callers."""

from __future__ import annotations

import asyncio
import contextvars
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Hashable
from functools import partial
from types import CoroutineType
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec

from taskrpc.core.callinfo import Denied, answering
from taskrpc.core.execution.callbacks import (
    HOLDS_LOOP_AFTER,
    as_coroutine,
    check_callback,
    check_count,
    run_to_end,
    threads_for,
)
from taskrpc.core.execution.eager_start import EagerStarter
from taskrpc.core.execution.fair_queue import FairQueue
from taskrpc.core.request_ids.ids import CompletionStore
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import (
    Begun,
    GoOn,
    IncomingCall,
    Mode,
    Offer,
    PlainService,
    end_program,
)
from taskrpc.core.transport.codec import ServiceType, codec_of
from taskrpc.core.transport.connection.deadline_timer import TICK, clock_of
from taskrpc.core.transport.connection.incoming_call import answer_unexpected
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.wire.messages import DEFAULT_LIMITS
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
from taskrpc.message_types import RequestT, ResponseT

if TYPE_CHECKING:
    from taskrpc.core.exactly_once import Deduplicator, Effect
    from taskrpc.core.execution.daemon_threads import DaemonThreads
    from taskrpc.core.observer import Observer, ServiceStatus

log = logging.getLogger("taskrpc.server")

Returned: TypeAlias = "ResponseT | Effect[ResponseT]"
"""The return value of a handler; an Effect only if the service is exactly-once."""

Callback: TypeAlias = Callable[
    [RequestT, ResponseT], "Returned[ResponseT] | Awaitable[Returned[ResponseT]]"
]
"""`callback(request, response)`, plain or async; returns the response."""

QUEUE_LIMIT = 1024
"""How many calls may wait; more are refused with ServerBusy."""

SAMPLED = 16
"""Recent calls, sampled for the minimum service time."""

RETRY_AFTER = 0.1
"""Seconds after which a client may repeat a call that was refused because the queue is full."""


class Service:
    """A service that a node offers; made by `Node.create_service`."""

    def __init__(
        self,
        transport: Endpoint,
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
        if type(concurrency) is not int or concurrency < 1:  # saves most programs a call
            check_count(f"the concurrency of {name}", concurrency)
        check_callback(callback, f"the callback of {name}", ("a request", "a response"))
        self.srv_type = srv_type
        self.service_name = name
        self._callback = callback
        self._waiting: FairQueue[IncomingCall] = FairQueue()
        self._load = PlainService(
            callback=callback,
            response=srv_type.Response,
            concurrency=concurrency,
            waiting=self._waiting,
            returned=self._continue,
            raised=self._break_off,
            begin=self._begin,
            finished=self._finished,
            held=self._held_loop,
            holds_after=HOLDS_LOOP_AFTER,
        )
        """Its calls that run; connections run plain calls themselves."""
        self._jobs: dict[IncomingCall, tuple[asyncio.Future[Any], float]] = {}
        """The task or thread job of each call that has one, and when the call began."""
        self._durations: deque[float] = deque(maxlen=SAMPLED)
        """Seconds that the latest calls took, sampled while others wait."""
        self._loop = asyncio.get_running_loop()
        self._now = clock_of(self._loop)
        self._starter = EagerStarter(self._loop, self._held_loop)
        self._response = srv_type.Response
        self._destroyed = False
        self.finished: asyncio.Future[None] = self._loop.create_future()
        """Done once the service is destroyed and has answered its last call."""
        self._threads = threads_for(concurrency, name, threaded=threaded)
        self._warned = False
        """Whether the log has the warning about a callback that held the event loop."""
        self._transport = transport
        self._deduplicator = self._make_deduplicator(store)
        self._offer = self._offered(node, mode, join, observer, role)
        try:
            transport.offer(self._offer)
        except BaseException:
            self._close_deduplicator()
            raise

    def _make_deduplicator(self, store: CompletionStore | None) -> Deduplicator | None:
        if store is None:
            return None
        from taskrpc.core.exactly_once import Deduplicator  # few services need it

        codec = codec_of(self.srv_type.Response)
        return Deduplicator(store, codec, self._arrived)

    def _offered(
        self, node: str, mode: Mode, join: bool, observer: Observer | None, role: Role
    ) -> Offer:
        serve, store_id, deduplicator = self._arrived, None, self._deduplicator
        if deduplicator is not None:
            serve, store_id, mode = deduplicator.arrived, deduplicator.store_id, Mode.EXACTLY_ONCE
        name, srv_type = self.service_name, self.srv_type
        plain = self._load if self._threads is None else None
        if deduplicator is not None:
            if deduplicator.is_plain:
                self._load.once = deduplicator
            else:
                plain = None
        return Offer(name, srv_type, node, serve, mode, join, store_id, observer, role, plain)

    def _close_deduplicator(self) -> None:
        if self._deduplicator is not None:
            self._deduplicator.close()

    def destroy(self) -> None:
        """Stop offering the service; calls that have arrived are still answered."""
        self._transport.withdraw(self._offer)
        self._destroyed = True
        self._finish_if_idle()

    def observe(self, observer: Observer | None) -> None:
        """Report later calls to another observer."""
        if not self._destroyed:
            offer = msgspec.structs.replace(self._offer, observer=observer)
            self._transport.replace(self._offer, offer)
            self._offer = offer

    def status(self) -> ServiceStatus:
        """Return how many calls run and wait."""
        from taskrpc.core.observer import ServiceStatus  # few programs need it

        once = None if self._deduplicator is None else self._deduplicator.status()
        return ServiceStatus(self.service_name, self._load.running, self._waiting.count, once)

    def abandon(self) -> None:
        """Stop at once: waiting calls get ServiceUnavailable, running ones OutcomeUnknown."""
        self.destroy()
        while self._waiting.count:
            self._waiting.take().fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
        for call, (job, _) in list(self._jobs.items()):
            call.cancel()
            call.fail(OutcomeUnknown("the server was shut down while it ran this call"))
            # A thread continues to run, but the loop must not wait for it when it ends.
            job.cancel()
        self._finish_if_idle()

    # The steps of a call: it arrives, may wait, starts, runs on the loop, in a task or in a
    # thread, and is answered.

    def _arrived(self, call: IncomingCall) -> None:
        if self._destroyed:
            call.fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
        elif self._load.running < self._load.concurrency and not self._waiting.count:
            self._start(call)
        else:
            self._wait(call)

    def _wait(self, call: IncomingCall) -> None:
        flow = call.flow
        if self._waiting.count >= QUEUE_LIMIT:
            # The caller with the most waiting calls loses one, so a runaway loop hurts only itself.
            evicted = self._waiting.take_surplus(flow) or call
            evicted.on_cancel = None
            message = f"{self.service_name} has {QUEUE_LIMIT} calls waiting"
            evicted.fail(ServerBusy(message, retry_after=RETRY_AFTER))
            if evicted is call:
                return
        call.on_cancel = partial(self._leave_queue, flow, call)
        self._waiting.add(flow, call)

    def _start(self, call: IncomingCall) -> bool:
        """Run a call; return False if its deadline had passed already."""
        began = self._now()
        if call.deadline is not None and call.deadline <= began:
            problem = "the deadline passed before the call began"
            call.fail(DeadlineExceeded(problem, not_executed=True))
            return False
        call.started = True
        call.on_cancel = None
        self._load.running += 1
        if self._threads is not None:
            self._run_in_thread(self._threads, call, self._response(), began)
            return True
        token = answering.set(call)
        try:
            result = self._callback(call.request, self._response())
        except BaseException as error:
            self._break_off(call, error, began)
        else:
            self._continue(call, result, began)
        finally:
            answering.reset(token)
        return True

    def _continue(self, call: IncomingCall, result: Any, began: float) -> None:
        """Answer a call with the result of its callback, or await the result."""
        try:
            if result.__class__ is not self._response and hasattr(result, "__await__"):
                result, go_on = self._awaited(call, result)
            else:
                go_on = self._answer
            go_on(call, result, began)
        except BaseException as error:
            self._break_off(call, error, began)

    def _begin(self, call: Any, coroutine: Coroutine[Any, Any, Any]) -> tuple[Any, GoOn]:
        """Run the first step of a coroutine; see `PlainService.begin`."""
        result, has_ended = self._starter.begin(coroutine, call)
        return result, self._answer if has_ended else self._suspended

    def _answer(self, call: IncomingCall, response: Any, began: float) -> None:
        """Answer a call with what its coroutine has returned."""
        self._returned(call, response)
        self._end(call, began)

    def _break_off(self, call: IncomingCall, error: BaseException, began: float) -> None:
        """Answer a call whose callback has raised."""
        self._raised(call, error)
        if isinstance(error, SystemExit | KeyboardInterrupt):
            # Not raised here: uvloop swallows errors of a protocol, and the call would count as
            # running for ever, so that a drain would wait for it.
            self._loop.call_soon(end_program, error)
        self._end(call, began)

    def _end(self, call: IncomingCall, began: float) -> None:
        """Count a call as ended, unless its effect is not stored yet."""
        self._check_held(began)
        deduplicator = self._deduplicator
        if (
            deduplicator is not None
            and deduplicator.storing
            and self._waits_for_store(deduplicator, call, began)
        ):
            return
        self._load.running -= 1
        if self._waiting.count or self._destroyed:
            self._finished(began)

    def _check_held(self, began: float) -> None:
        if (held := self._now() - began) > HOLDS_LOOP_AFTER:
            self._held_loop(held)

    def _awaited(self, call: IncomingCall, result: Awaitable[Any]) -> tuple[Any, GoOn]:
        """Begin to await; return what came of it, and the function that takes both."""
        if isinstance(result, CoroutineType):
            return self._begin(call, result)
        if not isinstance(result, asyncio.Future) or result.get_loop() is not self._loop:
            return self._begin(call, as_coroutine(result))
        if result.done():
            return result.result(), self._answer
        return result, self._await_future

    def _await_future(self, call: IncomingCall, future: asyncio.Future[Any], began: float) -> None:
        """Answer a call at the end of the future that its callback has returned."""
        call.on_cancel = future.cancel
        self._await(future, call, began)
        self._check_held(began)

    def _suspended(self, call: IncomingCall, begun: Begun, began: float) -> None:
        """Answer a call at the end of its coroutine, which has suspended."""
        call.on_cancel = begun.task.cancel
        if self._deduplicator is None:
            begun.then(_AsyncCall(self, call))
            self._jobs[call] = begun.task, began
        else:  # the response is stored first, which would need another task
            self._await(begun.task, call, began)
        self._check_held(began)

    def _run_in_thread(
        self, threads: DaemonThreads, call: IncomingCall, response: Any, began: float
    ) -> None:
        token = answering.set(call)
        context = contextvars.copy_context()
        answering.reset(token)
        job = self._loop.run_in_executor(
            threads, lambda: context.run(run_to_end, self._callback, call.request, response)
        )
        self._await(job, call, began)

    def _await(self, job: asyncio.Future[Any], call: IncomingCall, began: float) -> None:
        self._jobs[call] = job, began
        job.add_done_callback(partial(self._job_done, call))

    def _job_returned(self, call: IncomingCall, response: Any) -> None:
        """Answer a call whose coroutine has returned, while its task still runs."""
        _, began = self._jobs.pop(call)
        call.on_cancel = None  # breaks a reference cycle: the job has the call in its context
        self._returned(call, response)
        self._load.running -= 1
        if self._waiting.count or self._destroyed:
            self._finished(began)

    def _job_done(self, call: IncomingCall, done: asyncio.Future[Any]) -> None:
        _, began = self._jobs.pop(call)
        call.on_cancel = None  # breaks a reference cycle: the job has the call in its context
        if done.cancelled():
            if call.cancelled:
                call.fail(TaskRpcError("cancelled by the caller"))
            else:
                self._raised(call, asyncio.CancelledError())
        elif (error := done.exception()) is not None:
            self._raised(call, error)
        else:
            self._returned(call, done.result())
        if self._deduplicator is None or not self._waits_for_store(self._deduplicator, call, began):
            self._stored(began)

    def _waits_for_store(
        self, deduplicator: Deduplicator, call: IncomingCall, began: float
    ) -> bool:
        """Whether the call counts as running until its effect is stored: later calls see it."""
        if call not in deduplicator.storing:
            return False
        deduplicator.storing[call] = partial(self._stored, began)
        return True

    def _stored(self, began: float) -> None:
        self._load.running -= 1
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
        except Exception as problem:  # a subclass may not have called HandlerError's __init__
            problem.__cause__ = error
            answer_unexpected(call, problem)
        else:
            call.fail(failed)

    def _finished(self, began: float) -> None:
        if self._waiting.count:
            self._durations.append(self._now() - began)
            # Not called directly: a chain of short calls would grow the stack and starve the loop.
            self._loop.call_soon(self._start_waiting)
        elif self._destroyed:
            self._finish_if_idle()

    def _start_waiting(self) -> None:
        while self._waiting.count and self._load.running < self._load.concurrency:
            call = self._waiting.take()
            if call.must_wait():
                self._postpone(call)
            elif self._is_too_late(call):
                problem = "too little time was left when the call could start"
                # Not DeadlineExceeded: the deadline has not passed yet.
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))
            elif self._start(call):
                return
        self._finish_if_idle()

    def _is_too_late(self, call: IncomingCall) -> bool:
        """Whether other calls wait, and this one has hardly time left for a fast execution.

        Without this, an overloaded service would start each call just before its deadline, and all
        responses would be late.
        """
        if call.deadline is None or not self._waiting.count or len(self._durations) < SAMPLED:
            return False
        return call.deadline - self._now() < 1.25 * min(self._durations) + TICK

    def _postpone(self, call: IncomingCall) -> None:
        """Postpone a call, and its caller's later ones, until there is room for the responses."""
        following = self._waiting.remove_all(call.flow, lambda each: each.must_wait())
        for each in (call, *following):
            each.postpone()

    def _leave_queue(self, flow: Hashable, call: IncomingCall) -> None:
        self._waiting.remove(flow, call)
        self._finish_if_idle()

    def _finish_if_idle(self) -> None:
        is_busy = self._load.running or self._waiting.count
        if self._destroyed and not is_busy and not self.finished.done():
            self.finished.set_result(None)
            self._starter.close()
            self._close_deduplicator()
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


class _AsyncCall(msgspec.Struct, eq=False):
    """A call whose coroutine has suspended."""

    service: Service
    call: IncomingCall

    def returned(self, value: object) -> None:
        """Answer: the coroutine has returned."""
        self.service._job_returned(self.call, value)

    def done(self, task: asyncio.Future[object]) -> None:
        """Answer: the task is done."""
        self.service._job_done(self.call, task)
