"""`taskrpc topic hz`, `bw` and `delay`: measure topics, and say so once a second."""

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
from taskrpc.cli.shared import graph
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, goes_on
from taskrpc.cli.shared.remote import remote_of
from taskrpc.cli.topic.reading import Feed, condition, subscribed
from taskrpc.cli.topic.topic_graph import topics
from taskrpc.errors import InvalidRequest
from taskrpc.qos import QoS

if TYPE_CHECKING:
    import argparse

    from taskrpc.node import Node

_ALIGNMENT = 4
"""DDS pads messages to a multiple of this many bytes, and `ros2 topic bw` counts the padding."""
_TELL = 1.0
"""Seconds between two lines."""

Now: TypeAlias = Callable[[], "float | None"]
"""Gives the time in seconds; None while it is unknown."""


def hz(options: argparse.Namespace) -> int:
    """Print how often messages come."""
    clock = _clock(options, time.monotonic)
    holds = condition(options.filter)
    _check_names(options)
    return asyncio.run(_measure(options, lambda: Rate(options.window, holds, clock), clock))


def bw(options: argparse.Namespace) -> int:
    """Print how many bytes they are."""
    clock = _clock(options, time.monotonic)
    _check_names(options)
    return asyncio.run(_measure(options, lambda: Bandwidth(options.window, clock), clock))


def delay(options: argparse.Namespace) -> int:
    """Print how old they are when they come."""
    clock = _clock(options, time.time)
    return asyncio.run(_measure(options, lambda: Delay(options.window, clock), clock))


class SimulatedTime:
    """The time that a simulation publishes on `/clock`; None before its first message."""

    def __init__(self) -> None:
        self._now: float | None = None

    def __call__(self) -> float | None:
        """The latest time, in seconds."""
        return self._now

    def take(self, message: Any) -> None:
        """Take the time from a `rosgraph_msgs/msg/Clock`."""
        self._now = message.clock.sec + message.clock.nanosec * 1e-9

    def listen(self, node: Node) -> None:
        """Follow `/clock` from now on."""
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
    """The topics to measure: those that were named, or all that there are now."""
    if not getattr(options, "all_topics", False):
        return getattr(options, "topic_names", None) or [options.topic_name]
    entries = await graph.entries_of(remote_of(options), node)
    found = topics(entries, hidden=options.include_hidden_topics)
    several = f"Subscribing to all {len(found)} available topics..."
    print(several if found else "No topics available", flush=True)
    return list(found)


async def _measure(options: argparse.Namespace, make: Callable[[], Measure], clock: Now) -> int:
    told: dict[str, Measure] = {}
    async with remote_of(options).node() as node:
        names = await _names(options, node)
        if not names:
            return Exit.DONE
        if isinstance(clock, SimulatedTime):
            clock.listen(node)
        feed = Feed(lambda taken: taken[0](taken[1]))
        for name in names:
            measure = make()
            take = partial(_hand_over, feed, measure.take)
            try:
                subscription = await subscribed(options, node, name, take, wait=True)
            except (srvgen.DefinitionError, NotFound) as error:
                if len(names) == 1:
                    raise
                problem = f"failed to find message type for topic [{name}]: {error}"
                print(f"WARNING: {problem}", file=sys.stderr, flush=True)
                continue
            told[subscription.topic_name] = measure
            if isinstance(measure, Bandwidth):
                print(f"Subscribed to [{subscription.topic_name}]", flush=True)
        if not told:
            return Exit.ERROR
        goes_on()
        is_unknown = False
        while not await feed.wait(_TELL):
            if text := _text(told):
                print(text, flush=True)
            elif clock() is None and not is_unknown:
                is_unknown = True
                print("WARNING: waiting for the time on /clock", file=sys.stderr, flush=True)
    raise AssertionError  # a feed of measures ends by an error only


def _hand_over(feed: Feed, take: Callable[[Any], None], message: Any) -> None:
    feed.take_at_once((take, message))


def _text(told: dict[str, Measure]) -> str:
    """What there is to say now: in lines for one topic, in a table for several."""
    if len(told) == 1:
        (measure,) = told.values()
        return measure.line()
    rows = [[name, *row] for name, measure in told.items() if (row := measure.row())]
    columns = next(iter(told.values())).columns
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
    """Something that is measured over the last messages."""

    columns: ClassVar[Sequence[str]] = ()
    """The titles of a table with several of them."""

    @abstractmethod
    def take(self, message: Any) -> None:
        """Take a message into account. Raises InvalidRequest where it cannot be measured."""

    @abstractmethod
    def line(self) -> str:
        """What there is to say now, "" for nothing new."""

    def row(self) -> list[str]:
        """The same for a table, [] for nothing new."""
        return [self.line()]


class Rate(Measure):
    """How often messages come for which a condition holds."""

    columns = ("rate", "min_delta", "max_delta", "std_dev", "window")

    def __init__(self, window: int, holds: Callable[[Any], bool], now: Now) -> None:
        self._holds = holds
        self._now = now
        self._last: float | None = None
        """The time of the latest message."""
        self._told: float | None = None
        """The time of the latest message that was printed."""
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note when a message came."""
        if not self._holds(message):
            return
        now = self._now()
        if now is None:
            return
        if self._last is not None and now >= self._last:
            self._spans.append(now - self._last)
        elif self._last is not None:  # the simulation has started again
            self._spans.clear()
        self._last = now

    def line(self) -> str:
        """The rate, and the intervals between messages."""
        return f"average rate: {self._rate():.3f}\n{_spread(self._spans)}" if self._fresh() else ""

    def row(self) -> list[str]:
        """The same in cells."""
        if not self._fresh():
            return []
        least, most, deviation = _extent(self._spans)
        figures = f"{self._rate():.3f}", f"{least:.3f}", f"{most:.3f}", f"{deviation:.5f}"
        return [*figures, str(len(self._spans))]

    def _fresh(self) -> bool:
        fresh = bool(self._spans) and self._told != self._last
        self._told = self._last
        return fresh

    def _rate(self) -> float:
        mean = sum(self._spans) / len(self._spans)
        return 1 / mean if mean else 0.0


class Delay(Measure):
    """How old messages are when they come."""

    def __init__(self, window: int, now: Now) -> None:
        self._now = now
        self._fresh = False
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the age of a message."""
        if not hasattr(message, "header"):
            raise InvalidRequest("", "msg does not have header")
        now = self._now()
        if now is None:
            return
        stamp = message.header.stamp
        self._spans.append(now - stamp.sec - stamp.nanosec * 1e-9)
        self._fresh = True

    def line(self) -> str:
        """The delays."""
        if not self._spans:
            return ""
        if not self._fresh:
            return "no new messages"
        self._fresh = False
        mean = sum(self._spans) / len(self._spans)
        return f"average delay: {mean:.3f}\n{_spread(self._spans)}"


class Bandwidth(Measure):
    """How many bytes messages are, as ROS would send them."""

    columns = ("bandwidth", "window", "mean", "min", "max")

    def __init__(self, window: int, now: Now) -> None:
        self._now = now
        self._came: deque[tuple[float, int]] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the size of a message."""
        now = self._now()
        if now is None:
            return
        if self._came and now < self._came[-1][0]:  # the simulation has started again
            self._came.clear()
        size = len(srvgen.to_cdr(message))
        self._came.append((now, size + -size % _ALIGNMENT))

    def line(self) -> str:
        """The bytes a second, and the sizes of messages."""
        if not (cells := self.row()):
            return ""
        rate, count, mean, least, most = cells
        return f"{rate} from {count} messages\n\tMessage size mean: {mean} min: {least} max: {most}"

    def row(self) -> list[str]:
        """The same in cells."""
        now = self._now()
        if len(self._came) < 2 or now is None or now <= self._came[0][0]:
            return []
        sizes = [size for _, size in self._came]
        rate = sum(sizes) / (now - self._came[0][0])
        figures = rate, sum(sizes) / len(sizes), min(sizes), max(sizes)
        first, *others = (_bytes(each, rate) for each in figures)
        return [f"{first}/s", str(len(sizes)), *others]


def _bytes(count: float, rate: float) -> str:
    """A number of bytes in the unit that suits a rate."""
    if rate < 1000:
        return f"{count:.0f} B"
    return f"{count / 1e3:.2f} KB" if rate < 1_000_000 else f"{count / 1e6:.2f} MB"


def _extent(spans: deque[float]) -> tuple[float, float, float]:
    """The least, the most, and the standard deviation."""
    mean = sum(spans) / len(spans)
    deviation = sqrt(sum((each - mean) ** 2 for each in spans) / len(spans))
    return min(spans), max(spans), deviation


def _spread(spans: deque[float]) -> str:
    least, most, deviation = _extent(spans)
    return f"\tmin: {least:.3f}s max: {most:.3f}s std dev: {deviation:.5f}s window: {len(spans)}"
