"""What Ctrl-C and SIGTERM do while rclpy is up: end every context, then what they did before."""

from __future__ import annotations

import enum
import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Any

from . import context as _context


class SignalHandlerOptions(enum.IntEnum):
    """Which signals `rclpy.init` handles."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_handled = SignalHandlerOptions.NO
_before: dict[int, Any] = {}


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Let the signals end every context; without effect outside of the main thread."""
    global _handled
    _handled = SignalHandlerOptions(_handled | options)
    if threading.current_thread() is not threading.main_thread():
        return
    if options & SignalHandlerOptions.SIGINT:
        _install(signal.SIGINT)
    if options & SignalHandlerOptions.SIGTERM:
        _install(signal.SIGTERM)


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Which signals are handled now."""
    return _handled


def uninstall_signal_handlers() -> None:
    """Let the signals do what they did before."""
    global _handled
    _handled = SignalHandlerOptions.NO
    if threading.current_thread() is not threading.main_thread():
        return
    for number, before in _before.items():
        if signal.getsignal(number) is _handle:
            signal.signal(number, before)
    _before.clear()


def _install(number: int) -> None:
    before = signal.getsignal(number)
    if before is not _handle:
        _before[number] = before
        signal.signal(number, _handle)


def _handle(number: int, frame: FrameType | None) -> None:
    before = _before.get(number)
    _context.end_all_by_signal()
    if number == signal.SIGINT:
        _end_in_one_line()
    if callable(before):
        before(number, frame)  # Python's own raises KeyboardInterrupt


def _end_in_one_line() -> None:
    """Have one line told instead of a traceback when the program does not catch the interrupt."""
    others = sys.excepthook

    def tell(
        kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        if issubclass(kind, KeyboardInterrupt):
            print("Interrupted by Ctrl-C", file=sys.stderr)
        else:
            others(kind, error, traceback)

    sys.excepthook = tell
