"""Prints one message instead of a traceback if a script does not catch an error of srvgen.

Errors of other kinds, such as a script's own TypeError, keep their traceback.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # typing is slow to import
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

_POSITIONAL = "Extra positional arguments provided"
"""The error text of msgspec; a check in our constructors would slow down all calls."""
_BY_NAME = "a message takes its fields by name: write Request(a=1, b=2), not Request(1, 2)"
_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_OWN_PACKAGES = tuple(os.path.join(_ROOT, package, "") for package in ("srvgen", "taskrpc"))


def show_in_one_message(
    is_ours: Callable[[BaseException], bool] | None = None,
    exit_status: Callable[[BaseException], int] = lambda _: 1,
) -> None:
    """Show errors for which `is_ours` is true, by default those of srvgen, without a traceback.

    A program with its own excepthook keeps it; `python -X dev` shows all tracebacks. A call with
    `is_ours` replaces one without.
    """
    hook = sys.excepthook
    replaceable = hook is sys.__excepthook__ or (
        is_ours is not None and isinstance(hook, _OneMessageHook)
    )
    if replaceable and not sys.flags.dev_mode:
        sys.excepthook = _OneMessageHook(is_ours or _is_of_srvgen, exit_status)


def explain(error: BaseException | None) -> None:
    """Change the text of a TypeError for positional fields, so that it shows the right spelling."""
    if isinstance(error, TypeError) and error.args == (_POSITIONAL,):
        error.args = (_BY_NAME,)


class _OneMessageHook:
    """Replaces `sys.excepthook`. The SystemExit that it raises sets the exit status."""

    def __init__(
        self, is_ours: Callable[[BaseException], bool], exit_status: Callable[[BaseException], int]
    ) -> None:
        self._is_ours = is_ours
        self._exit_status = exit_status

    def __call__(
        self, kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        messages = messages_of(error, self._is_ours, _location)
        if not messages:
            sys.__excepthook__(kind, error, traceback)
            return
        print("\n".join(messages), file=sys.stderr)
        if not hasattr(sys, "ps1") and not sys.flags.interactive:
            raise SystemExit(self._exit_status(next(_members(error))))


def messages_of(
    error: BaseException,
    is_ours: Callable[[BaseException], bool],
    location: Callable[[str, int], str],
) -> list[str]:
    """Return the message that replaces the traceback of an error; several for a group of errors.

    Empty if the program's author needs the traceback, because `is_ours` is false for an error.
    `location` turns the file and the line in which the error was raised into the beginning of
    its message.
    """
    errors = list(_members(error))
    for each in errors:
        explain(each)
    if not all(is_ours(each) or each.args == (_BY_NAME,) for each in errors):
        return []
    found = []
    for each in errors:
        place = program_line(each.__traceback__) or program_line(error.__traceback__)
        message = f"{location(*place) if place else ''}{type(each).__name__}: {each}"
        found.append("\n  hint: ".join([message, *getattr(each, "__notes__", ())]))
    return found


def _is_of_srvgen(error: BaseException) -> bool:
    from ._runtime import FieldError
    from .errors import DefinitionError

    return isinstance(error, DefinitionError | FieldError)


def _members(error: BaseException) -> Iterator[BaseException]:
    """The errors of a group, such as an `asyncio.TaskGroup` raises; any other error is its own."""
    if isinstance(error, BaseExceptionGroup):
        for each in error.exceptions:
            yield from _members(each)
    else:
        yield error


def program_line(traceback: TracebackType | None) -> tuple[str, int] | None:
    """Return the last line of a traceback in the program itself, outside of all libraries."""
    import sysconfig

    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    libraries = *_OWN_PACKAGES, *(os.path.join(folder, "") for folder in folders)
    place = None
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if not file.startswith(("<", *libraries)):
            place = file, traceback.tb_lineno
        traceback = traceback.tb_next
    return place


def _location(file: str, line: int) -> str:
    """The beginning of a message: `file.py:12: `."""
    return f"{file.removeprefix(os.path.join(os.getcwd(), ''))}:{line}: "
