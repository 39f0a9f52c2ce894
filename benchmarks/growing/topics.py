"""What is measured: sizes, figures, and how fast each may grow."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, TypeAlias

from benchmarks.growing.curves import Measure

Sample: TypeAlias = Callable[[int, float], Coroutine[Any, Any, dict[str, float]]]

_PER_PAYLOAD = 1.3
"""Linear, and some: what exceeds the processor's caches costs more a byte, in raw asyncio too."""


@dataclass(frozen=True)
class Topic:
    """One thing that there may be more of."""

    name: str
    title: str
    sizes: tuple[int, ...]
    quick: int
    """The largest size of a quick run."""
    measures: tuple[Measure, ...]

    def load(self) -> Sample:
        """The coroutine that measures one size."""
        sample: Sample = importlib.import_module(f"benchmarks.growing.{self.name}").sample
        return sample


TOPICS = (
    Topic(
        "connections",
        "connections",
        (1, 10, 100, 1000, 2000, 5000),
        1000,
        (
            Measure("idle_p50", "a call beside idle ones, median", "µs"),
            Measure("idle_p99", "a call beside idle ones, p99", "µs"),
            Measure("idle_rate", "calls/s at 64 beside idle ones", "calls/s"),
            Measure("idle_memory", "server memory of an idle one", "bytes"),
            Measure("active_rate", "calls/s, all calling", "calls/s"),
        ),
    ),
    Topic(
        "services",
        "services in a process",
        (1, 10, 100, 1000, 10_000),
        1000,
        (
            Measure("create_service", "create a service", "µs"),
            Measure("create_client", "create a client", "µs"),
            Measure("destroy_client", "destroy a client", "µs"),
            Measure("destroy_service", "destroy a service", "µs"),
            Measure("first_call", "a client's first call", "µs"),
            Measure("rate", "calls/s at 64", "calls/s"),
            Measure("memory", "memory of a service", "bytes"),
        ),
    ),
    Topic(
        "subscriptions",
        "subscriptions of a topic",
        (1, 10, 100),
        10,
        (
            Measure("deliver", "a message, for each subscription", "µs"),
            Measure("rate", "messages that arrive", "calls/s"),
            Measure("raw", "the same of raw asyncio", "µs"),
            Measure("ratio", "message, raw asyncio being 1", "times"),
        ),
    ),
    Topic(
        "queues",
        "tasks in the queue",
        (10, 100, 1000, 10_000, 100_000, 1_000_000),
        10_000,
        (
            Measure("queue_put", "queue: put", "µs"),
            Measure("queue_page", "queue: a page of 200", "µs"),
            Measure("queue_rerank", "queue: move", "µs"),
            Measure("queue_remove", "queue: remove", "µs"),
            Measure("queue_pop", "queue: pop", "µs"),
            Measure("submit", "manager: submit", "µs"),
            Measure("page", "manager: list a page of 200", "µs"),
            Measure("reprioritise", "manager: reprioritise", "µs"),
            Measure("cancel", "manager: cancel", "µs"),
            Measure("run", "manager: run a task to its end", "µs"),
            Measure("task_memory", "memory of a task", "bytes"),
        ),
    ),
    Topic(
        "payloads",
        "bytes of payload",
        tuple(1024 * 4**power for power in range(8)),
        1 << 20,
        (
            Measure("echo", "echo, median", "µs", limit=_PER_PAYLOAD),
            Measure("throughput", "both ways together", "MB/s"),
            Measure("raw", "the same of raw asyncio", "µs", limit=_PER_PAYLOAD),
            Measure("ratio", "echo, raw asyncio being 1", "times", limit=0.1),
        ),
    ),
)
"""In the order of the report."""


def topic(name: str) -> Topic:
    """The topic of a name. Raises KeyError."""
    return {each.name: each for each in TOPICS}[name]
