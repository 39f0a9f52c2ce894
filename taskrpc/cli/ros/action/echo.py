"""`taskrpc action echo`: prints the messages of an action's topics and services."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any

from taskrpc.cli.ros.action.action_graph import action_type, actions
from taskrpc.cli.ros.service.echo import event_text
from taskrpc.cli.ros.topic.reading import Feed
from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted, tune_for_long_run
from taskrpc.cli.shared.remote import remote_of
from taskrpc.qos import QoS
from taskrpc.ros.message_text import Cut, csv_of, yaml_of
from taskrpc.spi import FEEDBACK_QOS, STATUS_QOS, SUFFIX, ActionMessages, names_of

if TYPE_CHECKING:
    import argparse

_EVENTS_QOS = QoS(depth=100)
INTERFACES = (
    "GOAL_SERVICE",
    "CANCEL_SERVICE",
    "RESULT_SERVICE",
    "FEEDBACK_TOPIC",
    "STATUS_TOPIC",
)
"""What an action consists of, as ros2 calls it."""


def echo(options: argparse.Namespace) -> Exit:
    """Print the messages, until Ctrl-C."""
    wanted = chosen(options.interfaces)
    asyncio.run(_echo(options, wanted))
    return Exit.DONE


def chosen(text: str | None) -> list[str]:
    """Return the interfaces that `--interfaces` names, all without it. Raises UsageError."""
    if text is None:
        return list(INTERFACES)
    found = [name.strip().upper() for name in text.split("|")]
    for name in found:
        if name not in INTERFACES:
            expected = f"expected {', '.join(INTERFACES)}, separated by |"
            raise UsageError(f"--interfaces: {expected}; got {name!r}")
    return found


async def _echo(options: argparse.Namespace, wanted: list[str]) -> None:
    name = quoting.expanded(options.action_name, kind="action name")
    remote = remote_of(options)
    length = None if options.full_length else options.truncate_length
    cut = Cut(length, arrays=not options.no_arr, texts=not options.no_str)

    def show(received: tuple[str, Any]) -> None:
        interface, message = received
        if options.csv:
            text = csv_of(message, cut)
        elif interface.endswith("SERVICE"):
            text = f"{event_text(message, cut, flow=options.flow_style)}---"
        else:
            text = f"{yaml_of(message, cut, flow=options.flow_style)}---"
        print(f"interface: {interface}\n{text}", flush=True)

    async with remote.node() as node:
        known = actions(await graph.entries_of(remote, node))
        types = [options.action_type] if options.action_type else []
        types += known[name].types if name in known else []
        if not types:
            from srvgen.definitions.names import did_you_mean

            problem = NotFound(f"Cannot find type for '{name}'")
            raise hinted(problem, did_you_mean(name, known) or "write the type after the name")
        feed = Feed(show)
        for interface, (cls, topic, qos) in _topics(action_type(types[0]), name).items():
            if interface in wanted:
                take = partial(_take, feed, interface)
                node.create_subscription(cls, topic, take, qos)
        tune_for_long_run()
        await feed.wait()


async def _take(feed: Feed, interface: str, message: Any) -> None:
    await feed.take((interface, message))


def _topics(cls: Any, name: str) -> dict[str, tuple[Any, str, QoS]]:
    """Return the message type, the topic and the QoS for each interface."""
    names, messages = names_of(name), ActionMessages(cls)
    return {
        "GOAL_SERVICE": (messages.send_goal.Event, f"{names.send_goal}{SUFFIX}", _EVENTS_QOS),
        "CANCEL_SERVICE": (messages.cancel_goal.Event, f"{names.cancel_goal}{SUFFIX}", _EVENTS_QOS),
        "RESULT_SERVICE": (messages.get_result.Event, f"{names.get_result}{SUFFIX}", _EVENTS_QOS),
        "FEEDBACK_TOPIC": (messages.feedback, names.feedback, FEEDBACK_QOS),
        "STATUS_TOPIC": (messages.status, names.status, STATUS_QOS),
    }
