"""Exceptions with the lines of the user's files only."""

from __future__ import annotations

import os
import traceback
from pathlib import Path


def explained(error: BaseException, folder: Path) -> str:
    """Return an exception with the lines of the user's files only."""
    told = traceback.TracebackException.from_exception(error)
    _keep_own_lines(told, f"{folder}{os.sep}", set())
    return "".join(told.format())


def failed_line(error: BaseException, folder: Path) -> str:
    """Return the last line of the user's files that an exception passed, with its text."""
    told = traceback.TracebackException.from_exception(error)
    own = [frame for frame in told.stack if frame.filename.startswith(f"{folder}{os.sep}")]
    if not own:
        return type(error).__name__
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}  {own[-1].line}"


def _keep_own_lines(told: traceback.TracebackException | None, folder: str, seen: set[int]) -> None:
    if told is None or id(told) in seen:
        return
    seen.add(id(told))
    own = [frame for frame in told.stack if frame.filename.startswith(folder)]
    told.stack = traceback.StackSummary.from_list(own)
    _keep_own_lines(told.__cause__, folder, seen)
    _keep_own_lines(told.__context__, folder, seen)
