"""The output of a launch: log lines, the lines of the started programs, and the log file."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

_FORMAT = "[%(levelname)s] [%(name)s]: %(message)s"
_COLOURS = {"WARNING": "33", "ERROR": "31", "CRITICAL": "31;1", "DEBUG": "32"}
_STREAMS = ("stdout", "stderr")
_PRESETS: dict[str, dict[str, set[str]]] = {
    "screen": {"stdout": {"screen"}, "stderr": {"screen"}},
    "log": {"stdout": {"log"}, "stderr": {"log", "screen"}},
    "both": {"stdout": {"screen", "log"}, "stderr": {"screen", "log"}},
    "own_log": {"stdout": {"own_log"}, "stderr": {"own_log"}},
    "full": {"stdout": {"screen", "log", "own_log"}, "stderr": {"screen", "log", "own_log"}},
}
_TARGETS = frozenset({"screen", "log", "own_log"})
_SAID = "warnings that were logged"


class _Screen(logging.Handler):
    """Writes log lines to standard output; on a terminal, problems are coloured."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line."""
        line = self.format(record)
        colour = _COLOURS.get(record.levelname)
        if colour and is_coloured(sys.stdout):
            line = f"\x1b[{colour}m{line}\x1b[0m"
        launch_config.write("screen", line)


class LaunchConfig:
    """Where the output of this process's launches goes."""

    def __init__(self) -> None:
        self.level = logging.INFO
        self._folder: Path | None = None
        self._files: dict[str, TextIO] = {}
        self._loggers: set[str] = set()
        self._handler = _Screen()
        self._handler.setFormatter(logging.Formatter(_FORMAT))

    @property
    def log_dir(self) -> str:
        """The folder of this launch's log files; creates it at the first use."""
        if self._folder is None:
            moment = time.strftime("%Y-%m-%d-%H-%M-%S")
            name = f"{moment}-{time.time_ns() // 1000 % 10**6:06}-{socket.gethostname()}"
            self._folder = _log_root() / f"{name}-{os.getpid()}"
            with contextlib.suppress(OSError):  # a full or read-only disk stops no program
                self._folder.mkdir(parents=True, exist_ok=True)
        return str(self._folder)

    @log_dir.setter
    def log_dir(self, folder: str | os.PathLike[str]) -> None:
        self.close()
        self._folder = Path(folder)
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)

    def logger(self, name: str) -> logging.Logger:
        """The logger of this name."""
        logger = logging.getLogger(name)
        if name not in self._loggers:
            self._loggers.add(name)
            to_file = _LogFile()
            to_file.setFormatter(logging.Formatter(f"%(created).7f {_FORMAT}"))
            logger.handlers, logger.propagate = [self._handler, to_file], False
        logger.setLevel(self.level)
        return logger

    def write(self, target: str, line: str) -> None:
        """Write a line to `screen`, to the log of the launch (`log`), or to a file of its own."""
        if target == "screen":
            print(line, flush=True)
            return
        name = "launch.log" if target == "log" else f"{target}.log"
        try:
            file = self._files.get(name)
            if file is None:
                path = Path(self.log_dir) / name
                file = self._files[name] = path.open("a", encoding="utf-8", errors="replace")
            file.write(f"{line}\n")
            file.flush()
        except OSError:
            return

    def close(self) -> None:
        """Close the log files; the next launch gets a folder of its own."""
        for file in self._files.values():
            file.close()
        self._files.clear()
        self._folder = None


class _LogFile(logging.Handler):
    """Writes log lines to the log file of the launch."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line."""
        launch_config.write("log", self.format(record))


launch_config = LaunchConfig()
"""The output of this process's launches."""


def get_logger(name: str | None = None) -> logging.Logger:
    """Return the logger of this name, whose lines look like `[INFO] [name]: text`."""
    return launch_config.logger(name or "launch")


def warn_once(context: Any, text: str) -> None:
    """Log a warning, unless this launch has logged it already."""
    said = context.global_values.setdefault(_SAID, set())
    if text not in said:
        said.add(text)
        get_logger("launch").warning(text)


def is_coloured(stream: TextIO) -> bool:
    """Return whether lines on a stream have colours."""
    return stream.isatty() and not os.environ.get("NO_COLOR")


def output_targets(output: str | Mapping[str, Any]) -> dict[str, set[str]]:
    """Return where standard output and standard error of a program go.

    Args:
        output: `screen`, `log`, `both`, `own_log` or `full`; or for `stdout`, `stderr` and `both`
            the targets `screen`, `log` and `own_log`.

    Raises ValueError for anything else.
    """
    if isinstance(output, str):
        if output not in _PRESETS:
            raise ValueError(
                f"'{output}' is not a valid standard output config:"
                f" expected one of {', '.join(_PRESETS)}"
            )
        return _PRESETS[output]
    found: dict[str, set[str]] = {}
    unknown = set(output) - {*_STREAMS, "both"}
    if unknown:
        raise ValueError(f"expected stdout, stderr or both as an output, got {sorted(unknown)}")
    for stream in _STREAMS:
        targets: set[str] = set()
        for given in (output.get(stream, ()), output.get("both", ())):
            targets |= {given} if isinstance(given, str) else set(given)
        if targets - _TARGETS:
            raise ValueError(
                f"expected screen, log or own_log as targets of {stream}, got {sorted(targets)}"
            )
        found[stream] = targets
    return found


def _log_root() -> Path:
    from rclpy.logging import get_logging_directory  # imports much; only the log file needs it

    return Path(get_logging_directory())
