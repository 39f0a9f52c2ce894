"""All errors of taskrpc, as one tree.

    TaskRpcError
    ├── DeadlineExceeded       no response by the deadline (also a TimeoutError)
    ├── ServiceUnavailable     no server offers the service; the call certainly did not run
    ├── ConnectionLost         the connection ended before the response
    │   └── OutcomeUnknown     … and the call may or may not have run
    ├── TypeMismatch           client and server have different definitions of the service
    ├── InvalidRequest         a value does not fit its field (`path` names it)
    ├── ServerBusy             the server is overloaded; try again after `retry_after` seconds
    ├── HandlerFailed          the server's callback raised
    ├── HandlerError           a callback raises it to send a code and a message to its caller
    ├── GoalFailed             the goal of an action did not succeed
    │   ├── GoalRejected       … the action server did not accept it
    │   ├── GoalAborted        … the action server gave it up
    │   └── GoalCanceled       … a client cancelled it
    ├── InvalidName            a node, service or namespace name breaks ROS's rules
    ├── NameInUse              another process already offers a service of this name
    ├── CannotListen           the address to listen at is taken, wrong or not allowed
    ├── WouldDeadlock          a blocking call from the thread that must run the call
    ├── ProtocolError          the peer does not speak this protocol
    ├── AuthenticationFailed   the peer could not prove the token
    ├── PermissionDenied       the peer may not do this
    ├── SessionExpired         the server no longer remembers this client
    ├── RequestIdReused        the request id belongs to another request
    └── StoreError             a store cannot be read or written

Every error has `not_executed`: True if the call certainly did not run, False if it did, None if
that is unknown. The classes with True: `ServiceUnavailable`, `TypeMismatch`, `InvalidRequest`,
`ServerBusy`, `InvalidName`, `NameInUse`, `CannotListen`, `WouldDeadlock`, `AuthenticationFailed`,
`PermissionDenied`, `RequestIdReused`, `StoreError`, `GoalRejected`, and the errors of a callback
with the code UNAVAILABLE. The classes with False: other `HandlerFailed`, `GoalAborted`. All
other classes have None. Code that raises an error may set another value.
"""

from __future__ import annotations

import re
from enum import IntEnum

TYPE_CHECKING = False  # importing typing would cost every command
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

_NUMERIC = tuple("bcdeEfFgGnoxX%")
"""The last letters of the format specs of numbers."""
_ERROR, _DEADLINE, _NOT_RUN, _UNKNOWN = 1, 3, 4, 5
"""Exit statuses of scripts, the same as those of the commands."""


class Code(IntEnum):
    """The status codes that travel on the wire: gRPC's sixteen and three of our own."""

    OK = 0
    CANCELLED = 1
    UNKNOWN = 2
    INVALID_ARGUMENT = 3
    DEADLINE_EXCEEDED = 4
    NOT_FOUND = 5
    ALREADY_EXISTS = 6
    PERMISSION_DENIED = 7
    RESOURCE_EXHAUSTED = 8
    FAILED_PRECONDITION = 9
    ABORTED = 10
    OUT_OF_RANGE = 11
    UNIMPLEMENTED = 12
    INTERNAL = 13
    UNAVAILABLE = 14
    DATA_LOSS = 15
    UNAUTHENTICATED = 16
    OUTCOME_UNKNOWN = 17
    SESSION_EXPIRED = 18
    ID_REUSED = 19

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        # IntEnum's own method formats the number, even without a format for numbers.
        return format(int(self) if spec.endswith(_NUMERIC) else self.name, spec)


class TaskRpcError(Exception):
    """The root of every error that this library raises on purpose.

    Attributes:
        not_executed: True when the call certainly did not run, False when it did, None if unknown.
        files: paths in the text that callers on other machines must not see.
        for_callers: the text for callers; "": this error's text without file names.
    """

    not_executed: bool | None = None
    files: tuple[str, ...] = ()
    for_callers: str = ""

    def __init__(self, message: str = "", *, not_executed: bool | None = None) -> None:
        super().__init__(message)
        if not_executed is not None:
            self.not_executed = not_executed


class DeadlineExceeded(TaskRpcError, TimeoutError):
    """No response arrived by the deadline; the call was cancelled and may have run."""


class ServiceUnavailable(TaskRpcError):
    """No server offers the service, or none could be reached in time.

    Attributes:
        service: the name that was not found in the registry of this machine, "" for other reasons.
    """

    not_executed = True

    def __init__(
        self, message: str = "", *, not_executed: bool | None = None, service: str = ""
    ) -> None:
        super().__init__(message, not_executed=not_executed)
        self.service = service


class ConnectionLost(TaskRpcError):
    """The connection ended before the response arrived."""


class OutcomeUnknown(ConnectionLost):
    """The call may or may not have run: the connection was lost, or a disk failed."""


class TypeMismatch(TaskRpcError):
    """Client and server have different definitions of the service."""

    not_executed = True


class InvalidRequest(TaskRpcError):
    """A value in a message does not fit its field.

    Attributes:
        path: the field, as in `goal.position.x` or `ranges[3]`; "" for the whole message.
        problem: what was expected and what was received.
    """

    not_executed = True

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"{path}: {problem}" if path else problem)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.path, self.problem), self.__dict__


class ServerBusy(TaskRpcError):
    """The server is overloaded and refused the call; it did not run.

    Attributes:
        retry_after: the seconds after which the client should try again, as the server suggests.
    """

    not_executed = True

    def __init__(self, message: str = "", *, retry_after: float = 0.0) -> None:
        self.retry_after = retry_after
        super().__init__(message)


class _Coded(TaskRpcError):
    """An error of a callback, with its code."""

    def __init__(self, code: Code | str, message: str = "") -> None:
        self.code = _code_of(code)
        self.message = message
        super().__init__(message or self.code.name)
        if self.code is Code.UNAVAILABLE:
            self.not_executed = True

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.code, self.message), self.__dict__


class HandlerFailed(_Coded):
    """The server's callback raised.

    Attributes:
        code: `Code.INTERNAL`, or the code of the callback's `HandlerError`.
        message: the text of the callback's `HandlerError`.
    """

    not_executed = False


class HandlerError(_Coded):
    """Raise this in a service callback to send a code and a message to the caller.

    `code` is a `Code` or its name. `UNAVAILABLE` promises that nothing was done, so that the
    caller's retry policy may try again; with any other code the call counts as executed.

    Raises `HandlerError.Invalid`, a ValueError, for an invalid code or without a message.
    """

    class Invalid(ValueError):
        """A HandlerError with wrong arguments. The caller gets the text: it is meant for it."""

    if TYPE_CHECKING:

        def __init__(self, code: Code | str, message: str) -> None: ...

    else:

        def __init__(self, code: object, message: object = None) -> None:
            if message is None:
                raise self.Invalid(
                    f"HandlerError: expected a code and a message, got only {code!r};"
                    f" write HandlerError('INVALID_ARGUMENT', {str(code)!r})"
                )
            try:
                super().__init__(code, message)
            except ValueError as error:
                problem = f"HandlerError: {error}, with the message {message!r}"
                raise self.Invalid(problem) from None


class GoalFailed(_Coded):
    """The goal of an action did not succeed.

    Attributes:
        code: why, as a code; the server's `HandlerError` sets it.
        message: the text of the server's `HandlerError`, or a general one.
        result: the result message that the server gave, None if it gave none.
    """

    def __init__(self, code: Code | str, message: str = "", result: Any = None) -> None:
        self.result = result
        super().__init__(code, message)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.code, self.message, self.result), self.__dict__


class GoalRejected(GoalFailed):
    """The action server did not accept the goal, and does not execute it."""

    not_executed = True


class GoalAborted(GoalFailed):
    """The action server ended the goal without completing it, or its callback raised."""

    not_executed = False


class GoalCanceled(GoalFailed):
    """A client, or the server at its end, cancelled the goal; it may have begun."""


class InvalidName(TaskRpcError, ValueError):
    """A name breaks ROS's naming rules.

    Attributes:
        name: the name as given.
        index: the position of the first wrong character, counted from 0.
        kind: `node name`, `namespace`, `service name`, `topic name` or `action name`.
        problem: the broken rule.
    """

    not_executed = True

    def __init__(self, name: str, index: int, *, kind: str = "name", problem: str = "") -> None:
        self.name, self.index, self.kind, self.problem = name, index, kind, problem
        super().__init__(f"Invalid {kind}: {problem}:\n  '{name}'\n   {' ' * index}^")

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild_name, (self.name, self.index, self.kind, self.problem), self.__dict__


class NameInUse(TaskRpcError):
    """Another process of this user already offers a service of this name."""

    not_executed = True

    def without_join(self) -> NameInUse:
        """The error without the advice to join: for actions, and for services of rclpy."""
        return NameInUse(str(self).partition(", or join it")[0])


class CannotListen(TaskRpcError):
    """The address to listen at is taken, wrong, or not allowed without more protection."""

    not_executed = True


class WouldDeadlock(TaskRpcError, RuntimeError):
    """A blocking call was made on the event loop's own thread, which must also run the call."""

    not_executed = True


class ProtocolError(TaskRpcError):
    """The peer sent something that this protocol does not allow."""


class AuthenticationFailed(TaskRpcError):
    """One side could not prove that it knows the other's token."""

    not_executed = True


class PermissionDenied(TaskRpcError):
    """The peer may not do this."""

    not_executed = True


class SessionExpired(TaskRpcError):
    """The server no longer remembers this client, so a repeated request cannot be recognised."""


class RequestIdReused(TaskRpcError):
    """Another request was sent under this request's id before; this one did not run."""

    not_executed = True


class StoreError(TaskRpcError):
    """A store cannot be read or written; nothing was changed. The text says which file and why."""

    not_executed = True


_PATH = r"(?<![^\s('\"])(?:[A-Za-z]:[\\/]|\\\\|~?/|\.{1,2}[\\/])[^\s'\",;)]*[^\s'\",;:)]"
"""Python compiles the pattern when the first error is sent."""


def text_for_callers(error: TaskRpcError) -> str:
    """Return an error's text for callers on other machines, without paths of this machine."""
    text = error.for_callers or str(error)
    for file in sorted(error.files, key=len, reverse=True):
        text = text.replace(f"{file}: ", "").replace(file, "the server's file")
    # Users' own stores do not list the paths in their texts.
    return re.sub(_PATH, "…", text)


def _rebuild_name(name: str, index: int, kind: str, problem: str) -> InvalidName:
    return InvalidName(name, index, kind=kind, problem=problem)


def _code_of(code: Code | str) -> Code:
    try:
        return Code[code] if isinstance(code, str) else Code(code)
    except (KeyError, ValueError):
        names = ", ".join(Code.__members__)
        problem = f"code: expected a Code or the name of one ({names}), got {code!r}"
        raise ValueError(problem) from None


def exit_status(error: BaseException) -> int:
    """Return the exit status for a script that does not catch the error: 1, 3, 4 or 5."""
    if isinstance(error, DeadlineExceeded):
        return _NOT_RUN if error.not_executed else _DEADLINE
    if isinstance(error, ConnectionLost):
        return _NOT_RUN if error.not_executed else _UNKNOWN
    return _NOT_RUN if isinstance(error, ServiceUnavailable | ServerBusy) else _ERROR


def is_ours(error: BaseException) -> bool:
    """Whether taskrpc or srvgen raised the error on purpose, so that its text explains it."""
    if isinstance(error, TaskRpcError):
        return True
    from srvgen import DefinitionError, FieldError  # few programs end with an error

    return isinstance(error, DefinitionError | FieldError)


def show_in_one_message(hint: Callable[[BaseException], str] = lambda _: "") -> None:
    """End this program without a traceback after an error of taskrpc that it does not catch.

    Errors of other kinds keep their traceback. A program with its own excepthook keeps it;
    `python -X dev` shows all tracebacks. `hint` returns what else the user should know of an
    error, or "".
    """
    from srvgen import excepthook  # commands that only need the errors start without it

    excepthook.show_in_one_message(is_ours, exit_status, hint)
