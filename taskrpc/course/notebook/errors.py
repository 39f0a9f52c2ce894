"""What a cell shows of an error: one line for errors of taskrpc, and for an interrupted wait."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import taskrpc
from srvgen import excepthook
from taskrpc import errors, program

OWN = str(Path(taskrpc.__file__).parent)
"""The folder of taskrpc's own modules."""

Location = Callable[[str, int], str]
"""Turns a file and a line into the beginning of a message."""


def lines_of(error: BaseException, location: Location) -> list[str]:
    """Return the lines that replace a traceback; none if the student needs the traceback."""
    if isinstance(error, KeyboardInterrupt | asyncio.CancelledError):  # the latter at an `await`
        return _interrupted(error.__traceback__, location)
    return excepthook.messages_of(error, is_ours, location, program.suggestion)


_RAISED = (AttributeError, RuntimeError, TypeError, ValueError)
"""Python's errors that taskrpc raises for wrong arguments, mostly because ROS does."""


def is_ours(error: BaseException) -> bool:
    """Whether taskrpc raised the error on purpose.

    In a notebook, also if rclpy has its class, or if the last line of the traceback is taskrpc's.
    """
    if errors.is_ours(error) or type(error).__module__.startswith("rclpy."):
        return True
    frames = _frames(error.__traceback__)
    return isinstance(error, _RAISED) and bool(frames) and frames[-1][0].startswith(OWN)


def _interrupted(traceback: TracebackType | None, location: Location) -> list[str]:
    where, frames = excepthook.program_line(traceback), _frames(traceback)
    if where is None or not any(file.startswith(OWN) for file, _ in frames):
        return []  # it was the student's own code that was interrupted
    line = f"{location(*where)}KeyboardInterrupt: the cell was interrupted while it waited"
    if any(name == "spin" and file.startswith(OWN) for file, name in frames):
        line += "\n  hint: taskrpc.course.notebook.spin(node) spins a node while other cells run"
    return [line]


def _frames(traceback: TracebackType | None) -> list[tuple[str, str]]:
    """The files and functions of a traceback."""
    found = []
    while traceback is not None:
        code = traceback.tb_frame.f_code
        found.append((code.co_filename, code.co_name))
        traceback = traceback.tb_next
    return found
