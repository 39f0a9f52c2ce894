"""What a group of a class leaves behind: its students and its tasks, in a dated file."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from taskrpc.course.classroom.attendance import last_calls
from taskrpc.course.classroom.register import Register
from taskrpc.spi import private_files

FOLDER = "archive"
"""The folder of these files in the folder of the class."""


def write_archive(
    register: Register, tasks: Sequence[Any], now: float, service: str = "/robot_task"
) -> Path | None:
    """Write the students and the tasks of a group; returns the file, None if there is nothing.

    Only this user can read the file. Raises OSError.
    """
    seen, written = last_calls(register.attendance_file), register.names()
    if not tasks and not seen:
        return None
    students = [
        {"name": written.get(account, account), "account": account, "last_call": last}
        for account, last in seen.items()
    ]
    content = {"ended": now, "service": service, "students": students, "tasks": tasks}
    path = _free_path(private_files.private_dir(register.folder / FOLDER), now)
    encoded = msgspec.json.encode(content, enc_hook=dict)  # results are read-only mappings
    private_files.write_private(path, msgspec.json.format(encoded, indent=1))
    return path


def summary(count: int, path: Path | None, problem: str = "") -> str:
    """Return what a reset has done, in words.

    Args:
        count: the number of tasks in the archive.
        path: the archive; None if there is none.
        problem: why the robot is not at its start.
    """
    tasks = "1 task" if count == 1 else f"{count} tasks"
    kept = f"{tasks} of the former group: {path}" if path else "there was nothing to keep"
    return f"the queue is empty and {problem or 'the robot is at its start'}; {kept}"


def _free_path(folder: Path, now: float) -> Path:
    name = time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(now))
    path, number = folder / f"{name}.json", 2
    while path.exists():
        path, number = folder / f"{name}_{number}.json", number + 1
    return path
