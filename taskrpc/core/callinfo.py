"""`current_call()`: what a service callback can read about the call that it serves."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Any, Protocol

import msgspec

from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.security.roles import Role
from taskrpc.errors import PermissionDenied


class Denied(PermissionDenied):
    """A callback raises it: its caller may not do this, and nothing was done.

    The caller gets PermissionDenied. A plain PermissionDenied from a callback does not reach the
    caller as such: it may come from a call that the callback itself made.
    """


class CallInfo(msgspec.Struct, eq=False):
    """The facts about a call that its callback can read."""

    service: str
    """The service's absolute name."""
    caller: str
    """The calling node's or program's name."""
    principal: str
    """The account that the caller authenticated as, "" if it has the server's own token."""
    role: Role
    """What the caller may do; `ADMIN` if it has the server's own token."""
    number: int
    """Counts the calls of this server; log lines about the call contain it."""
    deadline: float | None
    """Instant on the event loop's clock, or None."""
    clock: Callable[[], float]
    """The event loop's clock, in seconds."""
    cancelled: bool = False
    """True once the caller has cancelled; plain and threaded callbacks may check it."""

    @property
    def span(self) -> bytes:
        """The caller's span: 16 bytes of trace id, 8 of span id, 1 of flags; empty for none."""
        return b""

    @property
    def machine(self) -> str:
        """The address of the caller's machine, "" for the server's own."""
        return ""

    @property
    def is_foreign(self) -> bool:
        """Whether the caller is a program of ROS 2 and not of taskrpc: it gets no errors."""
        return False

    @property
    def repeated(self) -> bool:
        """Whether an exactly-once service has recognised the request as a repetition.

        Only observed calls know it, once the service has seen them.
        """
        return False

    def completed_by(self, response: Any) -> Completion | None:
        """Return the record that completes this call of an exactly-once service.

        A callback that stores its effect itself must store this record in the same transaction, and
        then return the response. None means that the call needs no record. After this, the call
        cannot be cancelled any more.

        Raises InvalidRequest for a response that cannot be sent.
        """
        return None

    def nothing_done(self) -> None:
        """Declare that the callback refuses the request and has changed nothing.

        An exactly-once service then does not store the response: if the client repeats the request,
        the callback runs again.
        """

    def time_left(self) -> float | None:
        """Return the seconds until the caller stops waiting, at least 0.0; None: no deadline."""
        return None if self.deadline is None else max(0.0, self.deadline - self.clock())


def log_fields(call: CallInfo) -> dict[str, object]:
    """Return the extra fields (`extra=`) of a log line about a call."""
    return {
        "call": call.number,
        "service": call.service,
        "caller": call.caller,
        "principal": call.principal,
    }


class UnmadeCall(Protocol):
    """A call without a record: most callbacks never ask for it."""

    def made(self) -> CallInfo:
        """Return the record; the same one each time."""


answering: ContextVar[CallInfo | UnmadeCall | None] = ContextVar("taskrpc_call", default=None)
"""The call that the running callback serves; read it with `answered_call`."""


def answered_call() -> CallInfo | None:
    """Return the call that the running callback serves, None outside a callback."""
    call = answering.get()
    return call if call is None or isinstance(call, CallInfo) else call.made()


def current_call() -> CallInfo:
    """Return the call that the running service callback serves.

    Raises LookupError outside a service callback.
    """
    call = answered_call()
    if call is None:
        raise LookupError("current_call() was called outside a service callback")
    return call
