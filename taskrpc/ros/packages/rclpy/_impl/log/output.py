"""The levels of loggers, and the outputs of the log: the console, and `/rosout` through nodes."""

from __future__ import annotations

import os
import sys
import threading
import time
import weakref
from collections.abc import Callable
from typing import TextIO

from taskrpc.spi import current_program

from ...impl.logging_severity import LoggingSeverity
from ..arguments import Arguments
from .format import DEFAULT, Format, Record, coloured

SEPARATOR = "."
"""Separates the name of a logger from that of its child."""

DEFAULT_LEVEL = int(LoggingSeverity.INFO)
"""The default level of all loggers."""

_levels: dict[str, int] = {"": DEFAULT_LEVEL}
_effective: dict[str, int] = {}  # a cache: every log call reads it


def set_level(name: str, level: int) -> None:
    """Set the level of a logger; the name "" sets the default level of all loggers."""
    _levels[name] = level
    _effective.clear()


def level_of(name: str) -> int:
    """The level that was set for this logger itself; 0 without one."""
    return _levels.get(name, 0)


def effective_level_of(name: str) -> int:
    """The level that applies to a logger: its own or that of its nearest ancestor."""
    level = _effective.get(name)
    if level is None:
        level = _effective[name] = _find(name)
    return level


def _find(name: str) -> int:
    ancestor = name
    while ancestor:
        if level := level_of(ancestor):
            return level
        ancestor = ancestor.rpartition(SEPARATOR)[0]
    return level_of("")


def clear_levels() -> None:
    """Forget every level that was set."""
    _levels.clear()
    _levels[""] = DEFAULT_LEVEL
    _effective.clear()


_rosout: dict[tuple[str, str], weakref.WeakMethod[Callable[[Record], None]]] = {}
"""The method that publishes the lines of a logger, by the program's and the logger's name."""
_lock = threading.Lock()  # so that lines of several threads do not mix
_console: _Console | None = None
_owners: weakref.WeakSet[object] = weakref.WeakSet()
"""The contexts between `init` and `shutdown`."""
_to_console = True
_to_rosout = True


class _Console:
    """The console and its settings from the environment, which are read once."""

    def __init__(self) -> None:
        self.stdout = bool(_from_environment("RCUTILS_LOGGING_USE_STDOUT", "stderr", "stdout"))
        buffered = _from_environment("RCUTILS_LOGGING_BUFFERED_STREAM", "no", "by lines")
        self.flush = buffered is not None
        self.colours = _from_environment("RCUTILS_COLORIZED_OUTPUT", "no color", "force color")
        self.format = Format(os.environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT)

    def write(self, record: Record) -> None:
        # Looked up each time: notebooks and tests replace the streams.
        stream = sys.stdout if self.stdout else sys.stderr
        if stream is None:  # the program has no console
            return
        line = self.format.line(record)
        if stream.isatty() if self.colours is None else self.colours:
            line = coloured(record.severity, line)
        with _lock:
            _write(stream, line + "\n")
            if self.flush:
                stream.flush()


def _write(stream: TextIO, text: str) -> None:
    try:
        stream.write(text)
    except UnicodeEncodeError:  # the encoding of the console lacks a character
        encoding = stream.encoding
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))


def _from_environment(name: str, zero: str, one: str) -> bool | None:
    """Read a variable that is 0 or 1; None if it is unset. Raises RuntimeError for other values."""
    value = os.environ.get(name, "")
    if value in ("", "0", "1"):
        return bool(int(value)) if value else None
    raise RuntimeError(
        f"failed to initialize logging: Warning: unexpected value [{value}] specified for {name}."
        f" Valid values are 0 ({zero}) or 1 ({one})."
    )


def initialize() -> None:
    """Read the environment, unless it has been read."""
    global _console
    if _console is None:
        _console = _Console()


def shut_down() -> None:
    """Forget all levels; the next line of the log reads the environment again."""
    global _console
    _console = None
    clear_levels()


def begin(context: object, arguments: Arguments) -> None:
    """Register an initialised context; the ROS arguments of the first one configure the log."""
    global _to_console, _to_rosout
    initialize()
    _owners.add(context)
    if len(_owners) > 1:
        return
    if arguments.log_level is not None:
        set_level("", arguments.log_level or DEFAULT_LEVEL)
    for name, level in arguments.log_levels.items():
        set_level(name, level)
    _to_console = arguments.stdout_logs is not False
    _to_rosout = arguments.rosout_logs is not False
    for warning in arguments.warnings:
        warn("rcl", warning)


def end(context: object) -> None:
    """Unregister a context at its shutdown."""
    global _to_console, _to_rosout
    _owners.discard(context)
    if not _owners:
        _to_console = _to_rosout = True


def add_rosout(name: str, publish: Callable[[Record], None]) -> None:
    """Pass the lines of a logger and its children to a method that publishes them.

    Only a weak reference is kept. Like ROS, this warns of a second node of the same name.
    """
    key = (current_program.get(), name)
    if key in _rosout and _rosout[key]() is not None:
        warn(
            "rcl.logging_rosout",
            f"Publisher already registered for node name: '{name}'. If this is due to multiple"
            f" nodes with the same name then all logs for the logger named '{name}' will go out"
            " over the existing publisher. As soon as any node with that name is destructed it"
            " will unregister the publisher, preventing any further logs for that name from being"
            " published on the rosout topic.",
        )
        return
    _rosout[key] = weakref.WeakMethod(publish)


def remove_rosout(name: str) -> None:
    """Stop publishing the lines of a logger: its node is destroyed."""
    _rosout.pop((current_program.get(), name), None)


def warn(name: str, message: str) -> None:
    """Log a warning of rclpy under the name of the part of ROS that would log it."""
    if effective_level_of(name) <= LoggingSeverity.WARN:
        log(Record(LoggingSeverity.WARN, name, message, time.time_ns(), "", "", 0))


def log(record: Record) -> None:
    """Write a record to the console and publish it through the node that owns the logger."""
    initialize()
    assert _console is not None
    if record.severity is LoggingSeverity.UNSET:
        print("unknown severity level: 0", file=sys.stderr)
        return
    if _to_console:
        _console.write(record)
    if _to_rosout and _rosout:
        _publish(record)


def _publish(record: Record) -> None:
    program, name = current_program.get(), record.name
    while name:
        if (known := _rosout.get((program, name))) is not None and (publish := known()) is not None:
            publish(record)
            return
        name = name.rpartition(SEPARATOR)[0]
