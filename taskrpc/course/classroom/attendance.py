"""The time of each account's last call; the server writes it, the roster reads it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from taskrpc import CallInfo, Observer
from taskrpc.spi import private_files

WRITE_EVERY = 5.0
"""Seconds between two writes to the disk."""


class Attendance(Observer):
    """Records in a file when each account last called."""

    def __init__(self, path: Path, wall_clock: Callable[[], float] = time.time) -> None:
        self._path = path
        self._wall_clock = wall_clock
        self._seen = last_calls(path)
        self._written = float("-inf")

    def call_began(self, call: CallInfo) -> None:
        """Record the caller."""
        if not call.principal:
            return
        now, is_new = self._wall_clock(), call.principal not in self._seen
        self._seen[call.principal] = now
        if is_new or now - self._written >= WRITE_EVERY:
            self._write(now)

    def clear(self) -> None:
        """Forget all calls: the next group begins."""
        self._seen.clear()
        self._write(self._wall_clock())

    def node_ended(self, node: object) -> None:
        """Write the calls that are not yet in the file."""
        if self._seen:
            self._write(self._wall_clock())

    def _write(self, now: float) -> None:
        self._written = now
        private_files.write_private(self._path, msgspec.json.encode(self._seen), sync=False)


def last_calls(path: Path) -> dict[str, float]:
    """Return each account's last call in seconds since 1970; empty without a readable file."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, float])
    except (OSError, msgspec.MsgspecError):
        return {}
