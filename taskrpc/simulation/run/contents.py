"""The requests and responses of a run that tells its story, for its recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import msgspec

import srvgen

if TYPE_CHECKING:
    from taskrpc import CallInfo, Msg


class Step(msgspec.Struct, frozen=True):
    """A service gets a request, or sends a response."""

    time: float
    """Virtual seconds."""
    call: int
    """The number of the call, from 1, in the order in which programs made them."""
    name: str
    """As in `ServiceEventInfo`: `REQUEST_RECEIVED` or `RESPONSE_SENT`."""
    cls: type[Any]
    """The class of the message."""
    data: bytes
    """The message as CDR: a program may change it later."""
    deadline: float | None
    """When the caller stops waiting, in virtual seconds; None if it waits for ever."""


class Contents:
    """Keeps each request and response with the call to which it belongs.

    A client makes one call, which may arrive at the service several times. The call's number
    travels in the trace span of the request.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self.steps: list[Step] = []
        self._now = now

    def keep(self, name: str, call: CallInfo, message: Msg | None) -> None:
        """Keep a message that a service has received or sent."""
        number = int.from_bytes(call.span[:16], "big")
        if not number or message is None:
            return
        left, now = call.time_left(), self._now()
        try:
            data = srvgen.to_cdr(cast("Any", message))
        except srvgen.CdrError:
            return
        deadline = None if left is None else now + left
        self.steps.append(Step(now, number, name, type(message), data, deadline))


def span_of(number: int) -> bytes:
    """Return the trace span that carries the number of a call."""
    return number.to_bytes(16, "big") + number.to_bytes(8, "big") + b"\0"
