"""The levels of loggers, and the outputs of the log: the console, and `/rosout` through nodes."""

from __future__ import annotations

import os
import sys
import threading
import time
import weakref
from collections.abc import Callable
from typing import TextIO

from ...impl.logging_severity import LoggingSeverity
from ..arguments import Arguments
from .format import DEFAULT, Format, Record, coloured

SEPARATOR = "."
"""Between the name of a logger and that of its child."""

DEFAULT_LEVEL = int(LoggingSeverity.INFO)
"""The level of all loggers, unless somebody sets another."""

_levels: dict[str, int] = {"": DEFAULT_LEVEL}
_effective: dict[str, int] = {}  # found once: every line that is logged asks


def set_level(name: str, level: int) -> None:
    """Set the level of a logger, of all loggers by the name ""."""
    _levels[name] = level
    _effective.clear()


def level_of(name: str) -> int:
    """The level that was set for just this logger; 0 where there is none."""
    return _levels.get(name, 0)


def effective_level_of(name: str) -> int:
    """The level that holds for a logger."""
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


_rosout: dict[str, weakref.WeakMethod[Callable[[Record], None]]] = {}
_lock = threading.Lock()  # lines of several threads stay whole
_console: _Console | None = None
_owners: weakref.WeakSet[object] = weakref.WeakSet()
"""Contexts that are up."""
_to_console = True
_to_rosout = True


class _Console:
    """The settings of the environment, read once."""

    def __init__(self) -> None:
        self.stdout = bool(_from_environment("RCUTILS_LOGGING_USE_STDOUT", "stderr", "stdout"))
        buffered = _from_environment("RCUTILS_LOGGING_BUFFERED_STREAM", "no", "by lines")
        self.flush = buffered is not None
        self.colours = _from_environment("RCUTILS_COLORIZED_OUTPUT", "no color", "force color")
        self.format = Format(os.environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT)

    def write(self, record: Record) -> None:
        # Looked up each time: notebooks and tests put others in their place.
        stream = sys.stdout if self.stdout else sys.stderr
        if stream is None:  # a program without a console
            return
        line = self.format.line(record)
        if _is_a_terminal(stream) if self.colours is None else self.colours:
            line = coloured(record.severity, line)
        with _lock:
            _write(stream, line + "\n")
            if self.flush:
                stream.flush()


def _is_a_terminal(stream: TextIO) -> bool:
    return stream.isatty()


def _write(stream: TextIO, text: str) -> None:
    try:
        stream.write(text)
    except UnicodeEncodeError:  # a console of another code page
        encoding = stream.encoding
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))


def _from_environment(name: str, zero: str, one: str) -> bool | None:
    """A variable that is 0 or 1; None where it is not set. Raises RuntimeError otherwise."""
    value = os.environ.get(name, "")
    if value in ("", "0", "1"):
        return bool(int(value)) if value else None
    raise RuntimeError(
        f"failed to initialize logging: Warning: unexpected value [{value}] specified for {name}."
        f" Valid values are 0 ({zero}) or 1 ({one})."
    )


def initialize() -> None:
    """Read the environment, unless that was done."""
    global _console
    if _console is None:
        _console = _Console()


def shut_down() -> None:
    """Forget all levels; the environment is read again when something is logged."""
    global _console
    _console = None
    clear_levels()


def begin(context: object, arguments: Arguments) -> None:
    """A context is initialised: the first one's ROS arguments say what is logged, and where."""
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
    """A context that `begin` was called for has ended."""
    global _to_console, _to_rosout
    _owners.discard(context)
    if not _owners:
        _to_console = _to_rosout = True


def add_rosout(name: str, publish: Callable[[Record], None]) -> None:
    """From now on, hand what the logger and its children log to a method that publishes it.

    It is not kept alive. ROS warns of the second node of a name, and so do we.
    """
    if name in _rosout and _rosout[name]() is not None:
        warn(
            "rcl.logging_rosout",
            f"Publisher already registered for node name: '{name}'. If this is due to multiple"
            f" nodes with the same name then all logs for the logger named '{name}' will go out"
            " over the existing publisher. As soon as any node with that name is destructed it"
            " will unregister the publisher, preventing any further logs for that name from being"
            " published on the rosout topic.",
        )
        return
    _rosout[name] = weakref.WeakMethod(publish)


def remove_rosout(name: str) -> None:
    """The node is gone."""
    _rosout.pop(name, None)


def warn(name: str, message: str) -> None:
    """Log a warning that is not the program's, under the name of a part of ROS."""
    if effective_level_of(name) <= LoggingSeverity.WARN:
        log(Record(LoggingSeverity.WARN, name, message, time.time_ns(), "", "", 0))


def log(record: Record) -> None:
    """Write a record to the console, and hand it to the node whose logger it came from."""
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
    name = record.name
    while name:
        if (known := _rosout.get(name)) is not None and (publish := known()) is not None:
            publish(record)
            return
        name = name.rpartition(SEPARATOR)[0]
