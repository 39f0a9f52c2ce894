"""Calls a service: with a deadline always, with retries where they are safe."""

from __future__ import annotations

import asyncio
import math
import random
import sys
import warnings
from collections.abc import Coroutine, Generator
from types import CodeType, TracebackType
from typing import Any

from taskrpc.errors import (
    Code,
    ConnectionLost,
    DeadlineExceeded,
    HandlerFailed,
    InvalidRequest,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.retry import RetryBudget, RetryPolicy
from taskrpc.transport.base import Mode, Transport
from taskrpc.transport.codec import ServiceType

DEFAULT_TIMEOUT = 10.0


class Unset:
    """Says that an argument was not given, where None means something."""

    def __repr__(self) -> str:
        return "UNSET"


UNSET = Unset()


class Client:
    """Calls one service; made by `Node.create_client`.

    `timeout` (seconds, None for no deadline) and `retry` are the defaults of its calls.
    """

    def __init__(
        self,
        transport: Transport,
        srv_type: ServiceType,
        name: str,
        node: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
    ) -> None:
        self.srv_type = srv_type
        self.service_name = name
        self._timeout = timeout
        self._retry = retry
        self._budget = RetryBudget()
        self._loop = asyncio.get_running_loop()
        self._channel = transport.channel(name, srv_type, node)

    def service_is_ready(self) -> bool:
        """Whether somebody is known to offer the service."""
        return self._channel.offered

    async def wait_for_service(self, timeout: float | None = None) -> bool:
        """Wait until the service is there; False when it is not within `timeout` seconds."""
        deadline = None if timeout is None else self._loop.time() + timeout
        return await self._channel.wait(deadline)

    def call(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
    ) -> Call:
        """Call the service; `await` yields the response.

        `timeout` is in seconds and covers everything: finding the service, waiting, retries.
        Nothing is sent before the call is awaited; one that never is is reported.

        Raises:
            ServiceUnavailable: nobody offers the service (with `retry`: until the deadline).
            DeadlineExceeded: no answer in time; the server was told that nobody waits.
            InvalidRequest: a value does not fit its field.
            TypeMismatch, ServerBusy, HandlerFailed, OutcomeUnknown, …: see `taskrpc.errors`.
        """
        return Call(self, request, timeout, retry)

    def call_async(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
    ) -> asyncio.Future[Any]:
        """Send the request now; returns a future of the response, with the errors of `call`.

        Cancelling the future cancels the call.
        """
        deadline = self._deadline(timeout)
        policy = self._policy(retry)
        if policy is None and self._channel.ready and not self._is_over(deadline):
            return self._sent(request, deadline)
        return self._loop.create_task(self._persist(request, deadline, policy))

    def destroy(self) -> None:
        """Forget the service; calls in flight still get their answers."""
        self._channel.close()

    def start(
        self,
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
    ) -> Generator[Any, None, Any]:
        """What `await call(...)` runs."""
        deadline = self._deadline(timeout)
        policy = self._policy(retry)
        if policy is None and self._channel.ready and not self._is_over(deadline):
            # Straight to the future: a coroutine in between would cost a tenth of the call.
            return self._channel.send(request, deadline).__await__()
        return self._persist(request, deadline, policy).__await__()

    def _sent(self, request: Any, deadline: float | None) -> asyncio.Future[Any]:
        try:
            return self._channel.send(request, deadline)
        except InvalidRequest as error:
            failed = self._loop.create_future()
            failed.set_exception(error)
            return failed

    async def _persist(
        self, request: Any, deadline: float | None, policy: RetryPolicy | None
    ) -> Any:
        """Call until there is an answer, or an error that another attempt would not mend."""
        attempt = 0
        while True:
            attempt += 1
            try:
                await self._find(deadline, policy)
                response = await self._channel.send(request, deadline)
            except TaskRpcError as error:
                wait = self._wait_before_retry(error, attempt, deadline, policy)
                if wait is None:
                    raise
                await asyncio.sleep(wait)
            else:
                self._budget.earn()
                return response

    async def _find(self, deadline: float | None, policy: RetryPolicy | None) -> None:
        if self._is_over(deadline):
            problem = "the deadline had passed before the call began"
            raise DeadlineExceeded(problem, not_executed=True)
        try:
            await self._channel.connect(deadline)
        except ServiceUnavailable:
            # Waiting for a server is no attempt: with a policy a call waits as long as it may.
            if policy is None or not await self._channel.wait(deadline):
                raise

    def _wait_before_retry(
        self,
        error: TaskRpcError,
        attempt: int,
        deadline: float | None,
        policy: RetryPolicy | None,
    ) -> float | None:
        if policy is None or not policy.allows(attempt + 1) or not self._may_repeat(error):
            return None
        now = self._loop.time()
        # Counted from the second wait on: the first retry waits wait_initial.
        wait = policy.wait(attempt - 1, random.random())
        if isinstance(error, ServerBusy):
            wait = max(wait, error.retry_after)
        latest = math.inf if deadline is None else deadline
        return self._budget.book(now, wait, latest)

    def _may_repeat(self, error: TaskRpcError) -> bool:
        if isinstance(error, ServerBusy | ConnectionLost) or _asks_for_retry(error):
            return error.not_executed is True or self._channel.mode is Mode.IDEMPOTENT
        return isinstance(error, ServiceUnavailable)

    def _deadline(self, timeout: float | Unset | None) -> float | None:
        span = self._timeout if isinstance(timeout, Unset) else timeout
        return None if span is None else self._loop.time() + _checked(span)

    def _policy(self, retry: RetryPolicy | Unset | None) -> RetryPolicy | None:
        return self._retry if isinstance(retry, Unset) else retry

    def _is_over(self, deadline: float | None) -> bool:
        return deadline is not None and deadline <= self._loop.time()


class Call(Coroutine[Any, Any, Any]):
    """A call that runs when it is awaited; it can stand wherever a coroutine can."""

    __slots__ = ("_awaited", "_client", "_code", "_generator", "_options", "_position", "_request")

    def __init__(
        self,
        client: Client,
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
    ) -> None:
        self._client = client
        self._request = request
        self._options = timeout, retry
        self._awaited = False
        self._generator: Generator[Any, Any, Any] | None = None
        frame = sys._getframe(2)
        self._code, self._position = frame.f_code, frame.f_lasti

    def __await__(self) -> Generator[Any, None, Any]:
        if self._awaited:
            raise RuntimeError("a call can be awaited only once; make a new one")
        self._awaited = True
        return self._client.start(self._request, *self._options)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"a call has no {name!r}; `await` it first, its response may have one")

    def send(self, value: Any) -> Any:
        """Step the call, as the event loop does with coroutines."""
        return self._steps().send(value)

    def throw(
        self,
        typ: Any,
        val: Any = None,
        tb: TracebackType | None = None,
    ) -> Any:
        """Raise an error inside the call, as the event loop does to cancel."""
        self._awaited = True
        return self._steps().throw(typ if val is None else val)

    def close(self) -> None:
        """Drop the call."""
        self._awaited = True
        if self._generator is not None:
            self._generator.close()

    def _steps(self) -> Generator[Any, Any, Any]:
        if self._generator is None:
            self._generator = _generator(self)
        return self._generator

    def __del__(self) -> None:
        if not self._awaited:
            where = f"{self._code.co_filename}:{_line(self._code, self._position)}"
            message = f"a call of {self._client.service_name} was never awaited, made at {where}"
            warnings.warn(message, RuntimeWarning, stacklevel=2, source=self)


def _checked(timeout: float) -> float:
    try:
        finite = math.isfinite(timeout)
    except TypeError:
        finite = False
    if not finite:
        raise ValueError(f"timeout: expected seconds, or None for no deadline, got {timeout!r}")
    return timeout


def _generator(call: Call) -> Generator[Any, Any, Any]:
    return (yield from call.__await__())


def _line(code: CodeType, position: int) -> int:
    # Found only when it must be told: asking the frame at each call would cost more than the call.
    for start, end, line in code.co_lines():
        if start <= position < end and line is not None:
            return line
    return code.co_firstlineno


def _asks_for_retry(error: TaskRpcError) -> bool:
    return isinstance(error, HandlerFailed) and error.code is Code.UNAVAILABLE
