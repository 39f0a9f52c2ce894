"""Formats the lines of the log by RCUTILS_CONSOLE_OUTPUT_FORMAT."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime
from typing import NamedTuple

from ...impl.logging_severity import LoggingSeverity

DEFAULT = "[{severity}] [{time}] [{name}]: {message}"
"""The format if the environment sets no other."""

NORMAL = "\033[0m"
"""Ends a colour."""

_GREEN, _YELLOW, _RED = "\033[32m", "\033[33m", "\033[31m"
_COLOURS = {10: _GREEN, 20: NORMAL, 30: _YELLOW, 40: _RED, 50: _RED}
_ESCAPES = {"a": "\a", "b": "\b", "n": "\n", "r": "\r", "t": "\t"}
_LONGEST = 2047
"""The characters of a format that ROS reads."""


class Record(NamedTuple):
    """One line of the log, before it is formatted."""

    severity: LoggingSeverity
    name: str
    """The name of the logger."""
    message: str
    nanoseconds: int
    """The time since 1970."""
    function: str
    file: str
    line: int


def _time(record: Record) -> str:
    return f"{record.nanoseconds // 10**9:010d}.{record.nanoseconds % 10**9:09d}"


def _date(record: Record) -> str:
    moment = datetime.fromtimestamp(record.nanoseconds // 10**9)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{record.nanoseconds // 10**6 % 1000:03d}"


_TOKENS: dict[str, Callable[[Record], str]] = {
    "severity": lambda record: record.severity.name,
    "name": lambda record: record.name,
    "message": lambda record: record.message,
    "function_name": lambda record: record.function,
    "file_name": lambda record: record.file,
    "short_file_name": lambda record: re.split(r"[/\\]", record.file)[-1],
    "time": _time,
    "time_as_nanoseconds": lambda record: f"{record.nanoseconds:019d}",
    "date_time_with_ms": _date,
    "line_number": lambda record: str(record.line),
}


class Format:
    """A format; text that is not a token stays unchanged."""

    def __init__(self, text: str) -> None:
        parts = re.split("({(?:" + "|".join(_TOKENS) + ")})", text[:_LONGEST])
        self._tokens = [_TOKENS[part[1:-1]] for part in parts[1::2]]
        self._between = [_unescaped(part) for part in parts[::2]]

    def line(self, record: Record) -> str:
        """The line for a record, without the line break."""
        pieces = [self._between[0]]
        for token, text in zip(self._tokens, self._between[1:], strict=True):
            pieces += token(record), text
        return "".join(pieces)


def coloured(severity: int, line: str) -> str:
    """The line in the colour of its severity, for a terminal."""
    return f"{_COLOURS[severity]}{line}{NORMAL}"


def _unescaped(text: str) -> str:
    text = re.sub(r"\\([abnrt])", lambda found: _ESCAPES[found[1]], text)
    return re.sub(r"\\(?:x1b|033)", "\033", text, flags=re.IGNORECASE)
