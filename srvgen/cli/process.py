"""How the process of a command begins and ends: Ctrl-C, SIGTERM and the standard streams.

Used by `srvgen` and by the commands of taskrpc. A command calls `begin` in its first statement,
`start_work` once its imports are done, and `end` with its exit code.
"""

from __future__ import annotations

import atexit
import errno
import io
import os
import sys

INTERRUPTED = 130
"""The exit code after Ctrl-C."""

try:
    import signal
except KeyboardInterrupt:
    os._exit(INTERRUPTED)

TYPE_CHECKING = False  # importing typing would take longer than all of this file
if TYPE_CHECKING:
    from typing import NoReturn, TextIO


def begin(*, sigterm_is_success: bool = False) -> None:
    """Make this process end at once and silently on Ctrl-C, with the exit code 130.

    Python's own KeyboardInterrupt during an import would print a traceback, or be lost in a
    callback of the import system. With `sigterm_is_success`, SIGTERM also ends the process
    silently, with exit code 0. Closed standard streams are replaced. A second call has no effect.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # otherwise leave it ignored
        signal.signal(signal.SIGINT, _exit_interrupted)
    if sigterm_is_success and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _exit_done)
    if not isinstance(sys.stderr, _Stderr):
        _replace_streams()
        atexit.register(_ignore_signals)  # the first function to be registered runs last


def start_work() -> None:
    """Let Ctrl-C raise KeyboardInterrupt, and SIGTERM SystemExit, if `begin` was called.

    From here on the command has work to clean up before it ends. Windows' Ctrl-Break is the same as
    Ctrl-C, if the program handles Ctrl-C: `taskrpc launch` can send its programs only Ctrl-Break.
    """
    if signal.getsignal(signal.SIGINT) is _exit_interrupted:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGTERM) is _exit_done:
        signal.signal(signal.SIGTERM, _raise_exit)
    if sys.platform == "win32" and signal.getsignal(signal.SIGBREAK) is signal.SIG_DFL:
        signal.signal(signal.SIGBREAK, _interrupt)


def end(code: int) -> int:
    """Return the exit code. From now on Ctrl-C ends the process with this code too."""

    def leave(*_: object) -> NoReturn:
        _kill_if_wanted()
        os._exit(code)

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in _HANDLERS:
            signal.signal(number, leave)
    return code


def end_by_signal(number: int) -> int:
    """Kill this process by the signal after its exit functions have run.

    A program under `taskrpc run` must end for its parent process as it does under `python`.
    Returns the exit code that a shell shows for it; systems other than POSIX end with this code.
    """
    global _fatal_signal
    _fatal_signal = number
    return 128 + number


def check_output() -> None:
    """Flush standard output. Raises OSError if that or an earlier write failed."""
    sys.stdout.flush()
    if failure := getattr(sys.stdout, "failure", None):  # argparse, for example, ignores it
        raise failure


def output_failure() -> OSError | None:
    """Why standard output could not be written, None if it could; discards unwritten output."""
    failure = None
    try:
        check_output()
    except OSError as error:
        failure = error
        # Python flushes again at exit; this must not fail a second time.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return failure


def _exit_interrupted(*_: object) -> NoReturn:
    os._exit(INTERRUPTED)


def _interrupt(*_: object) -> None:
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        os._exit(INTERRUPTED)
    signal.raise_signal(signal.SIGINT)


def _exit_done(*_: object) -> NoReturn:
    os._exit(0)


def _raise_exit(*_: object) -> NoReturn:
    raise SystemExit(0)


_HANDLERS = (_exit_interrupted, _exit_done, _raise_exit, signal.default_int_handler)


_fatal_signal = 0
"""The signal that kills this process at its end, 0 for none."""


def _kill_if_wanted() -> None:
    if _fatal_signal and os.name == "posix":
        signal.signal(_fatal_signal, signal.SIG_DFL)
        os.kill(os.getpid(), _fatal_signal)


def _ignore_signals() -> None:
    if _fatal_signal:
        output_failure()  # write what is left; ignore failures
        _kill_if_wanted()
    # Just before its end Python restores the default handlers, which would kill the process.
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_DFL:
            signal.signal(number, signal.SIG_IGN)


class _Stdout(io.TextIOWrapper):
    """Standard output that remembers its first failure, which the buffer below may lose."""

    failure: OSError | None = None

    def write(self, text: str, /) -> int:
        """Write, or raise OSError."""
        try:
            return super().write(text)
        except OSError as error:
            raise self._failed(error) from None

    def flush(self) -> None:
        """Flush, or raise OSError."""
        try:
            super().flush()
        except OSError as error:
            raise self._failed(error) from None

    def _failed(self, error: OSError) -> OSError:
        # What Windows says of a pipe whose reader has gone.
        if sys.platform == "win32" and error.errno == errno.EINVAL:
            error = BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))
        self.failure = self.failure or error
        return error


class _Stderr(io.TextIOWrapper):
    """Standard error. A message that cannot be written is dropped, and the command continues."""

    def write(self, text: str, /) -> int:
        """Write, and ignore failures."""
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Flush, and ignore failures."""
        try:
            super().flush()
        except OSError:
            return


def _replace_streams() -> None:
    """Open closed descriptors 0 to 2 and replace stdout and stderr.

    Otherwise a socket could get one of these numbers and receive what is written to the stream.
    Writing to a closed stdout fails, so the command reports it.
    """
    for descriptor, flags in enumerate((os.O_WRONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(descriptor)
        except OSError:
            opened = os.open(os.devnull, flags)
            os.dup2(opened, descriptor)
            if opened != descriptor:
                os.close(opened)
    sys.stdout = _over(_Stdout, sys.stdout, 1)
    sys.stderr = _over(_Stderr, sys.stderr, 2)


def _over(kind: type[io.TextIOWrapper], stream: TextIO | None, descriptor: int) -> TextIO:
    """A stream of the given kind over the buffer of Python's stream, which stays usable."""
    if stream is None:
        return kind(open(descriptor, "wb", closefd=False), "utf-8", errors="backslashreplace")
    if not isinstance(stream, io.TextIOWrapper):  # an editor's shell has streams of its own
        return stream
    return kind(
        stream.buffer,
        stream.encoding,
        errors="backslashreplace",  # a terminal's code page may lack characters
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
