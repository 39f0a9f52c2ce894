"""`taskrpc topic echo`: prints each message of a topic."""

from __future__ import annotations

import asyncio
import itertools
import time
from typing import TYPE_CHECKING, Any

import srvgen
from taskrpc.cli.ros.topic.reading import Feed, condition, subscribed
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, tune_for_long_run
from taskrpc.cli.shared.remote import remote_of
from taskrpc.errors import InvalidRequest
from taskrpc.ros.message_text import Cut, csv_of, yaml_of

if TYPE_CHECKING:
    import argparse

    from taskrpc.topic import Subscription


def echo(options: argparse.Namespace) -> int:
    """Print messages."""
    if options.field is not None and not options.field.strip("."):
        raise UsageError(f"Invalid field value '{options.field}'")
    return asyncio.run(_echo(options))


async def _echo(options: argparse.Namespace) -> int:
    printer = _Printer(options)
    async with remote_of(options).node() as node:
        subscription = await subscribed(
            options, node, options.topic_name, printer.feed.take, wait=False
        )
        printer.subscription = subscription
        tune_for_long_run()
        if not await printer.feed.wait(options.timeout) and options.once:
            topic = subscription.topic_name
            raise NotFound(f"no message on {topic} within {options.timeout:g} s")
    return Exit.DONE


class _Printer:
    """Prints each message of a topic."""

    def __init__(self, options: argparse.Namespace) -> None:
        length = None if options.full_length else options.truncate_length
        self._cut = Cut(length, arrays=not options.no_arr, texts=not options.no_str)
        self._options = options
        self._holds = condition(options.filter)
        self._lost = 0  # the reported number of lost messages
        self._numbers = itertools.count(1)  # of the messages, for --include-message-info
        self.subscription: Subscription[Any] | None = None
        self.feed = Feed(self._print)

    def _print(self, message: Any) -> None:
        self._report_losses()
        number = next(self._numbers)
        value = _field(message, self._options.field or "")
        if not self._holds(value):
            return
        for text in self._texts(value, number):
            print(text, flush=True)
        if self._options.once:
            self.feed.stop()

    def _texts(self, value: Any, number: int) -> list[str]:
        info = _info(number) if self._options.include_message_info else {}
        if self._options.raw:
            return [*_lines(info), f"{srvgen.to_cdr(value)!r}\n---"]
        if not hasattr(value, "_FIELDS"):
            return [*_lines(info), f"{value}\n---"]
        if self._options.csv:
            return [",".join([*map(str, info.values()), csv_of(value, self._cut)])]
        text = yaml_of(value, self._cut, flow=self._options.flow_style)
        return [*_lines(info), f"{text}---"]

    def _report_losses(self) -> None:
        if self.subscription is None or self._options.no_lost_messages:
            return
        lost = self.subscription.lost + self.subscription.dropped
        if lost > self._lost:
            change, self._lost = lost - self._lost, lost
            print(f"A message was lost!!!\n\ttotal count change:{change}\n\ttotal count: {lost}")
            print("---", flush=True)


def _info(number: int) -> dict[str, int]:
    """Return the facts about a message; its source time is unknown, so it is the arrival time."""
    now = time.time_ns()
    return {
        "publication_sequence_number": number,
        "received_timestamp": now,
        "reception_sequence_number": number,
        "source_timestamp": now,
    }


def _lines(info: dict[str, int]) -> list[str]:
    return ["".join(f"{name}: {value}\n" for name, value in info.items()) + "---"] if info else []


def _field(message: Any, path: str) -> Any:
    """Return a field of a message by a path such as `a.b` or `a[0].b`. Raises InvalidRequest."""
    value = message
    names = path.replace("[", ".").replace("]", "").split(".")
    for name in filter(None, names):
        try:
            value = value[int(name)] if name.isdecimal() else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            problem = f"Invalid field '{path}': {message._TYPE} has no such field"
            raise InvalidRequest("", problem) from None
    return value
