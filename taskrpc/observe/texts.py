"""Texts of other users, without characters that could control a terminal."""

from __future__ import annotations

from typing import Any


def printable(text: str) -> str:
    """Return another user's text without characters that could control a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def work_of(task: Any) -> str:
    """Return the work of a task, as the task server's messages describe it: `move warehouse`."""
    return printable(f"{task.task_type} {task.target}")
