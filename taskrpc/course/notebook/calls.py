"""The last calls that the nodes of a notebook have made or answered."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

import msgspec

from taskrpc import CallInfo, Observer
from taskrpc.errors import Code
from taskrpc.spi import names

MOST_CALLS = 8
"""Calls that are kept."""


class EndedCall(msgspec.Struct, frozen=True):
    """A call that has ended."""

    number: int
    """Counts the calls."""
    at: float
    """When it ended, in seconds since 1970."""
    caller: str
    """The calling node; "" if a service of another program answered."""
    service: str
    result: str
    """`OK`, or the status code of the error."""
    ms: float


class CallList(Observer):
    """The newest calls of the nodes that it observes; any thread may read them.

    A call between two nodes of the notebook is kept once: as its service saw it.
    """

    def __init__(self, wall_clock: Callable[[], float] = time.time) -> None:
        self._wall_clock = wall_clock
        self._calls: deque[EndedCall] = deque(maxlen=MOST_CALLS)
        self._count = 0
        self._own: set[str] = set()
        """The services that the notebook's nodes have answered."""
        self._lock = threading.Lock()

    def newest(self) -> list[EndedCall]:
        """Return the newest calls, the newest first."""
        with self._lock:
            return list(reversed(self._calls))

    def call_began(self, call: CallInfo) -> None:
        """A call has arrived at a service of the notebook."""
        self._own.add(call.service)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A service of the notebook has answered a call."""
        self._add(call.caller, call.service, code, seconds)

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """A client of the notebook has made a call."""
        if service not in self._own:
            self._add("", service, code, seconds)

    def _add(self, caller: str, service: str, code: Code, seconds: float) -> None:
        if names.is_hidden(caller) or names.is_hidden(service):
            return  # the tools of taskrpc call, such as the picture itself
        with self._lock:
            self._count += 1
            ms = round(seconds * 1000, 1)
            call = EndedCall(self._count, self._wall_clock(), caller, service, code.name, ms)
            self._calls.append(call)
