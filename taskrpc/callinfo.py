"""What a service callback may ask about the call that it is answering."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar


class CallInfo:
    """One call, as its callback sees it.

    Attributes:
        service: the service's absolute name. caller: the calling node's or program's name.
        number: counts the calls of this server; it stands in the log beside a failure.
        deadline: instant on the event loop's clock, or None.
        cancelled: True once the caller gave up; plain and threaded callbacks may look now and then.
    """

    __slots__ = ("_clock", "caller", "cancelled", "deadline", "number", "service")

    def __init__(
        self,
        service: str,
        caller: str,
        number: int,
        deadline: float | None,
        clock: Callable[[], float],
    ) -> None:
        self.service = service
        self.caller = caller
        self.number = number
        self.deadline = deadline
        self.cancelled = False
        self._clock = clock

    def time_left(self) -> float | None:
        """Seconds until the caller stops waiting (never below 0.0), None without a deadline."""
        return None if self.deadline is None else max(0.0, self.deadline - self._clock())


answering: ContextVar[CallInfo | None] = ContextVar("taskrpc_call", default=None)


def current_call() -> CallInfo:
    """The call that the running service callback answers.

    Raises LookupError outside a service callback.
    """
    call = answering.get()
    if call is None:
        raise LookupError("current_call() was asked outside a service callback")
    return call
