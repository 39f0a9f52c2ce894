"""The observer that counts a program's calls, connections and messages, for Prometheus."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

import msgspec

from taskrpc import CallInfo, NodeStatus, Observer
from taskrpc.errors import Code
from taskrpc.observe.metrics.prometheus import Family, Histogram, Kind, Sample, by_label, render
from taskrpc.observe.metrics.topics import TopicCounts
from taskrpc.spi import Connections, ObservedNode

log = logging.getLogger("taskrpc.metrics")

MAX_SERVICES = 1000
"""The most services with counts of their own; calls of further services count as `OTHERS`."""

OTHERS = "(others)"

LOOP_PERIOD = 0.5
"""Seconds between two measurements of the event loop."""

_TRANSACTION_BOUNDS = tuple(float(2**n) for n in range(11))


class _CallCounts:
    """Ended calls by service and code, and their durations by service."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._seconds: dict[str, Histogram] = {}

    def count(self, service: str, code: Code, seconds: float) -> None:
        times = self._seconds.get(service)
        if times is None:
            # A program may read service names from outside; Prometheus keeps each name for ever.
            if len(self._seconds) >= MAX_SERVICES:
                service = OTHERS
            times = self._seconds.setdefault(service, Histogram())
        self._counts[service, code.name] += 1
        times.observe(seconds)

    def families(self, prefix: str, calls: str) -> list[Family]:
        counts = [
            Sample(count, {"service": service, "code": code})
            for (service, code), count in sorted(self._counts.items())
        ]
        times = [
            sample
            for service, histogram in sorted(self._seconds.items())
            for sample in histogram.samples({"service": service})
        ]
        return [
            Family(f"{prefix}s_total", Kind.COUNTER, f"{calls}, by status code.", counts),
            Family(f"{prefix}_seconds", Kind.HISTOGRAM, f"Duration in seconds: {calls}.", times),
        ]


class LoopLateness:
    """Measures how late an event loop runs its timers, between `start` and `stop`.

    A delay of the loop delays every call of the program.
    """

    def __init__(self) -> None:
        self.seconds = Histogram()
        """How late each timer was, in seconds."""
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Measure the running loop; a second start does nothing."""
        if self._timer is None:
            self._set_timer(asyncio.get_running_loop())

    def stop(self) -> None:
        """Stop measuring."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _set_timer(self, loop: asyncio.AbstractEventLoop) -> None:
        due = loop.time() + LOOP_PERIOD
        self._timer = loop.call_at(due, self._measure, loop, due)

    def _measure(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        self.seconds.observe(max(0.0, loop.time() - due))
        self._set_timer(loop)


class Metrics(Observer):
    """Counts calls, connections and messages: `Node(observer=metrics)`, for any number of nodes.

    Prometheus scrapes the result of `text()`.
    """

    def __init__(self) -> None:
        self._served, self._made = _CallCounts(), _CallCounts()
        self._nodes: dict[ObservedNode, None] = {}  # the nodes that have not ended
        # The counts of ended nodes, by service; with the kind of request for the second.
        self._ended_retries: Counter[str] = Counter()
        self._ended_requests: Counter[tuple[str, str]] = Counter()
        self._connections: dict[str, tuple[Connections, Connections]] = {}  # by endpoint
        self._topics = TopicCounts()
        self._loop_lateness = LoopLateness()
        self._added: list[Callable[[], Iterable[Family]]] = []

    def add(self, collect: Callable[[], Iterable[Family]]) -> None:
        """Add families to the metrics: `collect()` is called each time they are read."""
        self._added.append(collect)

    def text(self) -> str:
        """Return all metrics in Prometheus' text format 0.0.4."""
        return render(self.families())

    def families(self) -> list[Family]:
        """Return all metrics as values."""
        statuses = [node.status() for node in list(self._nodes)]
        for status in statuses:
            self._update_connections(status)
        return [
            *self._served.families("taskrpc_call", "Calls that this program's services received"),
            *_service_families(statuses),
            *self._exactly_once_families(statuses),
            *self._made.families("taskrpc_client_call", "Calls that this program made"),
            self._retries(statuses),
            *self._topics.families(statuses),
            *_connection_families(self._connections.values()),
            Family(
                "taskrpc_loop_late_seconds",
                Kind.HISTOGRAM,
                "How late the event loop runs its timers, measured twice a second.",
                self._loop_lateness.seconds.samples(),
            ),
            *(family for collect in self._added for family in _collected(collect)),
        ]

    # The methods of an observer

    def node_started(self, node: ObservedNode) -> None:
        """Count this node, which has started."""
        self._nodes[node] = None
        self._loop_lateness.start()

    def node_ended(self, node: ObservedNode) -> None:
        """Keep the counts of a node that ends."""
        status = node.status()
        accepted = msgspec.structs.replace(status.accepted, open=0)
        dialled = msgspec.structs.replace(status.dialled, open=0)
        self._connections[status.endpoint] = accepted, dialled
        self._ended_retries.update(status.retries)
        self._ended_requests.update(_requests([status]))
        self._topics.node_ended(status)
        self._nodes.pop(node, None)
        if not self._nodes:
            self._loop_lateness.stop()

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """Count a call that one of the program's services has ended."""
        self._served.count(call.service, code, seconds)

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """Count a call that one of the program's clients has ended."""
        self._made.count(service, code, seconds)

    # Internals

    def _update_connections(self, status: NodeStatus) -> None:
        # The nodes of one program share their connections, which must be counted once.
        self._connections[status.endpoint] = (status.accepted, status.dialled)

    def _exactly_once_families(self, statuses: Iterable[NodeStatus]) -> list[Family]:
        requests = self._ended_requests.copy()
        requests.update(_requests(statuses))
        services = [service for status in statuses for service in status.services]
        once = {each.name: each.once for each in services if each.once is not None}
        prefix = "taskrpc_exactly_once"
        return [
            Family(
                f"{prefix}_requests_total",
                Kind.COUNTER,
                "Requests to exactly-once services, by what the service knew about them.",
                [
                    Sample(count, {"service": service, "known": known})
                    for (service, known), count in sorted(requests.items())
                ],
            ),
            Family(
                f"{prefix}_clients",
                Kind.GAUGE,
                "Clients that the store of an exactly-once service remembers.",
                by_label("service", {name: each.clients for name, each in once.items()}),
            ),
            Family(
                f"{prefix}_bytes",
                Kind.GAUGE,
                "Bytes of memory that the remembered requests of a service take.",
                by_label("service", {name: each.bytes for name, each in once.items()}),
            ),
        ]

    def _retries(self, statuses: Iterable[NodeStatus]) -> Family:
        retries = self._ended_retries.copy()
        for status in statuses:
            retries.update(status.retries)
        what = "Retries of calls by this program's clients."
        samples = by_label("service", retries)
        return Family("taskrpc_client_retries_total", Kind.COUNTER, what, samples)


def _collected(collect: Callable[[], Iterable[Family]]) -> list[Family]:
    """Return added families; none if collecting them fails, so that the others are still read."""
    try:
        return list(collect())
    except Exception:
        log.exception("a part of the metrics cannot be collected")
        return []


def _requests(statuses: Iterable[NodeStatus]) -> Counter[tuple[str, str]]:
    found: Counter[tuple[str, str]] = Counter()
    for status in statuses:
        for service in status.services:
            for known, count in service.once.requests.items() if service.once else ():
                found[service.name, known] += count
    return found


def _service_families(statuses: Iterable[NodeStatus]) -> list[Family]:
    services = [service for status in statuses for service in status.services]
    running = by_label("service", {each.name: each.running for each in services})
    waiting = by_label("service", {each.name: each.waiting for each in services})
    return [
        Family("taskrpc_calls_running", Kind.GAUGE, "Calls whose callback is running.", running),
        Family(
            "taskrpc_calls_waiting", Kind.GAUGE, "Calls that wait in a service's queue.", waiting
        ),
    ]


def _connection_families(endpoints: Iterable[tuple[Connections, Connections]]) -> list[Family]:
    opened, now, received, sent = (Counter[str]() for _ in range(4))
    reasons: Counter[tuple[str, str]] = Counter()
    for pair in endpoints:
        for role, each in zip(("server", "client"), pair, strict=True):
            opened[role] += each.opened
            now[role] += each.open
            received[role] += each.received
            sent[role] += each.sent
            reasons.update({(role, reason): count for reason, count in each.ended.items()})
    ends = [
        Sample(count, {"role": role, "error": reason})
        for (role, reason), count in sorted(reasons.items())
    ]
    counter, gauge = Kind.COUNTER, Kind.GAUGE
    prefix = "taskrpc_connection"
    return [
        Family(f"{prefix}s_open", gauge, "Open connections.", by_label("role", now)),
        Family(
            f"{prefix}s_total", counter, "Connections since the start.", by_label("role", opened)
        ),
        Family(
            f"{prefix}s_ended_total",
            counter,
            "Connections that ended, by the error that ended them.",
            ends,
        ),
        Family(
            "taskrpc_received_bytes_total",
            counter,
            "Bytes received, without the overhead of TLS.",
            by_label("role", received),
        ),
        Family(
            "taskrpc_sent_bytes_total",
            counter,
            "Bytes sent, without the overhead of TLS.",
            by_label("role", sent),
        ),
    ]


class CountingStore(Protocol):
    """A store that counts its transactions, as `SqliteStore` and `SqliteCompletions` do."""

    @property
    def transactions(self) -> Mapping[int, int]:
        """The number of transactions for each number of calls that shared one."""


def store_families(store: CountingStore) -> list[Family]:
    """Return the metrics of a store in a file: `metrics.add(lambda: store_families(store))`."""
    sizes = Histogram(_TRANSACTION_BOUNDS)
    for size, times in store.transactions.items():
        sizes.observe(size, times)
    name, what = "taskrpc_store_transaction_changes", "Changes that one transaction stored."
    return [Family(name, Kind.HISTOGRAM, what, sizes.samples())]
