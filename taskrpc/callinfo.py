"""`current_call()`: what a service callback can read about the call that it serves."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

import msgspec

from taskrpc.errors import PermissionDenied
from taskrpc.request_ids.ids import Completion
from taskrpc.security.roles import Role


class Denied(PermissionDenied):
    """A callback raises it: its caller may not do this, and nothing was done.

    The caller gets PermissionDenied. A plain one, which a callback's own call has met, says nothing
    about its caller.
    """


class CallInfo(msgspec.Struct, eq=False):
    """One call, as its callback sees it."""

    service: str
    """The service's absolute name."""
    caller: str
    """The calling node's or program's name."""
    principal: str
    """The account that the caller authenticated as, "" if it has the server's own token."""
    role: Role
    """What the caller may do; `ADMIN` if it has the server's own token."""
    number: int
    """Counts the calls of this server; it stands in the log beside a failure."""
    deadline: float | None
    """Instant on the event loop's clock, or None."""
    clock: Callable[[], float]
    """The event loop's clock, in seconds."""
    cancelled: bool
    """True once the caller has cancelled; plain and threaded callbacks may check it."""

    @property
    def span(self) -> bytes:
        """The caller's span, as an observer is told it: 16 bytes of the trace's id, 8 of its own,
        1 of flags; empty where the caller told none."""
        return b""

    @property
    def machine(self) -> str:
        """The address of the machine that called, "" for the server's own."""
        return ""

    def completed_by(self, response: Any) -> Completion | None:
        """The record with which this response completes the call of an exactly-once service.

        For callbacks that store their effect themselves: the record belongs into the same
        transaction, and the callback returns the response once that is done. None where nothing
        need be remembered. From here on the call is not cancelled any more.

        Raises InvalidRequest for a response that cannot be sent.
        """
        return None

    def nothing_done(self) -> None:
        """Say that the callback refuses and has left nothing behind.

        Then its response is not remembered: sent again, the same request of an exactly-once service
        runs again.
        """

    def time_left(self) -> float | None:
        """Seconds until the caller stops waiting (never below 0.0), None without a deadline."""
        return None if self.deadline is None else max(0.0, self.deadline - self.clock())


def log_fields(call: CallInfo) -> dict[str, object]:
    """What a log line about a call carries beside its text (`extra=`)."""
    return {
        "call": call.number,
        "service": call.service,
        "caller": call.caller,
        "principal": call.principal,
    }


answering: ContextVar[CallInfo | None] = ContextVar("taskrpc_call", default=None)


def current_call() -> CallInfo:
    """The call that the running service callback answers.

    Raises LookupError outside a service callback.
    """
    call = answering.get()
    if call is None:
        raise LookupError("current_call() was called outside a service callback")
    return call
