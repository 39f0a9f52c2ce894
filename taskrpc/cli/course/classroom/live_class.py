"""The students of a class for the live page: who is connected, who is stuck and why."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from taskrpc.course.classroom.attendance import last_calls
from taskrpc.course.classroom.progress import Signs, progress
from taskrpc.course.classroom.register import Register
from taskrpc.observe.web.calls import AccountCalls
from taskrpc.spi import Connections

RECENT = 60.0
"""Seconds after a call for which a student counts as connected: a command such as `taskrpc-call`
has a connection only while it calls."""


class LiveClass:
    """Returns the students of a class when it is called.

    Args:
        folder: the folder of the class's register.
        calls: the calls of each account.
        presence: returns the accounts that have an open connection.
        queued: returns the account of each queued task.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        folder: Path,
        calls: Mapping[str, AccountCalls],
        presence: Callable[[], Connections],
        queued: Callable[[], Iterable[str]] = lambda: (),
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._register = Register(folder)
        self._earlier = last_calls(self._register.attendance_file)
        """Each account's last call before the server started."""
        self._calls = calls
        self._presence = presence
        self._queued = queued
        self._wall_clock = wall_clock
        self._seen: dict[str, float] = {}
        """When each account was first seen connected."""

    def __call__(self) -> list[dict[str, Any]]:
        """Return all students whose accounts are valid, in the order of the list."""
        now, presence = self._wall_clock(), self._presence()
        written, queued = self._register.names(), Counter(self._queued())
        students = []
        for account in self._register.accounts():
            if account.refusal(now):
                continue
            name, calls = account.name, self._calls.get(account.name)
            signs = self._signs(name, calls, is_connected=name in presence.accounts, now=now)
            students.append(
                {
                    "name": written.get(name, name),
                    "last_seen": calls.last if calls else self._earlier.get(name),
                    "calls": calls.calls if calls else 0,
                    "connected": signs.connected or _called_recently(calls, now),
                    "queued": queued[name],
                    "progress": progress(signs, now),
                    "begun": signs.begun,
                    "problem": _problem(calls, presence.failed_lookups.get(name)),
                }
            )
        return students

    def forget(self) -> None:
        """Forget what is known of the students: the next group begins."""
        self._earlier.clear()
        self._seen.clear()

    def _signs(
        self, name: str, calls: AccountCalls | None, *, is_connected: bool, now: float
    ) -> Signs:
        if is_connected:
            self._seen.setdefault(name, now)
        if calls is None:
            return Signs(is_connected, self._seen.get(name), self._seen.get(name))
        begun = min(calls.first, self._seen.get(name, calls.first))
        return Signs(is_connected, begun, calls.last, calls.succeeded)


def _called_recently(calls: AccountCalls | None, now: float) -> bool:
    return calls is not None and now - calls.last < RECENT


def _problem(
    calls: AccountCalls | None, failed_lookup: tuple[str, bool] | None
) -> dict[str, Any] | None:
    """Return why the student's last call failed; None if it succeeded, or there was none."""
    if failed_lookup is not None:
        service, exists = failed_lookup
        return {"service": service, "code": "TYPE_MISMATCH" if exists else "UNAVAILABLE"}
    if calls is None or calls.problem is None:
        return None
    found: dict[str, Any] = msgspec.to_builtins(calls.problem)
    return found
