"""Begins and ends every command: exit codes, error messages, Ctrl-C and lost output.

This module imports nothing slow, so that `--help` is fast.
"""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from enum import IntEnum

from srvgen.cli import process
from taskrpc.errors import TaskRpcError, exit_status, is_ours

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from typing import TypeVar

    Mistake = TypeVar("Mistake", bound=Exception)

_GC_THRESHOLD = 100_000
"""New objects until a garbage collection: more than a short command makes."""

_GC_THRESHOLDS_LONG_RUN = (10_000, 50, 100)
"""The thresholds of a command that runs for long. With 100,000 objects, many of them new tasks, one
collection halted the server for 40 ms, on a busy machine for 250 ms; with 10,000 objects for 3 ms.
Python's default of 700 doubled the total time of collections. Older generations are collected
rarely: that takes longer the more tasks exist, and calls leave no reference cycles behind."""


_INPUT_LIMIT = 16 * 2**20
"""Most bytes that are read from standard input: far more than the YAML of any request."""


class Exit(IntEnum):
    """The exit codes of all commands."""

    DONE = 0
    ERROR = 1
    """An error response, an invalid definition or request, a lookup that found nothing."""
    USAGE = 2
    DEADLINE = 3
    """The deadline was exceeded after the call was sent."""
    NOT_RUN = 4
    """The call certainly did not run."""
    UNKNOWN = 5
    """The connection was lost during the call; it is unknown whether the call ran."""
    INTERRUPTED = 130


def exit_after(signal_number: int) -> Exit:
    """Return the exit code of a command that served until this signal; SIGTERM is a success."""
    return Exit.INTERRUPTED if signal_number == signal.SIGINT else Exit.DONE


class NotFound(TaskRpcError):
    """The thing that the user named does not exist."""


class OutputLost(TaskRpcError):
    """The command's results could not be written: standard output is closed, or its disk full."""


class UsageError(TaskRpcError):
    """The command line is wrong; `usage` is printed before the message."""

    def __init__(self, message: str, usage: str = "") -> None:
        self.usage = usage
        super().__init__(message)


def run_main(
    action: Callable[[list[str]], int],
    argv: Sequence[str] | None,
    *,
    sigterm_is_success: bool = False,
) -> int:
    """Run a command with the given arguments, or with those of this process.

    The action calls `process.start_work` once its imports are done: see `process.begin`.
    """
    if argv is not None:
        return guarded(action, list(argv))
    process.begin(sigterm_is_success=sigterm_is_success)
    # A command is short: garbage collections, one more at the end, would take a tenth of its time.
    gc.set_threshold(_GC_THRESHOLD)
    try:
        code = guarded(action, sys.argv[1:])
    except KeyboardInterrupt:  # a second Ctrl-C, while a message was printed
        code = Exit.INTERRUPTED
    finally:
        gc.freeze()
    return process.end(code)


def tune_for_long_run() -> None:
    """Set the garbage collector for a command that has started and runs for long."""
    if gc.get_threshold()[0] == _GC_THRESHOLD:  # otherwise `run_main` did not start this process
        gc.freeze()  # imported objects stay for ever, and each collection of them takes 20 ms
        gc.set_threshold(*_GC_THRESHOLDS_LONG_RUN)


def guarded(action: Callable[[list[str]], int], argv: list[str]) -> int:
    """Run a command's action and return its exit code.

    A user's mistake becomes one message on stderr; one line of JSON if `argv` has `--json`.
    """
    from taskrpc.spi import terminal

    terminal.prepare_output()
    try:
        code = int(action(argv))
        process.check_output()
        return code
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except Exception as error:
        failure = process.output_failure()
        if isinstance(error, BrokenPipeError) and isinstance(failure, BrokenPipeError):
            return Exit.DONE  # the reader of the output stopped early
        if not is_mistake(error):
            raise
        if isinstance(error, OSError) and failure is not None:
            error = OutputLost(f"cannot write to standard output: {failure.strerror}")
        print(_as_json(error) if "--json" in argv else _as_text(error), file=sys.stderr)
        return exit_code(error)


def standard_input() -> str:
    """Read all of standard input: UTF-8, or the UTF-16 that some Windows tools write.

    Raises UsageError if it is closed, cannot be read or is larger than 16 MiB.
    """
    if sys.stdin is None:
        raise UsageError("expected text on standard input, but it is closed")
    try:
        data = sys.stdin.buffer.read(_INPUT_LIMIT + 1)
    except OSError as error:
        raise UsageError(f"cannot read standard input: {error.strerror}") from None
    if len(data) > _INPUT_LIMIT:
        problem = f"at most {_INPUT_LIMIT // 2**20} MiB of text on standard input, got more"
        raise UsageError(f"expected {problem}")
    is_utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16" if is_utf16 else "utf-8-sig", errors="replace")


def exit_code(error: Exception) -> Exit:
    """Return the exit code for an error."""
    if isinstance(error, UsageError):
        return Exit.USAGE
    return Exit(exit_status(error))


def is_mistake(error: Exception) -> bool:
    """Whether an error is shown as one message; any other is a defect and shows its traceback."""
    return isinstance(error, OSError) or is_ours(error)


def hinted(error: Mistake, hint: str) -> Mistake:
    """Return the error with a hint, which is printed on its own line; "" adds none."""
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
