"""One call until its response: find the service, send the request, and retry where that is safe.

A retry is safe if the request certainly did not run, if the service is idempotent, or if it is
exactly-once: then the request keeps its request id and its store in every attempt. After an attempt
that may have run, the call is in doubt. From then on only a response, or the same store, can say
that the request did not run.

A policy may limit each attempt. The deadline of an attempt ends it at an idempotent server. An
exactly-once request goes on at the server: the next attempt attaches to it, and only then the
client cancels the earlier one. Otherwise a handler that needs longer than one attempt would begin
again and again.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from typing import Any

import msgspec

from taskrpc.core.request_ids.ids import RequestCounter, RequestId, named_request_id
from taskrpc.core.transport.base import Mode
from taskrpc.core.transport.chance import present_chance
from taskrpc.core.transport.channel import RemoteChannel
from taskrpc.core.transport.connection.client_side import OpenCall
from taskrpc.core.transport.time_of_day import time_of_day
from taskrpc.errors import (
    Code,
    ConnectionLost,
    DeadlineExceeded,
    HandlerFailed,
    InvalidRequest,
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    SessionExpired,
    TaskRpcError,
)
from taskrpc.retry import RetryBudget, RetryPolicy

FREE_RETRIES = 8
"""Retries of one exactly-once request after lost connections that take nothing from the retry
budget: a restarted server must get back all calls in flight at once, not three a second."""

_UNTIL_THE_DEADLINE = RetryPolicy()


class Attempts(msgspec.Struct, eq=False):
    """The attempts of one call; await `result()` once."""

    channel: RemoteChannel
    request: Any
    deadline: float | None
    """Instant on the loop's clock, None for none."""
    policy: RetryPolicy | None
    """None: one attempt; for an exactly-once service, retries after lost connections."""
    budget: RetryBudget
    now: Callable[[], float]
    """The loop's clock."""
    name: str = ""
    """The caller's own request id, "" for none."""
    _only_lost_connections: bool = False
    """Whether to retry only after lost connections: the caller gave no retry policy."""
    _made: int = 0
    """The number of attempts, including the present one."""
    _in_doubt: bool = False
    """Whether an earlier attempt may have run."""
    _in_doubt_since: tuple[float, float] = (0.0, 0.0)
    """When that attempt ended: the time of day, and the loop's time."""
    _has_ended: bool = False
    """Whether no retry can be safe any more."""
    _has_new_client: bool = False
    """Whether the call has replaced a client id that the server had forgotten."""
    _counter: RequestCounter | None = None
    """The counter of the present sequence number, until it is settled."""
    _sequence: int = 0
    _store_id: bytes = b""
    """The store for which the request id is valid, b"" before there is one."""
    _sent: OpenCall | None = None
    """The present attempt, if the channel sent it as soon as it was connected."""
    _late: OpenCall | None = None
    """The last attempt of an exactly-once request that timed out, until the next one is sent."""

    def begin(self) -> None:
        """Send the request; the channel calls this as soon as it is connected."""
        with contextlib.suppress(Exception):  # `result` sends again and raises the error
            self._sent = self._send()

    async def result(self, call: OpenCall | None = None) -> Any:
        """Return the response; raise the errors of `Client.call`.

        `call` is a first attempt that the caller has sent, with the next request id.
        """
        if call is not None and call.counter is not None:
            self._use(call.counter.store_id, call.counter, call.sequence)
        try:
            while True:
                self._made += 1
                try:
                    if call is None:
                        if self._sent is None and not self.channel.ready:
                            await self._wait_for_connection()
                        call, self._sent = self._sent, None
                    if call is None:
                        call = self._send()
                        assert call is not None, "the channel is connected, and nothing was awaited"
                    policy = self.policy
                    is_limited = policy is not None and policy.attempt_timeout is not None
                    response = await (self._response(call) if is_limited else call.future)
                except asyncio.CancelledError:
                    if (sent := call or self._sent) is not None:
                        self._cancel(sent)
                    raise
                except TaskRpcError as error:
                    wait = self._wait_after(error)
                    if wait is None:
                        raise self._final(error) from None
                    call = None
                    await asyncio.sleep(wait)
                else:
                    self.budget.earn()
                    return response
        finally:
            if self._late is not None:
                self._forget_late()
            self._settle()

    def _send(self) -> OpenCall | None:
        """Send an attempt; None if the channel is not connected."""
        request_id, deadline, policy = self._request_id(), self.deadline, self.policy
        if request_id is None and policy is not None and policy.attempt_timeout is not None:
            deadline = policy.attempt_ends(self.now(), deadline)
        return self.channel.send(self.request, deadline, request_id)

    # The timeout of an attempt of an exactly-once request

    async def _response(self, call: OpenCall) -> Any:
        """Await the response of an attempt. Raises DeadlineExceeded when the attempt times out."""
        assert self.policy is not None, "it limits the attempt"
        self._forget_late()
        end = self.policy.attempt_ends(self.now(), self.deadline)
        if not self._store_id or end is None or end == self.deadline:
            return await call.future
        await asyncio.wait((call.future,), timeout=end - self.now())
        if call.future.done():
            return call.future.result()
        self._late = call
        raise DeadlineExceeded("no response by the deadline")

    def _forget_late(self) -> None:
        """Cancel an earlier attempt: the present one has its request id, or the call is over."""
        if (late := self._late) is not None:
            self._late = None
            if not late.future.done():
                self._cancel(late)
            else:  # the present attempt gets the same outcome from the server
                late.future.exception()  # otherwise asyncio reports it as never retrieved

    def _cancel(self, call: OpenCall) -> None:
        self._sent = None
        call.future.cancel()
        call.cancel()

    async def _wait_for_connection(self) -> None:
        self.channel.begin_when_connected(self)
        try:
            await self._connect()
        except TaskRpcError:
            if self._sent is None:  # otherwise the connection was lost after the request was sent
                raise
        finally:
            self.channel.forget_waiting(self)

    async def _connect(self) -> None:
        deadline = self.deadline
        if deadline is not None and deadline <= self.now():
            problem = "the deadline had passed before the call began"
            raise DeadlineExceeded(problem, not_executed=True)
        try:
            await self.channel.connect(deadline)
        except ServiceUnavailable:
            # Waiting for a server is not an attempt: with a policy a call waits until its deadline.
            if self.policy is None or not await self.channel.wait(deadline):
                raise

    # The id of a request to an exactly-once service

    def _request_id(self) -> RequestId | None:
        channel = self.channel
        if channel.mode is not Mode.EXACTLY_ONCE:
            if self._store_id and self._in_doubt:
                self._end_in_doubt("the server that offers the service now is not exactly-once")
            if self.name:
                problem = "a request id was given, but the service is not exactly-once"
                raise InvalidRequest("", problem)
            if channel.mode is not Mode.IDEMPOTENT:
                policy = self.policy
                if self._in_doubt:
                    self._end_in_doubt("the server that offers the service now is not idempotent")
                if policy is not None and policy.attempt_timeout is not None:
                    raise InvalidRequest("", _unsafe(channel.service_name))
            return None
        if self._store_id and self._in_doubt and self._is_too_old():
            self._end_in_doubt("the request is so old that the server may have forgotten it")
        if self._store_id != channel.store_id:
            if self._store_id and self._in_doubt:
                self._end_in_doubt("the server that offers the service now has another store")
            self._take_sequence(channel)
        if self.name:
            return named_request_id(channel.service_name, self.name)
        assert self._counter is not None, "taken above"
        return self._counter.request_id(self._sequence)

    def _take_sequence(self, channel: RemoteChannel) -> None:
        self._settle()
        counter, sequence = None, 0
        if not self.name:
            counter = channel.counter()
            sequence = counter.take()
        self._use(channel.store_id, counter, sequence)

    def _use(self, store_id: bytes, counter: RequestCounter | None, sequence: int) -> None:
        """Use this sequence number in the following attempts."""
        if self.policy is None:
            self.policy, self._only_lost_connections = _UNTIL_THE_DEADLINE, True
        self._store_id, self._counter, self._sequence = store_id, counter, sequence

    def _settle(self) -> None:
        if self._counter is not None:
            self._counter.settle(self._sequence)
            self._counter = None

    def _is_too_old(self) -> bool:
        """Whether the server may have forgotten a request that is in doubt."""
        from taskrpc.core.request_ids.ledger import REPEATED_FOR  # few requests are ever in doubt

        return self._seconds_in_doubt() > REPEATED_FOR

    def _seconds_in_doubt(self) -> float:
        """Seconds since the first attempt whose outcome is unknown, by the clock that shows more.

        The time of day may be set back. The loop's clock may stand still while a laptop sleeps.
        """
        day, loop = self._in_doubt_since
        return max(time_of_day() - day, self.now() - loop)

    def _end_in_doubt(self, problem: str) -> None:
        self._has_ended = True
        raise OutcomeUnknown(f"{problem}; an earlier attempt of the call may have run")

    # Errors: retry or not, and which error the caller gets

    def _wait_after(self, error: TaskRpcError) -> float | None:
        """Return the seconds until the next attempt, None if there must be none."""
        if isinstance(error, SessionExpired) and self._replace_client():
            return 0.0
        if error.not_executed is not True and not self._in_doubt:
            self._in_doubt, self._in_doubt_since = True, (time_of_day(), self.now())
        policy = self.policy
        if policy is None or not policy.allows(self._made + 1) or not self._may_repeat(error):
            return None
        # The first retry waits wait_initial.
        wait = policy.wait(self._made - 1, present_chance().random())
        if isinstance(error, ServerBusy):
            wait = max(wait, error.retry_after)
        now, latest = self.now(), math.inf if self.deadline is None else self.deadline
        if self._store_id and isinstance(error, ConnectionLost) and self._made <= FREE_RETRIES:
            return wait if now + wait < latest else None
        return self.budget.book(now, wait, latest)

    def _replace_client(self) -> bool:
        """Take a new client id if the server forgot this one; False if the request may have run."""
        if self._in_doubt or self._counter is None or self._has_new_client:
            return False
        self._has_new_client = True
        self._counter.is_retired = True
        self._store_id = b""  # the next attempt takes a new sequence number and settles this one
        return True

    def _may_repeat(self, error: TaskRpcError) -> bool:
        if self._has_ended:
            return False
        if self._only_lost_connections:
            # ServiceUnavailable too: another server may offer the service by now.
            return isinstance(error, ServiceUnavailable | ConnectionLost)
        if (
            isinstance(error, ServerBusy | ConnectionLost)
            or _invites_retry(error)
            or (isinstance(error, DeadlineExceeded) and _limit(self.policy) is not None)
        ):
            is_safe = bool(self._store_id) or self.channel.mode is Mode.IDEMPOTENT
            return error.not_executed is True or is_safe
        return isinstance(error, ServiceUnavailable)

    def _final(self, error: TaskRpcError) -> TaskRpcError:
        """Return the error for the caller: if not the last attempt, an earlier one may have run."""
        is_no_answer = error.not_executed is True or isinstance(error, SessionExpired)
        seconds = _limit(self.policy)
        if isinstance(error, DeadlineExceeded) and self._made > 1 and seconds is not None:
            problem = f"{self._made} attempts of at most {seconds:g} s, the last: {error}"
            certainly = None if self._in_doubt else error.not_executed
            return DeadlineExceeded(problem, not_executed=certainly)
        if not self._in_doubt or not is_no_answer:
            return error
        if isinstance(error, DeadlineExceeded):
            return DeadlineExceeded("no response by the deadline")
        return OutcomeUnknown(f"{error}; an earlier attempt of the call may have run")


def _invites_retry(error: TaskRpcError) -> bool:
    return isinstance(error, HandlerFailed) and error.code is Code.UNAVAILABLE


def _limit(policy: RetryPolicy | None) -> float | None:
    return None if policy is None else policy.attempt_timeout


def _unsafe(service: str) -> str:
    return (
        f"attempt_timeout: expected an idempotent or exactly-once service, but {service} is"
        " neither: an attempt that timed out may still run, and the next one would run it twice."
        " Use timeout alone, or create the service with idempotent=True or exactly_once=store"
    )
