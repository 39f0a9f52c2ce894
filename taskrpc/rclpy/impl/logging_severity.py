"""How serious a line of a log is."""

from __future__ import annotations

from enum import IntEnum


class LoggingSeverity(IntEnum):
    """From what helps in finding a mistake to what ends the program."""

    UNSET = 0
    """Of a logger: as the logger above it."""
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50
