"""Signal handlers: Ctrl-C and SIGTERM shut every context down, then run the former handler."""

from __future__ import annotations

import _weakrefset
import enum
import functools
import os
import signal
import sys
import threading
import weakref
from types import FrameType, TracebackType
from typing import Any

from srvgen import excepthook

from . import context as _context
from ._impl.execution import signal_reminder


class SignalHandlerOptions(enum.IntEnum):
    """Which signals `rclpy.init` handles."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_handled = SignalHandlerOptions.NO
_before: dict[int, Any] = {}

_LOCK_FUNCTIONS = frozenset(
    {"__enter__", "__exit__", "_acquire_restore", "_release_save", "_is_owned"}
)
"""Functions of `threading` in which an exception would leave a lock locked for ever."""
_BOOKKEEPING = ("<frozen importlib", weakref.__file__, _weakrefset.__file__)
"""Files in which an exception would be printed and lost, or leave an import locked."""
_OF_SHUTDOWN = frozenset(
    {
        "ExternalShutdownException",
        "InvalidHandle",
        "NotInitializedException",
        "RCLError",
        "ROSInterruptException",
    }
)
_MODULES = (".executors", ".exceptions", "._rclpy_pybind11")
"""Exceptions of the methods that refuse to work after the shutdown, and their modules."""
_MAX_POSTPONEMENTS = 20
_postponements = 0
"""How often the present signal was postponed in a row."""


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Let the signals shut every context down; does nothing outside of the main thread."""
    global _handled
    _handled = SignalHandlerOptions(_handled | options)
    if threading.current_thread() is not threading.main_thread():
        return
    if options & SignalHandlerOptions.SIGINT:
        _install(signal.SIGINT)
    if options & SignalHandlerOptions.SIGTERM:
        _install(signal.SIGTERM)


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """The signals that are handled now."""
    return _handled


def uninstall_signal_handlers() -> None:
    """Restore the former signal handlers."""
    global _handled
    _handled = SignalHandlerOptions.NO
    if threading.current_thread() is not threading.main_thread():
        return
    for number, before in _before.items():
        if signal.getsignal(number) is _handle:
            signal.signal(number, before)
    signal_reminder.end()
    _before.clear()


def _install(number: int) -> None:
    before = signal.getsignal(number)
    if before is not _handle:
        _before[number] = before
        signal.signal(number, _handle)
        _end_quietly()
        _shorten_tracebacks_of_threads()
    signal_reminder.begin(number, _handle)


def _handle(number: int, frame: FrameType | None) -> None:
    before = _before.get(number)
    if number == signal.SIGINT and _is_postponed(frame):
        return
    signal_reminder.handled()
    _context.end_all_by_signal()
    _end_in_one_line()
    if callable(before):
        before(number, frame)  # the default handler of Python raises KeyboardInterrupt


def _is_postponed(frame: FrameType | None) -> bool:
    """Whether an exception now would do harm or be lost; then the signal is sent again soon."""
    global _postponements
    if frame is None or _postponements >= _MAX_POSTPONEMENTS or not _is_delicate(frame):
        _postponements = 0
        return False
    _postponements += 1
    return signal_reminder.comes_again()


def _is_delicate(frame: FrameType) -> bool:
    code = frame.f_code
    if code.co_filename == threading.__file__:
        return code.co_name in _LOCK_FUNCTIONS
    return code.co_name == "__del__" or code.co_filename.startswith(_BOOKKEEPING)


@functools.cache
def _end_in_one_line() -> None:
    """Print one line instead of a traceback if the program does not catch the signal's exception.

    After the signal that is KeyboardInterrupt, or the exception of a method that refuses to work
    after the shutdown.
    """
    others, others_of_threads = sys.excepthook, threading.excepthook

    def tell(
        kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        if not _told(kind, error):
            others(kind, error, traceback)

    def tell_of_thread(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is None or not _told(args.exc_type, args.exc_value):
            others_of_threads(args)

    sys.excepthook, threading.excepthook = tell, tell_of_thread


def _told(kind: type[BaseException], error: BaseException) -> bool:
    """Print an exception that the signal has caused; returns whether it was one."""
    if isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:  # of an AsyncNode
        return _told(type(error.exceptions[0]), error.exceptions[0])
    if issubclass(kind, KeyboardInterrupt):
        print("KeyboardInterrupt", file=sys.stderr)
        return True
    # By name: the modules of these exceptions import this one.
    if kind.__name__ not in _OF_SHUTDOWN or not kind.__module__.endswith(_MODULES):
        return False
    reason = f": {error}" if str(error) else ""
    print(f"{kind.__name__}{reason} (a signal has shut rclpy down)", file=sys.stderr)
    return True


@functools.cache
def _shorten_tracebacks_of_threads() -> None:
    """Show only the program's lines if a callback ends a thread that spins."""
    others = threading.excepthook

    def show(args: threading.ExceptHookArgs) -> None:
        kind, error = args.exc_type, args.exc_value
        if error is not None:
            excepthook.keep_program_frames(error)
            args = threading.ExceptHookArgs((kind, error, error.__traceback__, args.thread))
        others(args)

    threading.excepthook = show


@functools.cache
def _end_quietly() -> None:
    """Print nothing about Ctrl-C while Python ends, where no program could catch it."""
    others = sys.unraisablehook

    def tell(unraisable: sys.UnraisableHookArgs) -> None:
        if not (issubclass(unraisable.exc_type, KeyboardInterrupt) and _python_ends()):
            others(unraisable)

    sys.unraisablehook = tell


def _python_ends() -> bool:
    main = threading.main_thread()
    return not main.is_alive() or getattr(threading, "_SHUTTING_DOWN", False)


if hasattr(os, "register_at_fork"):
    # A child process has none of the nodes, and must end when a process pool terminates it.
    os.register_at_fork(after_in_child=uninstall_signal_handlers)
