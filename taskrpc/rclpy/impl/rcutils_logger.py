"""The logger of a node or of a part of a program."""

from __future__ import annotations

import os
import sys
import time
from types import FrameType
from typing import Any, NamedTuple

from . import log_levels, log_output
from .log_filters import LoggingFilter, filters_of, settings
from .log_format import Record
from .logging_severity import LoggingSeverity


class CallerId(NamedTuple):
    """A place in a program that logs; two on one line differ."""

    function_name: str
    file_path: str
    line_number: int
    last_index: int


class _CallSite(NamedTuple):
    """What a place in a program logged first; it may not change later."""

    severity: LoggingSeverity
    name: str
    wanted: dict[str, dict[str, Any]]
    filters: list[LoggingFilter]

    def check(
        self, severity: LoggingSeverity, name: str, wanted: dict[str, dict[str, Any]]
    ) -> None:
        if severity is not self.severity:
            raise ValueError("Logger severity cannot be changed between calls.")
        if name != self.name:
            raise ValueError("Logger name cannot be changed between calls.")
        if wanted.keys() != self.wanted.keys():
            raise ValueError("Requested logging filters cannot be changed between calls.")
        if wanted != self.wanted:
            raise ValueError("Logging filter parameters cannot be changed between calls.")


class RcutilsLogger:
    """Logs under a name; `node.get_logger()` and `rclpy.logging.get_logger(name)` give one.

    Every method that logs takes `throttle_duration_sec=` (with `throttle_time_source_type=`, a
    clock), `skip_first=True` and `once=True`, which hold for the line of the program that says
    them, and returns whether it logged. It raises TypeError for another option or a message that
    is no text, ValueError where one line of the program changes severity, name or options.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self._sites: dict[CallerId, _CallSite] = {}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RcutilsLogger) and other.name == self.name

    def __hash__(self) -> int:
        return hash(self.name)

    def get_child(self, name: str) -> RcutilsLogger:
        """A logger named `<this name>.<name>`, whose level is this one's unless it is set."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return RcutilsLogger(f"{self.name}{log_levels.SEPARATOR}{name}" if self.name else name)

    def set_level(self, level: LoggingSeverity | int) -> None:
        """Log from this severity on; `UNSET` goes back to what holds for the parent."""
        log_levels.set_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """From which severity on it logs."""
        return LoggingSeverity(log_levels.effective_level_of(self.name))

    def is_enabled_for(self, severity: LoggingSeverity | int) -> bool:
        """Whether it logs lines of this severity."""
        return LoggingSeverity(severity) >= log_levels.effective_level_of(self.name)

    def log(self, message: str, severity: LoggingSeverity | int, **options: Any) -> bool:
        """Log a message with the severity; `name=` logs it under another name."""
        severity = LoggingSeverity(severity)
        if severity < log_levels.effective_level_of(self.name):
            return False
        name = options.pop("name", self.name)
        wanted = settings(options) if options else {}
        caller = _caller()
        if (site := self._sites.get(caller)) is None:
            site = self._sites[caller] = _CallSite(severity, name, wanted, filters_of(wanted))
        else:
            site.check(severity, name, wanted)
        if not all(each.should_log() for each in site.filters):
            return False
        _emit(severity, name, message, caller)
        return True

    def debug(self, message: str, **options: Any) -> bool:
        """Log what helps in finding a mistake; is not shown by default."""
        return self.log(message, LoggingSeverity.DEBUG, **options)

    def info(self, message: str, **options: Any) -> bool:
        """Log what goes as it should."""
        return self.log(message, LoggingSeverity.INFO, **options)

    def warning(self, message: str, **options: Any) -> bool:
        """Log what is unusual, though the work goes on."""
        return self.log(message, LoggingSeverity.WARN, **options)

    def warn(self, message: str, **options: Any) -> bool:
        """Log as `warning` does."""
        return self.log(message, LoggingSeverity.WARN, **options)

    def error(self, message: str, **options: Any) -> bool:
        """Log what went wrong."""
        return self.log(message, LoggingSeverity.ERROR, **options)

    def fatal(self, message: str, **options: Any) -> bool:
        """Log what the program cannot go on after."""
        return self.log(message, LoggingSeverity.FATAL, **options)


def _emit(severity: LoggingSeverity, name: str, message: object, caller: CallerId) -> None:
    if message is None or isinstance(message, (bytes, bytearray)):
        message = _as_c_takes_it(message)
    if not isinstance(message, str):
        raise TypeError(
            "rclpy_logging_rcutils_log(): incompatible function arguments: expected a str as the"
            f" message, got {message!r} of type {type(message).__name__}"
        )
    if severity >= log_levels.effective_level_of(name):
        function, file, line, _ = caller
        path = os.path.abspath(file)
        log_output.log(Record(severity, name, message, time.time_ns(), function, path, line))


def _as_c_takes_it(message: bytes | bytearray | None) -> str:
    """What ROS prints of a message that is no text, and that C takes for one."""
    return "(null)" if message is None else message.decode(errors="backslashreplace")


def _caller() -> CallerId:
    """The place in the program that called a logger."""
    frame: FrameType = sys._getframe(1)
    while frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    code = frame.f_code
    return CallerId(code.co_name, code.co_filename, frame.f_lineno, frame.f_lasti)
