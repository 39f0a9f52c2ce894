"""Loggers by name, and their levels."""

from __future__ import annotations

import os
from pathlib import Path

from ._impl.log import output
from .impl.logging_severity import LoggingSeverity
from .impl.rcutils_logger import RcutilsLogger

__all__ = [
    "LoggingSeverity",
    "RcutilsLogger",
    "clear_config",
    "get_logger",
    "get_logger_effective_level",
    "get_logger_level",
    "get_logging_directory",
    "get_logging_severity_from_string",
    "initialize",
    "set_logger_level",
    "shutdown",
]

_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    """The logger of this name; nodes have their own. Raises ValueError for an empty name."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """Read the log settings of the environment; the first line of the log does this, too."""
    output.initialize()


def shutdown() -> None:
    """Forget all levels that were set, and the settings of the environment."""
    output.shut_down()


def clear_config() -> None:
    """Forget all levels that were set, and read the environment again."""
    shutdown()
    initialize()


def set_logger_level(name: str, level: LoggingSeverity | int, detailed_error: bool = False) -> None:
    """Set the level of a logger and its children; "" stands for all loggers.

    Raises ValueError for an unknown severity.
    """
    output.set_level(name, LoggingSeverity(level))


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """The level that applies to a logger."""
    return LoggingSeverity(output.effective_level_of(name))


def get_logger_level(name: str) -> LoggingSeverity:
    """The level that was set for this logger itself; UNSET without one."""
    return LoggingSeverity(output.level_of(name))


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """The severity of a name such as `info`; raises RuntimeError for an unknown name."""
    try:
        return LoggingSeverity[log_severity.upper()]
    except KeyError:
        names = ", ".join(severity.name for severity in LoggingSeverity)
        problem = f"failed to get a logging severity from '{log_severity}': expected one of {names}"
        raise RuntimeError(problem) from None


def get_logging_directory() -> Path:
    """The folder of ROS's log files: ROS_LOG_DIR, or `log` in ROS_HOME, or `~/.ros/log`.

    taskrpc writes nothing there.
    """
    if directory := os.environ.get("ROS_LOG_DIR"):
        return Path(directory).expanduser()
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "log"
