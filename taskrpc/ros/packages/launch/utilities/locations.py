"""Lines of launch files, for error messages."""

from __future__ import annotations

import contextlib
import os
import sys
import sysconfig
import traceback
from types import FrameType, TracebackType

_PACKAGES = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
_VISITOR = os.path.join(_PACKAGES, "launch", "launch_description_entity.py")
_LIBRARIES = {sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib", "scripts")}
_TASKRPC = os.path.dirname(os.path.dirname(_PACKAGES))
_FOREIGN = ("<", *(os.path.join(folder, "") for folder in (_TASKRPC, *_LIBRARIES)))
_LOCATION = "_location_in_launch_file"


def location_of_caller() -> str:
    """The innermost line that belongs to a launch file or its package; "" if there is none."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        file = frame.f_code.co_filename
        if _is_of_a_launch_file(file):
            return f"{file}, line {frame.f_lineno}"
        # What calls the visitor is not the launch file that is being executed.
        frame = None if file == _VISITOR else frame.f_back
    return ""


def location_in(trace: TracebackType | None) -> str:
    """As `location_of_caller`, in a traceback."""
    found = ""
    for frame in traceback.extract_tb(trace):
        if _is_of_a_launch_file(frame.filename):
            found = f"{frame.filename}, line {frame.lineno}"
    return found


def remember_location(error: BaseException, location: str) -> None:
    """Remember where an error belongs whose traceback has no line of a launch file."""
    if location and not location_of(error):
        with contextlib.suppress(AttributeError):  # a class with slots
            setattr(error, _LOCATION, location)


def location_of(error: BaseException) -> str:
    """The line of the launch file to which an error belongs; "" if it is unknown."""
    return location_in(error.__traceback__) or getattr(error, _LOCATION, "")


def _is_of_a_launch_file(file: str) -> bool:
    return not file.startswith(_FOREIGN)
