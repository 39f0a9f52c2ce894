"""The observer that counts: what a node's calls became, and how long they took."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable

import msgspec

from taskrpc.callinfo import CallInfo
from taskrpc.errors import Code
from taskrpc.metrics.families import Family, Histogram, Kind, Sample, by_label
from taskrpc.metrics.lateness import Lateness
from taskrpc.metrics.prometheus import render
from taskrpc.metrics.topics import TopicCounts
from taskrpc.observer import Connections, NodeStatus, ObservedNode, Observer

log = logging.getLogger("taskrpc.metrics")

MAX_SERVICES = 1000
"""Services that are told apart; what calls of others become is counted under `OTHERS`."""

OTHERS = "(others)"


class _Outcomes:
    """Calls by service and code, and their times by service."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._seconds: dict[str, Histogram] = {}

    def note(self, service: str, code: Code, seconds: float) -> None:
        times = self._seconds.get(service)
        if times is None:
            # A program may call whatever name it is told; Prometheus keeps each for ever.
            if len(self._seconds) >= MAX_SERVICES:
                service = OTHERS
            times = self._seconds.setdefault(service, Histogram())
        self._counts[service, code.name] += 1
        times.observe(seconds)

    def families(self, prefix: str, what: str) -> list[Family]:
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
            Family(f"{prefix}s_total", Kind.COUNTER, f"{what}, by their end.", counts),
            Family(f"{prefix}_seconds", Kind.HISTOGRAM, f"How long they took: {what}.", times),
        ]


class Metrics(Observer):
    """Counts what becomes of calls: `Node(observer=metrics)`, for as many nodes as you like.

    `text()` is what Prometheus scrapes.
    """

    def __init__(self) -> None:
        self._answered, self._made = _Outcomes(), _Outcomes()
        self._nodes: dict[ObservedNode, None] = {}
        self._retries_before: Counter[str] = Counter()
        self._requests_before: Counter[tuple[str, str]] = Counter()
        self._sockets: dict[str, tuple[Connections, Connections]] = {}
        self._topics = TopicCounts()
        self._lateness = Lateness()
        self._more: list[Callable[[], Iterable[Family]]] = []

    def add(self, collect: Callable[[], Iterable[Family]]) -> None:
        """Let `text` tell more: `collect()` is asked for families each time."""
        self._more.append(collect)

    def text(self) -> str:
        """Everything in Prometheus' text format 0.0.4."""
        return render(self.families())

    def families(self) -> list[Family]:
        """Everything as values."""
        statuses = [node.status() for node in list(self._nodes)]
        for status in statuses:
            self._note_sockets(status)
        return [
            *self._answered.families("taskrpc_call", "Calls of this program's services"),
            *_service_families(statuses),
            *self._once_families(statuses),
            *self._made.families("taskrpc_client_call", "Calls that this program made"),
            self._retries(statuses),
            *self._topics.families(statuses),
            *_socket_families(self._sockets.values()),
            Family(
                "taskrpc_loop_late_seconds",
                Kind.HISTOGRAM,
                "By how much the event loop is late, looked at twice a second.",
                self._lateness.seconds.samples(),
            ),
            *(family for collect in self._more for family in _collected(collect)),
        ]

    # What an observer is told

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network."""
        self._nodes[node] = None
        self._lateness.start()

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network: what it has done stays counted."""
        status = node.status()
        accepted = msgspec.structs.replace(status.accepted, open=0)
        dialled = msgspec.structs.replace(status.dialled, open=0)
        self._sockets[status.endpoint] = accepted, dialled
        self._retries_before.update(status.retries)
        self._requests_before.update(_requests([status]))
        self._topics.note_ended(status)
        self._nodes.pop(node, None)
        if not self._nodes:
            self._lateness.stop()

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call of one of our services has its answer."""
        self._answered.note(call.service, code, seconds)

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """One of our clients has made a call."""
        self._made.note(service, code, seconds)

    # How

    def _note_sockets(self, status: NodeStatus) -> None:
        # The nodes of one program share their sockets, which must not be counted twice.
        self._sockets[status.endpoint] = (status.accepted, status.dialled)

    def _once_families(self, statuses: Iterable[NodeStatus]) -> list[Family]:
        requests = self._requests_before.copy()
        requests.update(_requests(statuses))
        services = [service for status in statuses for service in status.services]
        once = {each.name: each.once for each in services if each.once is not None}
        prefix = "taskrpc_exactly_once"
        return [
            Family(
                f"{prefix}_requests_total",
                Kind.COUNTER,
                "Requests of exactly-once services, by what was known of them.",
                [
                    Sample(count, {"service": service, "known": known})
                    for (service, known), count in sorted(requests.items())
                ],
            ),
            Family(
                f"{prefix}_clients",
                Kind.GAUGE,
                "Clients that a service's store remembers.",
                by_label("service", {name: each.clients for name, each in once.items()}),
            ),
            Family(
                f"{prefix}_bytes",
                Kind.GAUGE,
                "Bytes that a service's store takes in memory.",
                by_label("service", {name: each.bytes for name, each in once.items()}),
            ),
        ]

    def _retries(self, statuses: Iterable[NodeStatus]) -> Family:
        retries = self._retries_before.copy()
        for status in statuses:
            retries.update(status.retries)
        what = "How often this program's clients repeated a call."
        samples = by_label("service", retries)
        return Family("taskrpc_client_retries_total", Kind.COUNTER, what, samples)


def _collected(collect: Callable[[], Iterable[Family]]) -> list[Family]:
    """What was added by others, whose failure must not take all the rest away."""
    try:
        return list(collect())
    except Exception:
        log.exception("a part of the metrics cannot be told")
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
        Family("taskrpc_calls_running", Kind.GAUGE, "Calls whose callback is at work.", running),
        Family("taskrpc_calls_waiting", Kind.GAUGE, "Calls that wait for their turn.", waiting),
    ]


def _socket_families(sockets: Iterable[tuple[Connections, Connections]]) -> list[Family]:
    opened, now, received, sent = (Counter[str]() for _ in range(4))
    reasons: Counter[tuple[str, str]] = Counter()
    for pair in sockets:
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
        Family(f"{prefix}s_open", gauge, "Connections that are open.", by_label("role", now)),
        Family(f"{prefix}s_total", counter, "Connections that began.", by_label("role", opened)),
        Family(
            f"{prefix}s_ended_total",
            counter,
            "Connections that ended, by the error that was the reason.",
            ends,
        ),
        Family(
            "taskrpc_received_bytes_total",
            counter,
            "Bytes read, without what TLS adds.",
            by_label("role", received),
        ),
        Family(
            "taskrpc_sent_bytes_total",
            counter,
            "Bytes written, without what TLS adds.",
            by_label("role", sent),
        ),
    ]
