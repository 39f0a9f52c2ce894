"""Ends a script that lets an error of taskrpc escape: one message and a documented exit status.

Errors of other kinds, such as a script's own TypeError, keep their traceback.
"""

from __future__ import annotations

from srvgen import excepthook
from taskrpc.errors import (
    ConnectionLost,
    DeadlineExceeded,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
)

_ERROR, _DEADLINE, _NOT_RUN, _UNKNOWN = 1, 3, 4, 5


def exit_status(error: BaseException) -> int:
    """The exit status that tells the outcome of the call: 1, 3, 4 or 5."""
    if isinstance(error, DeadlineExceeded):
        return _NOT_RUN if error.not_executed else _DEADLINE
    if isinstance(error, ConnectionLost):
        return _NOT_RUN if error.not_executed else _UNKNOWN
    return _NOT_RUN if isinstance(error, ServiceUnavailable | ServerBusy) else _ERROR


def is_ours(error: BaseException) -> bool:
    """Whether an error belongs to taskrpc or srvgen, so its text is enough for the user."""
    if isinstance(error, TaskRpcError):
        return True
    from srvgen import DefinitionError, FieldError

    return isinstance(error, DefinitionError | FieldError)


def show_in_one_message() -> None:
    """Show errors of taskrpc that end this program without a traceback.

    A program with its own excepthook keeps it; `python -X dev` shows all tracebacks.
    """
    excepthook.show_in_one_message(is_ours, exit_status)
