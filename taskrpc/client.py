"""Calls a service: with a deadline always, with retries where they are safe."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from enum import Enum
from typing import Any, Final

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
from taskrpc.transport.base import Mode, Transport, WaitingThread
from taskrpc.transport.codec import ServiceType
from taskrpc.transport.timers import clock_of

DEFAULT_TIMEOUT = 10.0


class Unset(Enum):
    """Says that an argument was not given, where None means something."""

    UNSET = "UNSET"

    def __repr__(self) -> str:
        return "UNSET"


UNSET: Final = Unset.UNSET


class Client:
    """Calls one service; made by `Node.create_client`.

    `timeout` (seconds, None for no deadline) and `retry` are the defaults of its calls. `forget`
    learns of its end.
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
        forget: Callable[[Client], object] = lambda _: None,
    ) -> None:
        self.srv_type = srv_type
        self.service_name = name
        self._timeout = _checked(timeout)
        self._retry = retry
        self._budget = RetryBudget()
        self._loop = asyncio.get_running_loop()
        self._now = clock_of(self._loop)
        self._forget = forget
        self._channel = transport.channel(name, srv_type, node)

    def service_is_ready(self) -> bool:
        """Whether somebody is known to offer the service."""
        return self._channel.offered

    async def wait_for_service(self, timeout: float | None = None) -> bool:
        """Wait until the service is there; False when it is not within `timeout` seconds."""
        deadline = None if timeout is None else self._loop.time() + timeout
        return await self._channel.wait(deadline)

    async def call(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
    ) -> Any:
        """Call the service; `await` yields the response.

        `timeout` is in seconds and covers everything: finding the service, waiting, retries.
        Nothing is sent before the call is awaited.

        Raises:
            ServiceUnavailable: nobody offers the service (with `retry`: until the deadline).
            DeadlineExceeded: no answer in time; the server was told that nobody waits.
            InvalidRequest: a value does not fit its field.
            TypeMismatch, ServerBusy, HandlerFailed, OutcomeUnknown, …: see `taskrpc.errors`.
        """
        deadline = self._deadline(timeout)
        policy = self._retry if retry is UNSET else retry
        call = None if policy is not None else self._channel.send(request, deadline)
        if call is None:
            return await self._persist(request, deadline, policy)
        try:  # as in `_once`: one more coroutine would cost a tenth of the call
            return await call.future
        except asyncio.CancelledError:
            call.give_up()
            raise

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
        policy = self._retry if retry is UNSET else retry
        try:
            call = None if policy is not None else self._channel.send(request, deadline)
        except InvalidRequest as error:
            failed = self._loop.create_future()
            failed.set_exception(error)
            return failed
        if call is None:
            return self._loop.create_task(self._persist(request, deadline, policy))
        call.future.add_done_callback(call.give_up)
        return call.future

    def _send_in_thread(
        self,
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
    ) -> WaitingThread | None:
        """Send the request from a thread that is not the loop's, where that can be done at once.

        For the blocking front-end: in all other cases it returns None, and the loop must call.
        """
        span = self._timeout if timeout is UNSET else _checked(timeout)
        policy = self._retry if retry is UNSET else retry
        if policy is not None or self._now is not time.monotonic:  # another clock is the loop's own
            return None
        deadline = None if span is None else self._now() + span
        return self._channel.send_in_thread(request, deadline)

    def destroy(self) -> None:
        """Forget the service; calls in flight still get their answers."""
        self._channel.close()
        self._forget(self)

    async def _persist(
        self, request: Any, deadline: float | None, policy: RetryPolicy | None
    ) -> Any:
        """Call until there is an answer, or an error that another attempt would not mend."""
        attempt = 0
        while True:
            attempt += 1
            try:
                await self._find(deadline, policy)
                response = await self._once(request, deadline)
            except TaskRpcError as error:
                wait = self._wait_before_retry(error, attempt, deadline, policy)
                if wait is None:
                    raise
                await asyncio.sleep(wait)
            else:
                self._budget.earn()
                return response

    async def _once(self, request: Any, deadline: float | None) -> Any:
        call = self._channel.send(request, deadline)
        assert call is not None, "the channel was connected in this very turn"
        try:
            return await call.future
        except asyncio.CancelledError:
            call.give_up()
            raise

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
        now = self._now()
        import random  # a failure can wait a millisecond, a server's start should not

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
        span = self._timeout if timeout is UNSET else _checked(timeout)
        return None if span is None else self._now() + span

    def _is_over(self, deadline: float | None) -> bool:
        return deadline is not None and deadline <= self._now()


def _checked(timeout: float | None) -> float | None:
    if timeout is None:
        return None
    try:
        finite = math.isfinite(timeout)
    except TypeError:
        finite = False
    if not finite:
        raise ValueError(f"timeout: expected seconds, or None for no deadline, got {timeout!r}")
    return timeout


def _asks_for_retry(error: TaskRpcError) -> bool:
    return isinstance(error, HandlerFailed) and error.code is Code.UNAVAILABLE
