"""Errors as they travel: exception to code, flags and sentence, and back."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from taskrpc import errors
from taskrpc.errors import Code, TaskRpcError
from taskrpc.wire import messages
from taskrpc.wire.frames import Flag

MAX_MESSAGE = 1024
"""Bytes of an error's sentence on the wire."""

_RETRY_UNIT = 0.01

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
    (errors.ProtocolError, Code.DATA_LOSS),
)
_CLASSES = {code: cls for cls, code in _CODES}


class WireError(NamedTuple):
    """An ERROR frame's contents."""

    code: int
    flags: int
    retry_after: int
    """In units of 10 ms."""
    body: bytes


def to_wire(error: TaskRpcError) -> WireError:
    """What to send for an error; callbacks' own errors keep their code."""
    flags = Flag.NOT_EXECUTED if error.not_executed else Flag(0)
    message, path, retry = str(error), "", 0
    if isinstance(error, errors.HandlerError | errors.HandlerFailed):
        code, message = error.code, error.message
        flags = Flag.FROM_HANDLER | (Flag.NOT_EXECUTED if code is Code.UNAVAILABLE else Flag(0))
    else:
        code = next((code for cls, code in _CODES if isinstance(error, cls)), Code.UNKNOWN)
    if isinstance(error, errors.InvalidRequest):
        message, path = error.problem, error.path
    if isinstance(error, errors.ServerBusy):
        retry = min(0xFFFF, round(error.retry_after / _RETRY_UNIT))
    body = messages.encode(messages.ErrorBody(_shortened(message), _shortened(path)))
    return WireError(code, flags, retry, body)


def from_wire(code: int, flags: int, retry_after: int, body: bytes | bytearray) -> TaskRpcError:
    """The exception that an ERROR frame means; never raises, whatever the peer sent."""
    try:
        said = messages.decode_error(body)
    except msgspec.MsgspecError:
        said = messages.ErrorBody("the peer sent an error without a readable message")
    error = _rebuilt(code, flags, retry_after * _RETRY_UNIT, said)
    if flags & Flag.NOT_EXECUTED:
        error.not_executed = True
    return error


def _rebuilt(code: int, flags: int, retry_after: float, said: messages.ErrorBody) -> TaskRpcError:
    known = Code(code) if code in Code._value2member_map_ else Code.UNKNOWN
    if flags & Flag.FROM_HANDLER:
        return errors.HandlerFailed(known, said.message)
    cls = _CLASSES.get(known, TaskRpcError)
    if cls is errors.InvalidRequest:
        return errors.InvalidRequest(said.path, said.message)
    if cls is errors.ServerBusy:
        return errors.ServerBusy(said.message, retry_after=retry_after)
    return cls(said.message)


def _shortened(text: str) -> str:
    data = text.encode("utf-8", "backslashreplace")
    if len(data) <= MAX_MESSAGE:
        return data.decode()
    return data[: MAX_MESSAGE - 3].decode("utf-8", "ignore") + "…"
