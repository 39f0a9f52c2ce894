"""Runs a service's callback: one call at a time unless told otherwise, in order of arrival."""

from __future__ import annotations

import asyncio
import contextvars
import inspect
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias

from taskrpc.callinfo import answering
from taskrpc.errors import HandlerError, InvalidRequest, ServerBusy, TaskRpcError
from taskrpc.transport.base import IncomingCall, Mode, Offer, Transport
from taskrpc.transport.codec import ServiceType
from taskrpc.transport.serving import answer_unexpected

log = logging.getLogger("taskrpc.server")

Callback: TypeAlias = Callable[[Any, Any], Any] | Callable[[Any, Any], Awaitable[Any]]
"""`callback(request, response)`, plain or async; returns the response."""

QUEUE_LIMIT = 1024
"""Calls that wait for their turn; more are refused as ServerBusy."""

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
        callback: Callback,
        *,
        concurrency: int = 1,
        threaded: bool = False,
        mode: Mode = Mode.AT_MOST_ONCE,
        join: bool = False,
    ) -> None:
        if concurrency < 1:
            raise ValueError(f"concurrency: expected at least 1, got {concurrency}")
        self.srv_type = srv_type
        self.service_name = name
        self._callback = callback
        self._concurrency = concurrency
        self._running = 0
        self._waiting: deque[IncomingCall] = deque()
        self._tasks: set[asyncio.Future[Any]] = set()
        self._loop = asyncio.get_running_loop()
        self._threads = _threads(name, concurrency) if threaded else None
        self._warned = False
        self._transport = transport
        self._offer = Offer(name, srv_type, node, self._arrived, mode, join)
        transport.offer(self._offer)

    def destroy(self) -> None:
        """Stop offering the service; calls that run are still answered."""
        self._transport.withdraw(self._offer)
        if self._threads is not None:
            self._threads.shutdown(wait=False)

    # A call's way: arrived, (waits), started, run here, in a task or in a thread, answered.

    def _arrived(self, call: IncomingCall) -> None:
        if self._running < self._concurrency and not self._waiting:
            self._start(call)
        elif len(self._waiting) < QUEUE_LIMIT:
            self._waiting.append(call)
        else:
            message = f"{self.service_name} has {QUEUE_LIMIT} calls waiting"
            call.fail(ServerBusy(message, retry_after=RETRY_AFTER))

    def _start(self, call: IncomingCall) -> None:
        call.started = True
        self._running += 1
        response = self.srv_type.Response()
        if self._threads is not None:
            self._run_in_thread(self._threads, call, response)
            return
        token = answering.set(call)
        began = self._loop.time()
        try:
            result = self._callback(call.request, response)
            if inspect.iscoroutine(result):
                self._run_in_task(call, result)
                return
        except Exception as error:
            self._raised(call, error)
        else:
            self._returned(call, result)
        finally:
            answering.reset(token)
            if self._loop.time() - began > HOLDS_LOOP_AFTER:
                self._warn_slow(self._loop.time() - began)
        self._finished()

    def _run_in_task(self, call: IncomingCall, coroutine: Coroutine[Any, Any, Any]) -> None:
        task = self._loop.create_task(coroutine)
        self._tasks.add(task)
        call.on_cancel = task.cancel
        task.add_done_callback(lambda done: self._task_done(call, done))

    def _run_in_thread(
        self, threads: ThreadPoolExecutor, call: IncomingCall, response: Any
    ) -> None:
        token = answering.set(call)
        context = contextvars.copy_context()
        answering.reset(token)
        job = self._loop.run_in_executor(
            threads, lambda: context.run(_run_to_end, self._callback, call.request, response)
        )
        self._tasks.add(job)
        job.add_done_callback(lambda done: self._task_done(call, done))

    def _task_done(self, call: IncomingCall, done: asyncio.Future[Any]) -> None:
        self._tasks.discard(done)
        if done.cancelled():
            call.fail(TaskRpcError("the handler was cancelled"))
        elif (error := done.exception()) is not None:
            self._raised(call, error)
        else:
            self._returned(call, done.result())
        self._finished()

    def _returned(self, call: IncomingCall, response: Any) -> None:
        if response is None:
            name = getattr(self._callback, "__qualname__", "the callback")
            problem = f"{name} returned None; a service callback must `return response`"
            answer_unexpected(call, TypeError(problem))
            return
        try:
            call.reply(response)
        except InvalidRequest as error:
            answer_unexpected(call, ValueError(f"the response cannot be sent: {error}"))

    def _raised(self, call: IncomingCall, error: BaseException) -> None:
        if isinstance(error, HandlerError):
            call.fail(error)
        else:
            answer_unexpected(call, error)

    def _finished(self) -> None:
        self._running -= 1
        if self._waiting:
            # Not from here: a chain of short calls would grow the stack and starve the loop.
            self._loop.call_soon(self._start_waiting)

    def _start_waiting(self) -> None:
        while self._waiting and self._running < self._concurrency:
            call = self._waiting.popleft()
            if not call.cancelled:
                self._start(call)
                return

    def _warn_slow(self, seconds: float) -> None:
        if not self._warned:
            self._warned = True
            log.warning(
                "the callback of %s held the event loop for %.2f s, so that nothing else ran;"
                " create the service with threaded=True, or make the callback async",
                self.service_name,
                seconds,
            )


def _threads(name: str, concurrency: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(concurrency, thread_name_prefix=f"taskrpc {name}")


def _run_to_end(callback: Callback, request: Any, response: Any) -> Any:
    result = callback(request, response)
    return asyncio.run(result) if inspect.iscoroutine(result) else result
