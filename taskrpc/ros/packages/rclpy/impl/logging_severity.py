"""The severity of a line of the log."""

from __future__ import annotations

from enum import IntEnum


class LoggingSeverity(IntEnum):
    """The severities, from details for debugging to errors that end the program."""

    UNSET = 0
    """As the level of a logger: the level of its parent applies."""
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50
