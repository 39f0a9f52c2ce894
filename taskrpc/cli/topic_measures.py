"""`taskrpc topic hz`, `bw` and `delay`: measure topics, and say so once a second."""

from __future__ import annotations

import asyncio
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING, Any, ClassVar

import srvgen
from taskrpc.cli.command import goes_on
from taskrpc.cli.remote import remote_of
from taskrpc.cli.topic_reading import Feed, condition, subscribed
from taskrpc.errors import InvalidRequest

if TYPE_CHECKING:
    import argparse

_TELL = 1.0
"""Seconds between two lines."""


def hz(options: argparse.Namespace) -> int:
    """Print how often messages come."""
    measures = [Rate(options.window, condition(options.filter)) for _ in options.topic_names]
    return asyncio.run(_measure(options, measures))


def bw(options: argparse.Namespace) -> int:
    """Print how many bytes they are."""
    measures = [Bandwidth(options.window) for _ in options.topic_names]
    return asyncio.run(_measure(options, measures))


def delay(options: argparse.Namespace) -> int:
    """Print how old they are when they come."""
    return asyncio.run(_measure(options, [Delay(options.window)]))


async def _measure(options: argparse.Namespace, measures: Sequence[Measure]) -> int:
    names = getattr(options, "topic_names", None) or [options.topic_name]
    told: dict[str, Measure] = {}
    async with remote_of(options).node() as node:
        feed = Feed(lambda taken: taken[0](taken[1]))
        for name, measure in zip(names, measures, strict=True):
            take = partial(_hand_over, feed, measure.take)
            subscription = await subscribed(options, node, name, take, wait=True)
            told[subscription.topic_name] = measure
            if isinstance(measure, Bandwidth):
                print(f"Subscribed to [{subscription.topic_name}]", flush=True)
        goes_on()
        while not await feed.wait(_TELL):
            if text := _text(told):
                print(text, flush=True)
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

    def __init__(self, window: int, holds: Callable[[Any], bool]) -> None:
        self._holds = holds
        self._last = 0.0
        self._told = 0.0
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note when a message came."""
        if not self._holds(message):
            return
        now = time.monotonic()
        if self._last:
            self._spans.append(now - self._last)
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

    def __init__(self, window: int) -> None:
        self._fresh = False
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the age of a message."""
        if not hasattr(message, "header"):
            raise InvalidRequest("", "msg does not have header")
        stamp = message.header.stamp
        self._spans.append((time.time_ns() - stamp.sec * 10**9 - stamp.nanosec) * 1e-9)
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

    columns = ("bandwidth", "mean", "min", "max", "window")

    def __init__(self, window: int) -> None:
        self._came: deque[tuple[float, int]] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the size of a message."""
        self._came.append((time.monotonic(), len(srvgen.to_cdr(message))))

    def line(self) -> str:
        """The bytes a second, and the sizes of messages."""
        if not (cells := self.row()):
            return ""
        rate, mean, least, most, count = cells
        return f"{rate} from {count} messages\n\tMessage size mean: {mean} min: {least} max: {most}"

    def row(self) -> list[str]:
        """The same in cells."""
        if len(self._came) < 2:
            return []
        sizes = [size for _, size in self._came]
        rate = sum(sizes) / (time.monotonic() - self._came[0][0])
        figures = rate, sum(sizes) / len(sizes), min(sizes), max(sizes)
        first, *others = (_bytes(each, rate) for each in figures)
        return [f"{first}/s", *others, str(len(sizes))]


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
