"""How every command begins and ends: exit codes, one message for a mistake, Ctrl-C, broken pipes.

Nothing heavy is imported here, so that Ctrl-C finds `guarded` at work as early as possible.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Callable, Sequence
from enum import IntEnum

from taskrpc.errors import TaskRpcError
from taskrpc.mistakes import exit_status, is_ours

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from typing import TypeVar

    Mistake = TypeVar("Mistake", bound=Exception)

_GARBAGE = 100_000
"""Objects to make before Python looks for garbage: more than a short command makes."""

_GARBAGE_LATER = (10_000, 50, 100)
"""The same for a command that goes on. Of 100,000 objects many are new tasks by then, and looking
through them halted the server for 40 ms, on a busy machine for 250; of 10,000 for 3 ms. Python's
own 700 took twice the time of all. Our own calls leave no cycles behind, so that the older ones
need not be looked through often: for them it takes as long as there are tasks."""


class Exit(IntEnum):
    """The exit codes of all commands."""

    DONE = 0
    ERROR = 1
    """An error answer, an invalid definition or request, a look-up that found nothing."""
    USAGE = 2
    DEADLINE = 3
    """No answer by the deadline, after the call was sent."""
    NOT_RUN = 4
    """The call certainly did not run."""
    UNKNOWN = 5
    """The connection was lost in mid-call."""
    INTERRUPTED = 130


class NotFound(TaskRpcError):
    """What was asked for is not there."""


class UsageError(TaskRpcError):
    """The command line cannot be understood; `usage` is printed before the message."""

    def __init__(self, message: str, usage: str = "") -> None:
        self.usage = usage
        super().__init__(message)


def run_main(action: Callable[[list[str]], int], argv: Sequence[str] | None) -> int:
    """Run a command with the given arguments, or with those of this process."""
    if argv is not None:
        return guarded(action, list(argv))
    # A command is short: looking for garbage, at the end once more, would cost it a tenth.
    gc.set_threshold(_GARBAGE)
    try:
        return guarded(action, sys.argv[1:])
    finally:
        gc.freeze()


def goes_on() -> None:
    """Say that a command has started, and is going to run for long."""
    if gc.get_threshold()[0] == _GARBAGE:  # else the process is not ours, and nor is its garbage
        gc.freeze()  # what is imported stays: to look through it takes 20 ms each time
        gc.set_threshold(*_GARBAGE_LATER)


def guarded(action: Callable[[list[str]], int], argv: list[str]) -> int:
    """Run a command's action and return its exit code, whatever happens.

    A user's mistake becomes one message on stderr; one line of JSON where `argv` has `--json`.
    """
    try:
        # Not at the top: Ctrl-C while this is imported must find us at work.
        from taskrpc import platform

        platform.prepare_output()
        code = int(action(argv))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone, and Python must not trip over that at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.DONE
    except Exception as error:
        if not is_mistake(error):
            raise
        with contextlib.suppress(BrokenPipeError):
            sys.stdout.flush()
            print(_as_json(error) if "--json" in argv else _as_text(error), file=sys.stderr)
        return exit_code(error)


def exit_code(error: Exception) -> Exit:
    """The exit code that says what became of the call."""
    if isinstance(error, UsageError):
        return Exit.USAGE
    return Exit(exit_status(error))


def is_mistake(error: Exception) -> bool:
    """Whether an error is told in a sentence; any other is a defect and shows its traceback."""
    return isinstance(error, OSError) or is_ours(error)


def hinted(error: Mistake, hint: str) -> Mistake:
    """The error, with a hint to print on a line of its own where there is one."""
    if hint:
        error.add_note(hint)
    return error


def _as_text(error: Exception) -> str:
    usage = error.usage if isinstance(error, UsageError) else ""
    return "\n  hint: ".join([f"{usage}{error}", *_hints(error)])


def _as_json(error: Exception) -> str:
    import json

    fields = {"error": type(error).__name__, "message": str(error)}
    if hints := _hints(error):
        fields["hint"] = "; ".join(hints)
    return json.dumps(fields)


def _hints(error: Exception) -> list[str]:
    return list(getattr(error, "__notes__", ()))
