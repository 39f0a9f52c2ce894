"""`taskrpc topic pub`: publishes messages, a given number of times or until Ctrl-C."""

from __future__ import annotations

import asyncio
import itertools
from typing import TYPE_CHECKING, Any

import srvgen
from taskrpc.cli.ros.topic.qos_options import qos_to_publish
from taskrpc.cli.ros.topic.topic_graph import message_type_name
from taskrpc.cli.shared import definitions, quoting
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, standard_input, tune_for_long_run
from taskrpc.cli.shared.messages import Template, documents
from taskrpc.cli.shared.remote import remote_of
from taskrpc.cli.shared.values import as_typed

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from taskrpc.topic import Publisher

_POLL = 0.1
"""Seconds between two looks for subscriptions."""
_POLLS_PER_LINE = 10
"""Looks for subscriptions for each printed line."""


def run(options: argparse.Namespace) -> int:
    """Publish the messages that the options describe."""
    waits = options.wait_matching_subscriptions is not None or options.once or options.times
    if options.max_wait_time_secs is not None and not waits:
        problem = "expected -w, --once or --times beside --max-wait-time-secs, got none of them"
        raise UsageError(problem)
    cls = message_class(options.message_type)
    templates = [Template(cls, values) for values in _given(options)]
    asyncio.run(_publish(options, templates))
    return Exit.DONE


def _subscriptions_awaited(options: argparse.Namespace) -> int:
    if options.wait_matching_subscriptions is not None:
        return int(options.wait_matching_subscriptions)
    return 1 if options.once or options.times else 0


def _given(options: argparse.Namespace) -> list[list[str]]:
    """Return the values of each message: from the command line, standard input or a file."""
    if not options.stdin and not options.yaml_file:
        return [options.values]
    if options.values or (options.stdin and options.yaml_file):
        raise UsageError("expected one of values, --stdin and --yaml-file, got several")
    if options.stdin:
        return [[standard_input()]]
    found = documents(options.yaml_file)
    if not found:
        raise UsageError(f"expected messages in {options.yaml_file}, got none")
    return [[text] for text in found]


def message_class(type_name: str) -> Any:
    """Return the class of a message type of this machine. Raises DefinitionError."""
    try:
        found = definitions.load(message_type_name(type_name))
    except srvgen.DefinitionError as error:
        problem = "The passed message type is invalid"
        raise srvgen.DefinitionError(problem, hint=str(error)) from None
    if hasattr(found, "Request"):
        problem = "The passed type is not a message"
        raise srvgen.DefinitionError(problem, hint=f"{type_name} is a service")
    return found


async def _publish(options: argparse.Namespace, templates: Sequence[Template]) -> None:
    topic = quoting.expanded(options.topic_name, kind="topic name")
    remote = remote_of(options)
    async with remote.node(name=options.node_name or "") as node:
        publisher = node.create_publisher(templates[0].cls, topic, qos_to_publish(options))
        times = 1 if options.once else options.times
        await _wait_for_subscriptions(options, publisher)
        print("publisher: beginning loop", flush=True)
        tune_for_long_run()
        await _loop(options, publisher, templates, times)
        await asyncio.sleep(options.keep_alive)


async def _wait_for_subscriptions(options: argparse.Namespace, publisher: Publisher[Any]) -> None:
    least = _subscriptions_awaited(options)
    loop = asyncio.get_running_loop()
    timeout = options.max_wait_time_secs
    deadline = None if timeout is None else loop.time() + timeout
    for poll in itertools.count():
        if publisher.get_subscription_count() >= least:
            return
        if deadline is not None and loop.time() >= deadline:
            count = publisher.get_subscription_count()
            problem = f"Expected {least} subscribers but only got {count} subscribers"
            raise NotFound(f"Timed out waiting for subscribers: {problem}")
        if poll % _POLLS_PER_LINE == 0:
            print(f"Waiting for at least {least} matching subscription(s)...", flush=True)
        await asyncio.sleep(_POLL)


async def _loop(
    options: argparse.Namespace,
    publisher: Publisher[Any],
    templates: Sequence[Template],
    times: int,
) -> None:
    loop = asyncio.get_running_loop()
    began, every = loop.time(), options.print
    for number, template in enumerate(itertools.cycle(templates), 1):
        message = template.message()
        if every and number % every == 0:
            print(f"publishing #{number}: {as_typed(message)!r}\n", flush=True)
        publisher.publish(message)
        if number == times:
            return
        await asyncio.sleep(max(0.0, began + number / options.rate - loop.time()))
