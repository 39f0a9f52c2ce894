"""Ends a script that lets an error of taskrpc escape: one message and a documented exit status.

Errors of other kinds, such as a script's own TypeError, keep their traceback.
"""

from __future__ import annotations

import os
import sys

from taskrpc.errors import (
    ConnectionLost,
    DeadlineExceeded,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
)

TYPE_CHECKING = False  # typing is slow to import
if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType

_ERROR, _DEADLINE, _NOT_RUN, _UNKNOWN = 1, 3, 4, 5
_OURS = os.path.dirname(os.path.abspath(__file__)) + os.sep
_POSITIONAL = "Extra positional arguments provided"
"""msgspec's text; an own check in the constructors would slow all calls."""
_BY_NAME = "a message takes its fields by name: write Request(a=1, b=2), not Request(1, 2)"


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
    if sys.excepthook is sys.__excepthook__ and not sys.flags.dev_mode:
        sys.excepthook = _show


def explain(error: BaseException | None) -> None:
    """Change the text of a TypeError for positional fields, so that it shows the right spelling."""
    if isinstance(error, TypeError) and error.args == (_POSITIONAL,):
        error.args = (_BY_NAME,)


def _show(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    """Replace `sys.excepthook`. The SystemExit that this raises sets the exit status."""
    errors = list(_members(error))
    for each in errors:
        explain(each)
    if not all(is_ours(each) or each.args == (_BY_NAME,) for each in errors):
        sys.__excepthook__(kind, error, traceback)
        return
    for each in errors:
        place = _place(each.__traceback__) or _place(traceback)
        message = f"{place}{type(each).__name__}: {each}"
        print("\n  hint: ".join([message, *getattr(each, "__notes__", ())]), file=sys.stderr)
    if not hasattr(sys, "ps1") and not sys.flags.interactive:
        raise SystemExit(exit_status(errors[0]))


def _members(error: BaseException) -> Iterator[BaseException]:
    """The errors of a group, such as an `asyncio.TaskGroup` raises; any other error is its own."""
    if isinstance(error, BaseExceptionGroup):
        for each in error.exceptions:
            yield from _members(each)
    else:
        yield error


def _place(traceback: TracebackType | None) -> str:
    """The last line of a traceback in the program itself, as `file.py:12: `."""
    import sysconfig

    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    libraries = _OURS, *(os.path.join(folder, "") for folder in folders)
    place = ""
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if not file.startswith(("<", *libraries)):
            folder = os.path.join(os.getcwd(), "")
            place = f"{file.removeprefix(folder)}:{traceback.tb_lineno}: "
        traceback = traceback.tb_next
    return place
