"""The logger of a node or of a part of a program."""

from __future__ import annotations

import os
import sys
import time
from types import FrameType
from typing import Any, NamedTuple, Self

from .._impl.log import output
from .._impl.log.filters import (
    Context,
    LoggingFilter,
    Once,
    SkipFirst,
    Throttle,
    get_filters_from_kwargs,
    supported_filters,
)
from .._impl.log.format import Record
from .._impl.log.option_types import (
    LoggingArgs,
    LoggingFilterArgs,
    LoggingFilterParams,
    OnceContext,
    RcutilsLoggerContext,
    SkipFirstContext,
    ThrottleContext,
)
from .logging_severity import LoggingSeverity

__all__ = [
    "CallerId",
    "LoggingArgs",
    "LoggingFilter",
    "LoggingFilterArgs",
    "LoggingFilterParams",
    "LoggingSeverity",
    "Once",
    "OnceContext",
    "RcutilsLogger",
    "RcutilsLoggerContext",
    "SkipFirst",
    "SkipFirstContext",
    "Throttle",
    "ThrottleContext",
    "get_filters_from_kwargs",
    "supported_filters",
]


class _LogCall(NamedTuple):
    function_name: str
    file_path: str
    line_number: int
    last_index: int


class CallerId(_LogCall):
    """A place in a program that logs; two calls on one line are two places."""

    __slots__ = ()

    def __new__(cls, frame: FrameType | None = None) -> Self:
        """The place of a frame, by default of the first frame outside of this module."""
        if frame is None:
            frame = _caller()
        code = frame.f_code
        return super().__new__(cls, code.co_name, code.co_filename, frame.f_lineno, frame.f_lasti)


class RcutilsLogger:
    """Logs under a name; `node.get_logger()` and `rclpy.logging.get_logger(name)` return one.

    Every method that logs takes `throttle_duration_sec=` (with `throttle_time_source_type=`, a
    clock), `skip_first=True` and `once=True`. These options apply to one place in the program.
    The method returns whether it logged. It raises TypeError for an unknown option and for a
    message that is not a str, ValueError if one place changes its severity, name or options.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.contexts: dict[CallerId, Context] = {}
        """The first log call of each place in the program; its options may not change later."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RcutilsLogger) and other.name == self.name

    def __hash__(self) -> int:
        return hash(self.name)

    def get_child(self, name: str) -> RcutilsLogger:
        """The logger `<this name>.<name>`; it has this logger's level unless its own is set."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        if not isinstance(name, str):
            raise TypeError(f"expected the name of a child logger (str), got {name!r}")
        return RcutilsLogger(f"{self.name}{output.SEPARATOR}{name}" if self.name else name)

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Log lines of this severity or a higher one; with `UNSET`, use the level of the parent."""
        output.set_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """The lowest severity that it logs."""
        return LoggingSeverity(output.effective_level_of(self.name))

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        """Whether it logs lines of this severity."""
        return LoggingSeverity(severity) >= output.effective_level_of(self.name)

    def log(
        self,
        message: str,
        severity: LoggingSeverity | int,
        name: str | None = None,
        **options: Any,
    ) -> bool:
        """Log a message with the severity; `name` logs it under another name."""
        severity = LoggingSeverity(severity)
        if severity < output.effective_level_of(self.name):
            return False
        if name is None:
            name = self.name
        caller = CallerId()
        context = self.contexts.get(caller)
        if context is None:
            context = self.contexts[caller] = _new_context(severity, name, options)
        else:
            _check(context, severity, name, options)
        if not all(supported_filters[kind].should_log(context) for kind in context["filters"]):
            return False
        _emit(severity, name, message, caller)
        return True

    def debug(self, message: str, **options: Any) -> bool:
        """Log details for debugging, which are not shown by default."""
        return self.log(message, LoggingSeverity.DEBUG, **options)

    def info(self, message: str, **options: Any) -> bool:
        """Log normal progress."""
        return self.log(message, LoggingSeverity.INFO, **options)

    def warning(self, message: str, **options: Any) -> bool:
        """Log something unusual; the program continues."""
        return self.log(message, LoggingSeverity.WARN, **options)

    def warn(self, message: str, **options: Any) -> bool:
        """Log as `warning` does."""
        return self.log(message, LoggingSeverity.WARN, **options)

    def error(self, message: str, **options: Any) -> bool:
        """Log a failure."""
        return self.log(message, LoggingSeverity.ERROR, **options)

    def fatal(self, message: str, **options: Any) -> bool:
        """Log a failure after which the program cannot continue."""
        return self.log(message, LoggingSeverity.FATAL, **options)


def _new_context(severity: LoggingSeverity, name: str, options: dict[str, Any]) -> Context:
    """The context of a place in the program that logs for the first time."""
    filters = get_filters_from_kwargs(**options) if options else []
    context: Context = {"name": name, "severity": severity, "filters": filters}
    for kind in filters:
        supported_filters[kind].initialize_context(context, **options)
    return context


def _check(context: Context, severity: LoggingSeverity, name: str, options: dict[str, Any]) -> None:
    """Refuse options that differ from the place's first log call."""
    if severity is not context["severity"]:
        raise ValueError("Logger severity cannot be changed between calls.")
    if name != context["name"]:
        raise ValueError("Logger name cannot be changed between calls.")
    filters = get_filters_from_kwargs(**options) if options else []
    if filters != context["filters"]:
        raise ValueError("Requested logging filters cannot be changed between calls.")
    for kind in filters:
        for option, default in supported_filters[kind].params.items():
            if context[option] != options.get(option, default):
                raise ValueError("Logging filter parameters cannot be changed between calls.")


def _emit(severity: LoggingSeverity, name: str, message: object, caller: CallerId) -> None:
    if message is None or isinstance(message, (bytes, bytearray)):
        message = _text_of(message)
    if not isinstance(message, str):
        raise TypeError(
            "rclpy_logging_rcutils_log(): incompatible function arguments: expected a str as the"
            f" message, got {message!r} of type {type(message).__name__}"
        )
    if severity >= output.effective_level_of(name):
        function, file, line, _ = caller
        path = os.path.abspath(file)
        output.log(Record(severity, name, message, time.time_ns(), function, path, line))


def _text_of(message: bytes | bytearray | None) -> str:
    """The text that ROS prints for a message of None or bytes."""
    return "(null)" if message is None else message.decode(errors="backslashreplace")


def _caller() -> FrameType:
    """The frame of the program that called a logger."""
    frame: FrameType = sys._getframe(1)
    while frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    return frame
