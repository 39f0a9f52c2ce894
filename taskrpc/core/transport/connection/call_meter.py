"""Measures a program's calls while another program watches it, and only then.

The routes of the other connections get an observer while a connection watches. Without watchers,
calls take the same path as in a program that was never watched.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol

import msgspec

from taskrpc.core.callinfo import CallInfo
from taskrpc.core.observer import Observer, Observers
from taskrpc.core.transport.base import IncomingCall, Offer
from taskrpc.core.wire.statistics import ServiceStatistics, Statistics, bucket_of
from taskrpc.errors import Code

MAX_CALLERS = 256
"""Callers with a count of their own; calls of others count as `OTHERS`."""

OTHERS = "(others)"


class Watcher(Protocol):
    """A connection whose program watches; its own calls are not measured."""

    def measure(self) -> None:
        """Begin or end the measuring of later calls."""


class _ServiceCounts:
    """The ended calls of one service."""

    def __init__(self) -> None:
        self.codes: Counter[int] = Counter()
        self.durations: Counter[int] = Counter()


class CallMeter(Observer):
    """Counts the ended calls of a program's services, from its construction on.

    Args:
        clock: the event loop's clock.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.watchers: dict[Watcher, None] = {}
        self._clock = clock
        self._since = clock()
        self._services: dict[str, _ServiceCounts] = {}
        self._callers: Counter[str] = Counter()

    def measured(self, offer: Offer) -> Offer:
        """Return the offer with this meter as its observer, beside the one that it has."""
        own = offer.observer
        observer = self if own is None else Observers(own, self)
        return msgspec.structs.replace(offer, observer=observer)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """Count a call that has ended."""
        counts = self._services.get(call.service)
        if counts is None:
            counts = self._services[call.service] = _ServiceCounts()
        counts.codes[int(code)] += 1
        counts.durations[bucket_of(seconds)] += 1
        known = call.caller in self._callers or len(self._callers) < MAX_CALLERS
        self._callers[call.caller if known else OTHERS] += 1

    def statistics(
        self, services: Iterable[str], calls: Iterable[IncomingCall], connections: int, cpu: float
    ) -> Statistics:
        """Return the counts.

        Args:
            services: the offered services.
            calls: the calls that have no response yet.
            connections, cpu: as in `Statistics`.
        """
        running: Counter[str] = Counter()
        waiting: Counter[str] = Counter()
        for call in calls:
            (running if call.started else waiting)[call.service] += 1
        return Statistics(
            self._clock(),
            self._since,
            cpu,
            connections,
            [self._of_service(name, running[name], waiting[name]) for name in services],
            dict(self._callers),
        )

    def _of_service(self, name: str, running: int, waiting: int) -> ServiceStatistics:
        counts = self._services.get(name) or _ServiceCounts()
        codes, durations = dict(counts.codes), dict(counts.durations)
        return ServiceStatistics(name, running, waiting, codes, durations)
