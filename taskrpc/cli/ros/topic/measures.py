"""`taskrpc topic hz`, `bw` and `delay`: measure topics and print the results once a second."""

from __future__ import annotations

import asyncio
import sys
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import srvgen
from taskrpc.cli.ros.topic.reading import Feed, condition, subscribed
from taskrpc.cli.ros.topic.topic_graph import topics
from taskrpc.cli.shared import graph
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, tune_for_long_run
from taskrpc.cli.shared.remote import remote_of
from taskrpc.errors import InvalidRequest
from taskrpc.qos import QoS

if TYPE_CHECKING:
    import argparse

    from taskrpc.node import Node

_ALIGNMENT = 4
"""DDS pads messages to a multiple of this many bytes, and `ros2 topic bw` counts the padding."""
_PRINT_PERIOD = 1.0
"""Seconds between two results."""

Now: TypeAlias = Callable[[], "float | None"]
"""Returns the time in seconds; None while it is unknown."""


def hz(options: argparse.Namespace) -> int:
    """Print the rate at which messages arrive."""
    clock = _clock(options, time.monotonic)
    holds = condition(options.filter)
    _check_names(options)
    return asyncio.run(_measure(options, lambda: Rate(options.window, holds, clock), clock))


def bw(options: argparse.Namespace) -> int:
    """Print the bandwidth of messages."""
    clock = _clock(options, time.monotonic)
    _check_names(options)
    return asyncio.run(_measure(options, lambda: Bandwidth(options.window, clock), clock))


def delay(options: argparse.Namespace) -> int:
    """Print the age of messages at their arrival."""
    clock = _clock(options, time.time)
    return asyncio.run(_measure(options, lambda: Delay(options.window, clock), clock))


class SimulatedTime:
    """The time that a simulation publishes on `/clock`; None before its first message."""

    def __init__(self) -> None:
        self._now: float | None = None

    def __call__(self) -> float | None:
        """Return the latest time, in seconds."""
        return self._now

    def take(self, message: Any) -> None:
        """Take the time from a `rosgraph_msgs/msg/Clock`."""
        self._now = message.clock.sec + message.clock.nanosec * 1e-9

    def listen(self, node: Node) -> None:
        """Subscribe to `/clock`."""
        qos = QoS(1, "best_effort")
        node.create_subscription(srvgen.load("rosgraph_msgs/msg/Clock"), "/clock", self.take, qos)


def _clock(options: argparse.Namespace, wall: Callable[[], float]) -> Now:
    is_wall = not options.use_sim_time or getattr(options, "wall_time", False)
    return wall if is_wall else SimulatedTime()


def _check_names(options: argparse.Namespace) -> None:
    if options.all_topics and options.topic_names:
        raise UsageError("Cannot specify both --all/-a and topic names")
    if not options.all_topics and not options.topic_names:
        raise UsageError("Either specify topic names or use --all/-a option")


async def _names(options: argparse.Namespace, node: Node) -> list[str]:
    """Return the topics to measure: those on the command line, or all current topics."""
    if not getattr(options, "all_topics", False):
        return getattr(options, "topic_names", None) or [options.topic_name]
    entries = await graph.entries_of(remote_of(options), node)
    found = topics(entries, hidden=options.include_hidden_topics)
    several = f"Subscribing to all {len(found)} available topics..."
    print(several if found else "No topics available", flush=True)
    return list(found)


async def _measure(options: argparse.Namespace, make: Callable[[], Measure], clock: Now) -> int:
    measures: dict[str, Measure] = {}
    async with remote_of(options).node() as node:
        names = await _names(options, node)
        if not names:
            return Exit.DONE
        if isinstance(clock, SimulatedTime):
            clock.listen(node)
        feed = Feed(lambda taken: taken[0](taken[1]))
        for name in names:
            measure = make()
            take = partial(_take_at_once, feed, measure.take)
            try:
                subscription = await subscribed(options, node, name, take, wait=True)
            except (srvgen.DefinitionError, NotFound) as error:
                if len(names) == 1:
                    raise
                problem = f"failed to find message type for topic [{name}]: {error}"
                print(f"WARNING: {problem}", file=sys.stderr, flush=True)
                continue
            measures[subscription.topic_name] = measure
            if isinstance(measure, Bandwidth):
                print(f"Subscribed to [{subscription.topic_name}]", flush=True)
        if not measures:
            return Exit.ERROR
        tune_for_long_run()
        is_unknown = False
        while not await feed.wait(_PRINT_PERIOD):
            if text := _text(measures):
                print(text, flush=True)
            elif clock() is None and not is_unknown:
                is_unknown = True
                print("WARNING: waiting for the time on /clock", file=sys.stderr, flush=True)
    raise AssertionError  # a feed of measures only ends with an error


def _take_at_once(feed: Feed, take: Callable[[Any], None], message: Any) -> None:
    feed.take_at_once((take, message))


def _text(measures: dict[str, Measure]) -> str:
    """Return the current results: as lines for one topic, as a table for several."""
    if len(measures) == 1:
        (measure,) = measures.values()
        return measure.line()
    rows = [[name, *row] for name, measure in measures.items() if (row := measure.row())]
    columns = next(iter(measures.values())).columns
    return _table(["topic", *columns], rows) if rows else "no new messages"


def _table(header: list[str], rows: list[list[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    titles = "   ".join(name.center(width) for name, width in zip(header, widths, strict=True))
    lines = (
        "   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join([titles, "=" * len(titles), *lines, ""])


class Measure(ABC):
    """A quantity that is measured over the latest messages."""

    columns: ClassVar[Sequence[str]] = ()
    """The column titles of a table for several topics."""

    @abstractmethod
    def take(self, message: Any) -> None:
        """Measure a message. Raises InvalidRequest if it cannot be measured."""

    @abstractmethod
    def line(self) -> str:
        """Return the current result as text, "" if there is no new message."""

    def row(self) -> list[str]:
        """Return the current result as the cells of a table, [] if there is no new message."""
        return [self.line()]


class Rate(Measure):
    """The rate of the messages for which a condition holds."""

    columns = ("rate", "min_delta", "max_delta", "std_dev", "window")

    def __init__(self, window: int, holds: Callable[[Any], bool], now: Now) -> None:
        self._holds = holds
        self._now = now
        self._last: float | None = None
        """The time of the latest message."""
        self._printed: float | None = None
        """The time of the latest message in the last printed result."""
        self._intervals: deque[float] = deque(maxlen=window)
        """The seconds between messages."""

    def take(self, message: Any) -> None:
        """Record the arrival time of a message."""
        if not self._holds(message):
            return
        now = self._now()
        if now is None:
            return
        if self._last is not None and now >= self._last:
            self._intervals.append(now - self._last)
        elif self._last is not None:  # the simulation has started again
            self._intervals.clear()
        self._last = now

    def line(self) -> str:
        """Return the rate, and the intervals between messages."""
        if not self._is_new():
            return ""
        return f"average rate: {self._rate():.3f}\n{_spread(self._intervals)}"

    def row(self) -> list[str]:
        """Return the same as cells."""
        if not self._is_new():
            return []
        least, most, deviation = _extent(self._intervals)
        figures = f"{self._rate():.3f}", f"{least:.3f}", f"{most:.3f}", f"{deviation:.5f}"
        return [*figures, str(len(self._intervals))]

    def _is_new(self) -> bool:
        is_new = bool(self._intervals) and self._printed != self._last
        self._printed = self._last
        return is_new

    def _rate(self) -> float:
        mean = sum(self._intervals) / len(self._intervals)
        return 1 / mean if mean else 0.0


class Delay(Measure):
    """The age of messages at their arrival."""

    def __init__(self, window: int, now: Now) -> None:
        self._now = now
        self._is_new = False
        """Whether a message has arrived since the last printed result."""
        self._ages: deque[float] = deque(maxlen=window)
        """The ages of messages, in seconds."""

    def take(self, message: Any) -> None:
        """Record the age of a message."""
        if not hasattr(message, "header"):
            raise InvalidRequest("", "msg does not have header")
        now = self._now()
        if now is None:
            return
        stamp = message.header.stamp
        self._ages.append(now - stamp.sec - stamp.nanosec * 1e-9)
        self._is_new = True

    def line(self) -> str:
        """Return the delays."""
        if not self._ages:
            return ""
        if not self._is_new:
            return "no new messages"
        self._is_new = False
        mean = sum(self._ages) / len(self._ages)
        return f"average delay: {mean:.3f}\n{_spread(self._ages)}"


class Bandwidth(Measure):
    """The sizes of messages in bytes, as ROS would send them."""

    columns = ("bandwidth", "window", "mean", "min", "max")

    def __init__(self, window: int, now: Now) -> None:
        self._now = now
        self._sizes: deque[tuple[float, int]] = deque(maxlen=window)
        """The arrival time in seconds and the size in bytes of each message."""

    def take(self, message: Any) -> None:
        """Record the size of a message."""
        now = self._now()
        if now is None:
            return
        if self._sizes and now < self._sizes[-1][0]:  # the simulation has started again
            self._sizes.clear()
        size = len(srvgen.to_cdr(message))
        self._sizes.append((now, size + -size % _ALIGNMENT))

    def line(self) -> str:
        """Return the bytes per second, and the sizes of messages."""
        if not (cells := self.row()):
            return ""
        rate, count, mean, least, most = cells
        return f"{rate} from {count} messages\n\tMessage size mean: {mean} min: {least} max: {most}"

    def row(self) -> list[str]:
        """Return the same as cells."""
        now = self._now()
        if len(self._sizes) < 2 or now is None or now <= self._sizes[0][0]:
            return []
        sizes = [size for _, size in self._sizes]
        rate = sum(sizes) / (now - self._sizes[0][0])
        figures = rate, sum(sizes) / len(sizes), min(sizes), max(sizes)
        first, *others = (_bytes(each, rate) for each in figures)
        return [f"{first}/s", str(len(sizes)), *others]


def _bytes(count: float, rate: float) -> str:
    """Return a number of bytes as text, in the unit that suits the rate."""
    if rate < 1000:
        return f"{count:.0f} B"
    return f"{count / 1e3:.2f} KB" if rate < 1_000_000 else f"{count / 1e6:.2f} MB"


def _extent(values: deque[float]) -> tuple[float, float, float]:
    """Return the smallest value, the largest value, and the standard deviation."""
    mean = sum(values) / len(values)
    deviation = sqrt(sum((each - mean) ** 2 for each in values) / len(values))
    return min(values), max(values), deviation


def _spread(values: deque[float]) -> str:
    least, most, deviation = _extent(values)
    return f"\tmin: {least:.3f}s max: {most:.3f}s std dev: {deviation:.5f}s window: {len(values)}"
