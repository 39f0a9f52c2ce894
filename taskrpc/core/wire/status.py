"""Errors on the wire: from exceptions to a code, flags and a sentence, and back."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from taskrpc import errors
from taskrpc.core.wire import messages
from taskrpc.core.wire.frames import Body, Flag
from taskrpc.errors import Code, TaskRpcError

MAX_MESSAGE = 1024
"""Bytes of an error's sentence on the wire."""

_RETRY_UNIT = 0.01
"""Seconds in one unit of `retry_after`."""
_RETRY_MOST = 0xFFFF
_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")

_CODES: tuple[tuple[type[TaskRpcError], Code], ...] = (
    (errors.DeadlineExceeded, Code.DEADLINE_EXCEEDED),
    (errors.ServiceUnavailable, Code.UNIMPLEMENTED),
    (errors.TypeMismatch, Code.FAILED_PRECONDITION),
    (errors.InvalidRequest, Code.INVALID_ARGUMENT),
    (errors.ServerBusy, Code.RESOURCE_EXHAUSTED),
    (errors.OutcomeUnknown, Code.OUTCOME_UNKNOWN),
    (errors.AuthenticationFailed, Code.UNAUTHENTICATED),
    (errors.PermissionDenied, Code.PERMISSION_DENIED),
    (errors.SessionExpired, Code.SESSION_EXPIRED),
    (errors.RequestIdReused, Code.ID_REUSED),
    (errors.ProtocolError, Code.DATA_LOSS),
)
_CLASSES = {code: cls for cls, code in _CODES}
_KNOWN = {code.value: code for code in Code}


class WireError(NamedTuple):
    """An ERROR frame's contents."""

    code: int
    flags: int
    retry_after: int
    """In units of 10 ms."""
    body: bytes


def to_wire(error: TaskRpcError) -> WireError:
    """Return the content of the ERROR frame; errors of handlers keep their own code."""
    flags = Flag.NOT_EXECUTED if error.not_executed else Flag(0)
    message, path, retry = str(error), "", 0
    if isinstance(error, errors.HandlerError | errors.HandlerFailed):
        message = error.message
        flags |= Flag.FROM_HANDLER
    if isinstance(error, errors.InvalidRequest):
        message, path = error.problem, error.path
    if isinstance(error, errors.ServerBusy):
        # Rounded up: the caller must not come back earlier.
        retry = math.ceil(min(max(0.0, error.retry_after / _RETRY_UNIT), _RETRY_MOST))
    body = messages.encode(messages.ErrorBody(_shortened(message), _shortened(path)))
    return WireError(code_of(error), flags, retry, body)


def code_of(error: TaskRpcError) -> Code:
    """Return the status code of an error; errors of handlers have their own."""
    if isinstance(error, errors.HandlerError | errors.HandlerFailed):
        return error.code
    return next((code for cls, code in _CODES if isinstance(error, cls)), Code.UNKNOWN)


def from_wire(code: int, flags: int, retry_after: int, body: Body) -> TaskRpcError:
    """Return the exception of an ERROR frame; never raises, even for an invalid body."""
    try:
        content = messages.decode_error(body)
    except errors.ProtocolError:
        content = messages.ErrorBody("the peer sent an error without a readable message")
    message, path = _readable(content.message), _readable(content.path)
    error = _rebuilt(code, flags, retry_after * _RETRY_UNIT, message, path)
    # Only this flag makes a retry safe. Only an error of the handler shows that the call ran.
    if flags & Flag.NOT_EXECUTED:
        error.not_executed = True
    else:
        error.not_executed = False if flags & Flag.FROM_HANDLER else None
    return error


def _rebuilt(code: int, flags: int, retry_after: float, message: str, path: str) -> TaskRpcError:
    known = _KNOWN.get(code, Code.UNKNOWN)
    if flags & Flag.FROM_HANDLER:
        return errors.HandlerFailed(known, message)
    cls = _CLASSES.get(known, TaskRpcError)
    if cls is errors.InvalidRequest:
        return errors.InvalidRequest(path, message)
    if cls is errors.ServerBusy:
        return errors.ServerBusy(message, retry_after=retry_after)
    return cls(message)


def _readable(text: str) -> str:
    # Control characters from a peer must not reach the terminal that prints the error.
    return _shortened(_CONTROLS.sub(lambda found: f"\\x{ord(found[0]):02x}", text))


def _shortened(text: str) -> str:
    data = text.encode("utf-8", "backslashreplace")
    if len(data) <= MAX_MESSAGE:
        return data.decode()
    return data[: MAX_MESSAGE - 3].decode("utf-8", "ignore") + "…"
