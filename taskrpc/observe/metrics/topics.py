"""Counts of published, received and lost messages, by topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from taskrpc import NodeStatus
from taskrpc.observe.metrics.prometheus import Family, Kind, Sample, by_label
from taskrpc.spi import TopicStatus

# label of the place of a loss -> field of `TopicStatus`
_LOSSES = {
    "sending": "lost_sending",
    "coming": "lost_coming",
    "waiting": "lost_waiting",
}


class TopicCounts:
    """Adds up the topics of all nodes, ended nodes included."""

    def __init__(self) -> None:
        self._ended: Counter[tuple[str, str]] = Counter()

    def node_ended(self, status: NodeStatus) -> None:
        """Keep the counts of a node that ends."""
        self._ended.update(_counts(status.topics))

    def families(self, statuses: Iterable[NodeStatus]) -> list[Family]:
        """Return the metrics of the topics of these nodes and of all ended ones."""
        statuses = list(statuses)
        counts = self._ended.copy()
        now: Counter[tuple[str, str]] = Counter()
        for status in statuses:
            counts.update(_counts(status.topics))
            for name, topic in status.topics.items():
                now[name, "subscriptions"] += topic.subscriptions
                now[name, "publishers"] += topic.publishers
        prefix, counter = "taskrpc_topic", Kind.COUNTER
        losses = [
            Sample(counts[name, field], {"topic": name, "where": where})
            for name in sorted({name for name, _ in counts})
            for where, field in _LOSSES.items()
        ]
        return [
            Family(
                f"{prefix}_published_total",
                counter,
                "Messages that this program published.",
                by_label("topic", _of(counts, "published")),
            ),
            Family(
                f"{prefix}_received_total",
                counter,
                "Messages that this program's subscriptions received.",
                by_label("topic", _of(counts, "received")),
            ),
            Family(
                f"{prefix}_lost_total",
                counter,
                "Messages that were dropped, by the place of the loss.",
                losses,
            ),
            Family(
                f"{prefix}_subscriptions",
                Kind.GAUGE,
                "Subscriptions that receive messages from this program.",
                by_label("topic", _of(now, "subscriptions")),
            ),
            Family(
                f"{prefix}_publishers",
                Kind.GAUGE,
                "Publishers that send messages to this program's subscriptions.",
                by_label("topic", _of(now, "publishers")),
            ),
        ]


def _counts(topics: Mapping[str, TopicStatus]) -> Counter[tuple[str, str]]:
    fields = ("published", "received", *_LOSSES.values())
    return Counter(
        {(name, field): getattr(topic, field) for name, topic in topics.items() for field in fields}
    )


def _of(counts: Counter[tuple[str, str]], field: str) -> dict[str, float]:
    return {name: count for (name, each), count in counts.items() if each == field}
