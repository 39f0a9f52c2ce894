"""The calls of a recording as events of the live page: `calls` and `graph`."""

from __future__ import annotations

import heapq
import math
from bisect import bisect_left, insort
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

from taskrpc.observe.recording.calls import RecordedCall
from taskrpc.observe.recording.decisions import RunStart
from taskrpc.observe.recording.timed_event import TimedEvent
from taskrpc.robot.tasks.page_events import MAX_NODES, client_label

MAX_CALLS = 100
"""The most calls of one event, as on the live page."""
PERIOD = 0.2
"""Seconds between two `calls` events."""
MOST_CALLS = 25_000
"""Most calls that succeeded, and most calls with an error; of more, every n-th is shown."""

_SLOW = 0.05  # seconds after which a call is shown although it has not ended
_SAMPLED = 1000  # the newest calls, for the percentiles
_GRAPH_PERIOD, _MOST_GRAPH_EVENTS = 1.0, 300
_MOST_PAIRS = 10 * MAX_NODES


def call_events(calls: Sequence[RecordedCall], *, period: float = PERIOD) -> Iterator[TimedEvent]:
    """Yield the calls when they end; long and open calls also when they begin.

    `calls` are ordered by their start. The statistics count all of them. The calls of each `period`
    are one event; with 0, each call is one, which is for short recordings.
    """
    statistics = _Statistics()
    batch: list[dict[str, Any]] = []
    selection = _Selection(calls)
    first = time = 0.0
    for time, number, call, ended in _moments(calls):
        if selection.events and time - first >= period:
            yield _calls_event(first + period, batch, selection, statistics)
            batch = []
        if not selection.events:
            first = time
        selection.events += 1
        if selection.has(number, call):
            batch.append(_call(number, call, ended=ended))
        statistics.take(time, call, ended=ended)
    if selection.events:
        yield _calls_event(time, batch, selection, statistics)


def graph_events(
    begin: float, end: float, run: RunStart | None, calls: Sequence[RecordedCall]
) -> Iterator[TimedEvent]:
    """Yield the nodes whenever a new client or a new pair of client and service appears."""
    nodes: dict[str, dict[str, Any]] = {}
    if run is not None:
        nodes[run.node] = _node(run.node, services=run.services)
    period = max(_GRAPH_PERIOD, (end - begin) / _MOST_GRAPH_EVENTS)
    known: set[tuple[str, str]] = set()
    last = begin
    yield TimedEvent(last, "graph", _nodes(nodes))
    is_new = False
    for call in calls:
        if is_new and call.begin - last >= period:
            last, is_new = call.begin, False
            yield TimedEvent(last, "graph", _nodes(nodes))
        if (call.client, call.service) not in known and len(known) < _MOST_PAIRS:
            known.add((call.client, call.service))
            nodes.setdefault(call.client, _node(call.client))["clients"].append(call.service)
            is_new = True
    if is_new:
        yield TimedEvent(calls[-1].begin, "graph", _nodes(nodes))


def _moments(calls: Sequence[RecordedCall]) -> Iterator[tuple[float, int, RecordedCall, bool]]:
    """Yield the starts and ends that are shown, in order: time, number, call, whether it ends.

    Only the calls that are open at one time are in memory twice.
    """
    ends: list[tuple[float, int, RecordedCall]] = []
    for number, call in enumerate(calls, 1):
        while ends and ends[0][0] <= call.begin:
            yield (*heapq.heappop(ends), True)
        ended = None if call.ms is None else call.begin + call.ms / 1e3
        if ended is None or ended - call.begin > _SLOW:
            yield call.begin, number, call, False
        if ended is not None:
            heapq.heappush(ends, (ended, number, call))
    while ends:
        yield (*heapq.heappop(ends), True)


class _Selection:
    """The calls that are shown: all calls, or every n-th call of a very long recording."""

    def __init__(self, calls: Sequence[RecordedCall]) -> None:
        counts = Counter(bool(call.code) for call in calls)
        self._strides = {kind: math.ceil(count / MOST_CALLS) for kind, count in counts.items()}
        self.events = 0
        """The starts and ends since the last event, also of calls that are not shown."""

    def has(self, number: int, call: RecordedCall) -> bool:
        return number % self._strides[bool(call.code)] == 0


def _calls_event(
    time: float, batch: list[dict[str, Any]], selection: _Selection, statistics: _Statistics
) -> TimedEvent:
    shown = batch[-MAX_CALLS:]
    skipped, selection.events = selection.events - len(shown), 0
    data = {"calls": shown, "skipped": skipped, "stats": statistics.at(time)}
    return TimedEvent(time, "calls", data)


def _call(number: int, call: RecordedCall, *, ended: bool) -> dict[str, Any]:
    return {
        "id": number,
        "client": client_label(call.client),
        "account": call.account,
        "service": call.service,
        "begin": call.begin,
        "ms": round(call.ms, 3) if ended and call.ms is not None else None,
        "state": call.state if ended else "open",
        "code": call.code if ended else "",
        "deadline_ms": None if call.deadline_ms is None else round(call.deadline_ms, 1),
        "attempt": 1,
        "repeated": False,
        "task_id": call.task_id,
    }


class _Statistics:
    """The statistics of the calls so far."""

    def __init__(self) -> None:
        self._total = self._errors = self._open = 0
        self._durations: deque[float] = deque()
        self._ordered: list[float] = []
        """The same durations, in the order of their size."""
        self._recent: deque[float] = deque()

    def take(self, time: float, call: RecordedCall, *, ended: bool) -> None:
        """Note a call that ends, or that begins and is shown as open."""
        if not ended:
            self._open += 1
            return
        ms = call.ms or 0.0
        self._total += 1
        self._errors += bool(call.code)
        self._recent.append(time)
        self._durations.append(ms)
        insort(self._ordered, ms)
        if len(self._durations) > _SAMPLED:
            del self._ordered[bisect_left(self._ordered, self._durations.popleft())]
        if ms > _SLOW * 1e3:
            self._open -= 1

    def at(self, time: float) -> dict[str, Any]:
        while self._recent and self._recent[0] < time - 1.0:
            self._recent.popleft()
        return {
            "per_second": float(len(self._recent)),
            "p50_ms": self._percentile(0.5),
            "p99_ms": self._percentile(0.99),
            "errors": self._errors,
            "total": self._total,
            "open": self._open,
        }

    def _percentile(self, share: float) -> float | None:
        found = self._ordered
        return round(found[min(len(found) - 1, int(share * len(found)))], 3) if found else None


def _node(name: str, services: Sequence[str] = ()) -> dict[str, Any]:
    lists: dict[str, list[str]] = {"clients": [], "publishers": [], "subscriptions": []}
    return {"name": name, "program": "", "host": "", "services": list(services), **lists}


def _nodes(nodes: dict[str, dict[str, Any]]) -> dict[str, Any]:
    shown = [{**node, "clients": list(node["clients"])} for node in nodes.values()]
    return {"nodes": shown[:MAX_NODES], "more": max(0, len(shown) - MAX_NODES)}
