"""`taskrpc topic echo`, `hz`, `bw` and `delay`: subscribe, and say what comes."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from math import sqrt
from typing import TYPE_CHECKING, Any

import srvgen
from taskrpc.cli import graph, shells
from taskrpc.cli.command import Exit, NotFound, goes_on, hinted
from taskrpc.cli.remote import Remote, remote_of
from taskrpc.cli.topic_graph import Topic, topics
from taskrpc.cli.topic_pub import message_class
from taskrpc.cli.topic_qos import qos_to_subscribe
from taskrpc.errors import InvalidRequest
from taskrpc.ros.message_text import Cut, csv_of, yaml_of

if TYPE_CHECKING:
    import argparse

    from taskrpc.node import Node
    from taskrpc.topic import Subscription

_LOOK = 0.1
_TELL = 1.0
"""Seconds between two lines of `hz`, `bw` and `delay`."""


def echo(options: argparse.Namespace) -> int:
    """Print messages."""
    return asyncio.run(_echo(options))


def hz(options: argparse.Namespace) -> int:
    """Print how often messages come."""
    return asyncio.run(_measure(options, Rate(options.window)))


def bw(options: argparse.Namespace) -> int:
    """Print how many bytes they are."""
    return asyncio.run(_measure(options, Bandwidth(options.window)))


def delay(options: argparse.Namespace) -> int:
    """Print how old they are when they come."""
    return asyncio.run(_measure(options, Delay(options.window)))


async def _echo(options: argparse.Namespace) -> int:
    printer = Printer(options)
    async with remote_of(options).node() as node:
        subscription = await _subscribed(options, node, printer.take, wait=False)
        printer.subscription = subscription
        goes_on()
        try:
            async with asyncio.timeout(options.timeout if options.once else None):
                await printer.done.wait()
        except TimeoutError:
            topic = subscription.topic_name
            raise NotFound(f"no message on {topic} within {options.timeout:g} s") from None
        if printer.problem is not None:
            raise printer.problem
    return Exit.DONE


class Printer:
    """Prints each message of a topic."""

    def __init__(self, options: argparse.Namespace) -> None:
        length = None if options.full_length else options.truncate_length
        self._cut = Cut(length, arrays=not options.no_arr, texts=not options.no_str)
        self._options = options
        self._lost = 0
        self.subscription: Subscription | None = None
        self.done = asyncio.Event()
        self.problem: InvalidRequest | None = None

    def take(self, message: Any) -> None:
        """Print a message."""
        if self.done.is_set():
            return
        self._tell_losses()
        try:
            print(self._text(_field(message, self._options.field)), flush=True)
        except InvalidRequest as error:
            self.problem = error
            self.done.set()
        if self._options.once:
            self.done.set()

    def _text(self, value: Any) -> str:
        if self._options.csv:
            return csv_of(value, self._cut)
        return yaml_of(value, self._cut, flow=self._options.flow_style) + "---"

    def _tell_losses(self) -> None:
        if self.subscription is None or self._options.no_lost_messages:
            return
        lost = self.subscription.lost + self.subscription.dropped
        if lost > self._lost:
            change, self._lost = lost - self._lost, lost
            print(f"A message was lost!!!\n\ttotal count change:{change}\n\ttotal count: {lost}")
            print("---", flush=True)


def _field(message: Any, path: str) -> Any:
    """A field of a message by `a.b` or `a[0].b`. Raises InvalidRequest."""
    value = message
    for name in path.replace("[", ".").replace("]", "").split(".") if path else ():
        try:
            value = value[int(name)] if name.isdecimal() else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            problem = f"Invalid field '{path}': {message._TYPE} has no such field"
            raise InvalidRequest("", problem) from None
    return value


async def _measure(options: argparse.Namespace, measure: Measure) -> int:
    async with remote_of(options).node() as node:
        subscription = await _subscribed(options, node, measure.take, wait=True)
        if isinstance(measure, Bandwidth):
            print(f"Subscribed to [{subscription.topic_name}]", flush=True)
        goes_on()
        while measure.problem is None:
            await asyncio.sleep(_TELL)
            if line := measure.line():
                print(line, flush=True)
        raise measure.problem


class Measure:
    """Something that is measured over the last `window` messages."""

    def __init__(self, window: int) -> None:
        self.problem: InvalidRequest | None = None
        self._window = window

    def take(self, message: Any) -> None:
        """Take a message into account."""
        raise NotImplementedError

    def line(self) -> str:
        """What there is to say now, "" for nothing new."""
        raise NotImplementedError


class Rate(Measure):
    """How often messages come."""

    def __init__(self, window: int) -> None:
        super().__init__(window)
        self._last = 0.0
        self._told = 0.0
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note when a message came."""
        now = time.monotonic()
        if self._last:
            self._spans.append(now - self._last)
        self._last = now

    def line(self) -> str:
        """The rate, and the intervals between messages."""
        if not self._spans or self._told == self._last:
            return ""
        self._told = self._last
        mean = sum(self._spans) / len(self._spans)
        rate = 1 / mean if mean else 0.0
        return f"average rate: {rate:.3f}\n{_spread(self._spans)}"


class Delay(Measure):
    """How old messages are when they come."""

    def __init__(self, window: int) -> None:
        super().__init__(window)
        self._fresh = False
        self._spans: deque[float] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the age of a message."""
        if not hasattr(message, "header"):
            self.problem = InvalidRequest("", "msg does not have header")
            return
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

    def __init__(self, window: int) -> None:
        super().__init__(window)
        self._came: deque[tuple[float, int]] = deque(maxlen=window)

    def take(self, message: Any) -> None:
        """Note the size of a message."""
        self._came.append((time.monotonic(), len(srvgen.to_cdr(message))))

    def line(self) -> str:
        """The bytes a second, and the sizes of messages."""
        if len(self._came) < 2:
            return ""
        sizes = [size for _, size in self._came]
        rate = sum(sizes) / (time.monotonic() - self._came[0][0])
        shown = [_bytes(each, rate) for each in (rate, sum(sizes) / len(sizes))]
        least, most = _bytes(min(sizes), rate), _bytes(max(sizes), rate)
        return (
            f"{shown[0]}/s from {len(sizes)} messages\n"
            f"\tMessage size mean: {shown[1]} min: {least} max: {most}"
        )


def _bytes(count: float, rate: float) -> str:
    """A number of bytes in the unit that suits a rate."""
    if rate < 1000:
        return f"{count:.0f} B"
    return f"{count / 1e3:.2f} KB" if rate < 1_000_000 else f"{count / 1e6:.2f} MB"


def _spread(spans: deque[float]) -> str:
    mean = sum(spans) / len(spans)
    deviation = sqrt(sum((each - mean) ** 2 for each in spans) / len(spans))
    return (
        f"\tmin: {min(spans):.3f}s max: {max(spans):.3f}s"
        f" std dev: {deviation:.5f}s window: {len(spans)}"
    )


async def _subscribed(
    options: argparse.Namespace, node: Node, callback: Callable[[Any], None], *, wait: bool
) -> Subscription:
    """Subscribe by the type that was given, or that the topic has."""
    topic = shells.expanded(options.topic_name, kind="topic name")
    given = getattr(options, "message_type", "")
    remote = remote_of(options)
    found = await _found(remote, node, topic)
    if not found.types and not given:
        print(f"WARNING: topic [{topic}] does not appear to be published yet", flush=True)
        if not wait:
            problem = NotFound("Could not determine the type for the passed topic")
            raise hinted(problem, f"give it: taskrpc topic echo {topic} std_msgs/msg/String")
        while not found.types:
            await asyncio.sleep(_LOOK)
            found = await _found(remote, node, topic)
    if not given and len(found.types) > 1:
        several = f"Cannot echo topic '{topic}', as it contains more than one type"
        raise NotFound(f"{several}: [{', '.join(found.types)}]")
    cls = message_class(given or found.types[0])
    qos = qos_to_subscribe(options, [each for each, _ in found.publishers])
    return node.create_subscription(cls, topic, callback, qos)


async def _found(remote: Remote, node: Node, topic: str) -> Topic:
    entries = await graph.entries_of(remote, node)
    return topics(entries, hidden=True).get(topic, Topic())
