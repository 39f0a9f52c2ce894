"""One call until its answer: found, sent, and sent again where that is safe.

Safe is what certainly did not run, what the server declared idempotent, and what it runs exactly
once: such a request keeps its number and its store through every sending. Whoever was sent
something that may have run is in doubt; from then on only an answer, or the same store's word, may
say that it did not.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from typing import Any

import msgspec

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
from taskrpc.request_ids.ids import Number, Numbers, number_of_id
from taskrpc.retry import RetryBudget, RetryPolicy
from taskrpc.transport.base import Channel, Mode, SentCall

FREE_SENDINGS = 8
"""Sendings of one exactly-once request over new connections that take nothing from the budget: a
server that was restarted must get back all that was in flight, not three calls a second."""

_UNTIL_THE_DEADLINE = RetryPolicy()


class Attempts(msgspec.Struct, eq=False):
    """The sendings of one call; await `result()` once."""

    channel: Channel
    request: Any
    deadline: float | None
    """Instant on the loop's clock, None for none."""
    policy: RetryPolicy | None
    """None: send once; what is exactly-once, again while connections are lost."""
    budget: RetryBudget
    now: Callable[[], float]
    """The loop's clock."""
    request_id: str = ""
    """The user's own name for the request, "" for none."""
    _only_what_is_lost: bool = False
    _made: int = 0
    _in_doubt: bool = False
    _in_doubt_since: tuple[float, float] = (0.0, 0.0)
    """The time of day, and the loop's time."""
    _is_over: bool = False
    _counts_anew: bool = False
    _numbers: Numbers | None = None
    _sequence: int = 0
    _store: bytes = b""
    _first: SentCall | None = None
    """The first sending, where the channel made it while the call waited for the connection."""

    def begin(self) -> None:
        """Send the request; the channel calls this at the moment in which it is connected."""
        with contextlib.suppress(Exception):  # `result` meets the same error, and raises it
            self._first = self.channel.send(self.request, self.deadline, self._number())

    async def result(self, call: SentCall | None = None) -> Any:
        """The response; raises what `Client.call` tells.

        `call` is a first sending by `Channel.send_next`.
        """
        if call is not None and call.numbers is not None:
            self._counted(call.numbers.store_id, call.numbers, call.sequence)
        try:
            while True:
                self._made += 1
                try:
                    if call is None:
                        if self._first is None and not self.channel.ready:
                            await self._find()
                        call, self._first = self._first, None
                    if call is None:
                        call = self.channel.send(self.request, self.deadline, self._number())
                        assert call is not None, "the channel was connected in this very turn"
                    response = await call.future
                except asyncio.CancelledError:
                    if (sent := call or self._first) is not None:
                        self._cancel(sent)
                    raise
                except TaskRpcError as error:
                    wait = self._wait_after(error)
                    if wait is None:
                        raise self._verdict(error) from None
                    call = None
                    await asyncio.sleep(wait)
                else:
                    self.budget.earn()
                    return response
        finally:
            self._settle()

    def _cancel(self, call: SentCall) -> None:
        self._first = None
        call.future.cancel()
        call.give_up()

    async def _find(self) -> None:
        self.channel.line_up(self)
        try:
            await self._connect()
        except TaskRpcError:
            if self._first is None:  # otherwise the connection was lost after the request was sent
                raise
        finally:
            self.channel.leave_line(self)

    async def _connect(self) -> None:
        deadline = self.deadline
        if deadline is not None and deadline <= self.now():
            problem = "the deadline had passed before the call began"
            raise DeadlineExceeded(problem, not_executed=True)
        try:
            await self.channel.connect(deadline)
        except ServiceUnavailable:
            # Waiting for a server is no attempt: with a policy a call waits as long as it may.
            if self.policy is None or not await self.channel.wait(deadline):
                raise

    # The number of a request to an exactly-once service

    def _number(self) -> Number | None:
        channel = self.channel
        if channel.mode is not Mode.EXACTLY_ONCE:
            if self._store and self._in_doubt:
                self._give_up("the service that answers now is not exactly-once any more")
            if self.request_id:
                problem = "a request id was given, but the service is not exactly-once"
                raise InvalidRequest("", problem)
            return None
        if self._store and self._in_doubt and self._is_too_old():
            self._give_up("the server may have forgotten the request, which was sent long ago")
        if self._store != channel.store_id:
            if self._store and self._in_doubt:
                self._give_up("the server that answers now has another store")
            self._count(channel)
        if self.request_id:
            return number_of_id(channel.service_name, self.request_id)
        assert self._numbers is not None, "counted above"
        return self._numbers.number(self._sequence)

    def _count(self, channel: Channel) -> None:
        self._settle()
        numbers, sequence = None, 0
        if not self.request_id:
            numbers = channel.numbers()
            sequence = numbers.take()
        self._counted(channel.store_id, numbers, sequence)

    def _counted(self, store_id: bytes, numbers: Numbers | None, sequence: int) -> None:
        if self.policy is None:
            self.policy, self._only_what_is_lost = _UNTIL_THE_DEADLINE, True
        self._store, self._numbers, self._sequence = store_id, numbers, sequence

    def _settle(self) -> None:
        if self._numbers is not None:
            self._numbers.settle(self._sequence)
            self._numbers = None

    def _is_too_old(self) -> bool:
        """Whether the server may have forgotten a request that is in doubt."""
        from taskrpc.request_ids.ledger import REPEATED_FOR  # few requests are ever in doubt

        return self._doubted_for() > REPEATED_FOR

    def _doubted_for(self) -> float:
        """Seconds since the first attempt whose outcome is unknown, by the clock that says more.

        The time of day may be set back, and the loop's clock may stand still while a laptop sleeps.
        """
        day, loop = self._in_doubt_since
        return max(time.time() - day, self.now() - loop)

    def _give_up(self, problem: str) -> None:
        self._is_over = True
        raise OutcomeUnknown(f"{problem}; the one that was asked before may have run the call")

    # What an error means

    def _wait_after(self, error: TaskRpcError) -> float | None:
        """Seconds until the next attempt; None where there is none."""
        if isinstance(error, SessionExpired) and self._may_count_anew():
            return 0.0
        if error.not_executed is not True and not self._in_doubt:
            self._in_doubt, self._in_doubt_since = True, (time.time(), self.now())
        policy = self.policy
        if policy is None or not policy.allows(self._made + 1) or not self._may_repeat(error):
            return None
        import random  # a failure can wait a millisecond, a program's start should not

        # Counted from the second wait on: the first retry waits wait_initial.
        wait = policy.wait(self._made - 1, random.random())
        if isinstance(error, ServerBusy):
            wait = max(wait, error.retry_after)
        now, latest = self.now(), math.inf if self.deadline is None else self.deadline
        if self._store and isinstance(error, ConnectionLost) and self._made <= FREE_SENDINGS:
            return wait if now + wait < latest else None
        return self.budget.book(now, wait, latest)

    def _may_count_anew(self) -> bool:
        """Whether a server that forgot us was asked for the first time: then nothing has run."""
        if self._in_doubt or self._numbers is None or self._counts_anew:
            return False
        self._counts_anew = True
        self._numbers.is_over = True
        self._store = b""  # so the next attempt gets a new sequence number, and this one is settled
        return True

    def _may_repeat(self, error: TaskRpcError) -> bool:
        if self._is_over:
            return False
        if self._only_what_is_lost:
            # The service may have another server by now, as a plain call would find out too.
            return isinstance(error, ServiceUnavailable | ConnectionLost)
        if isinstance(error, ServerBusy | ConnectionLost) or _asks_for_retry(error):
            is_safe = bool(self._store) or self.channel.mode is Mode.IDEMPOTENT
            return error.not_executed is True or is_safe
        return isinstance(error, ServiceUnavailable)

    def _verdict(self, error: TaskRpcError) -> TaskRpcError:
        """What the caller learns: an earlier sending may have run although the last did not."""
        says_nothing = error.not_executed is True or isinstance(error, SessionExpired)
        if not self._in_doubt or not says_nothing:
            return error
        if isinstance(error, DeadlineExceeded):
            return DeadlineExceeded("no answer by the deadline")
        return OutcomeUnknown(f"{error}; an earlier sending of the call may have run")


def _asks_for_retry(error: TaskRpcError) -> bool:
    return isinstance(error, HandlerFailed) and error.code is Code.UNAVAILABLE
