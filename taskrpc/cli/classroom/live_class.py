"""The students of a class for the live page: who is connected, and when each one last called."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Mapping
from pathlib import Path
from typing import Any, Protocol

from taskrpc.classroom.attendance import last_calls
from taskrpc.classroom.register import Register


class StudentCalls(Protocol):
    """The calls of one account since the server started."""

    calls: int
    last: float


class LiveClass:
    """Returns the students of a class when it is called.

    Args:
        folder: the folder of the class's register.
        calls: the calls of each account.
        connected: returns the accounts that have an open connection.
    """

    def __init__(
        self,
        folder: Path,
        calls: Mapping[str, StudentCalls],
        connected: Callable[[], Container[str]],
    ) -> None:
        self._register = Register(folder)
        self._earlier = last_calls(self._register.attendance_file)
        """Each account's last call before the server started."""
        self._calls = calls
        self._connected = connected

    def __call__(self) -> list[dict[str, Any]]:
        """Return all students whose accounts are valid, in the order of the list."""
        connected, written, now = self._connected(), self._register.names(), time.time()
        students = []
        for account in self._register.accounts():
            if account.refusal(now):
                continue
            name, calls = account.name, self._calls.get(account.name)
            students.append(
                {
                    "name": written.get(name, name),
                    "last_seen": calls.last if calls else self._earlier.get(name),
                    "calls": calls.calls if calls else 0,
                    "connected": name in connected,
                }
            )
        return students
