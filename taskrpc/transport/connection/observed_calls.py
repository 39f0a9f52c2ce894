"""Calls of which somebody wants to know: an observer, or the log at DEBUG."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from taskrpc.callinfo import CallInfo, log_fields
from taskrpc.errors import Code, TaskRpcError
from taskrpc.observer import Observer, told
from taskrpc.transport.connection.incoming_call import Route, ServedCall
from taskrpc.wire.status import code_of

if TYPE_CHECKING:
    from taskrpc.transport.connection.server_side import ServingConnection

log = logging.getLogger("taskrpc.server")


class ObservedCall(ServedCall, eq=False):
    """A call that tells of its begin and its end."""

    ended: bool = False
    span: bytes = b""

    def __post_init__(self) -> None:
        self.span = self.connection.session.open_calls[self.call_id].span
        _debug(self, "call %d of %s from %s began")
        if (observer := self.route.offer.observer) is not None:
            told(observer.call_began, self)

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Answer with a response message."""
        super().reply(response, body)
        if not self.ended and (observer := self.route.offer.observer) is not None:
            told(observer.call_answered, self, response)
        self._end(Code.OK)

    def reply_in_thread(self, body: bytes) -> bool:
        """Only the loop can: observers are told on its thread."""
        return False

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        super().fail(error)
        code = code_of(error)
        self._end(Code.CANCELLED if code is Code.UNKNOWN and self.cancelled else code)

    def lost(self) -> None:
        """The way back to the caller is gone."""
        super().lost()
        self._end(Code.CANCELLED)

    def _end(self, code: Code) -> None:
        # A callback may answer although its caller has been told that the time is over.
        if not self.ended:
            self.ended = True
            _tell_end(self, self.route.offer.observer, code, self._clock() - self.arrived)


def refused(connection: ServingConnection, route: Route, error: TaskRpcError) -> None:
    """Tell of a request that was refused before it became a call."""
    host, offer = connection.host, route.offer
    who = route.caller, connection.principal, connection.role
    call = CallInfo(offer.name, *who, next(host.call_numbers), None, host.now, False)
    _tell_end(call, offer.observer, code_of(error), 0.0)


def _tell_end(call: CallInfo, observer: Observer | None, code: Code, seconds: float) -> None:
    _debug(call, "call %d of %s from %s ended: %s after %.6f s", code.name, seconds)
    if observer is not None:
        told(observer.call_ended, call, code, seconds)


def _debug(call: CallInfo, text: str, *more: object) -> None:
    if log.isEnabledFor(logging.DEBUG):
        log.debug(text, call.number, call.service, call.caller, *more, extra=log_fields(call))
