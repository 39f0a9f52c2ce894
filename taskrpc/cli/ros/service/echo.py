"""`taskrpc service echo`: prints the introspection events of a service."""

from __future__ import annotations

import asyncio
import sys
from typing import TYPE_CHECKING, Any

import yaml

import srvgen
from taskrpc.cli.ros.topic.reading import Feed
from taskrpc.cli.ros.topic.topic_graph import topics
from taskrpc.cli.shared import definitions, graph, quoting
from taskrpc.cli.shared.command import Exit, NotFound, hinted, tune_for_long_run
from taskrpc.cli.shared.definitions import service_type_name
from taskrpc.cli.shared.remote import remote_of
from taskrpc.qos import QoS
from taskrpc.ros.message_text import Cut, csv_of, plain
from taskrpc.spi import suggestions

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable

    from taskrpc.spi import RegistryEntry

_DEPTH = 100


def echo(options: argparse.Namespace) -> Exit:
    """Print the events of a service, until Ctrl-C."""
    asyncio.run(_echo(options))
    return Exit.DONE


def event_text(event: Any, cut: Cut, *, flow: bool = False) -> str:
    """Return an event as ros2 prints it: YAML with a line break at the end.

    `flow` puts each array on one line.
    """
    shown = plain(event, cut)
    kind = shown["info"]["event_type"]
    steps = ("REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED")
    if kind in range(len(steps)):
        shown["info"]["event_type"] = steps[kind]
    return yaml.dump(
        shown,
        Dumper=_FlowDumper if flow else yaml.SafeDumper,
        allow_unicode=True,
        default_flow_style=False,
        sort_keys=False,
        width=sys.maxsize,
    )


class _FlowDumper(yaml.SafeDumper):
    """Writes lists, with their contents, on one line."""


_FlowDumper.add_representer(
    list, lambda dumper, value: dumper.represent_sequence(_LIST, value, flow_style=True)
)
_LIST = "tag:yaml.org,2002:seq"


async def _echo(options: argparse.Namespace) -> None:
    name = quoting.expanded(options.service_name)
    topic = f"{name}/_service_event"
    remote = remote_of(options)
    length = None if options.full_length else options.truncate_length
    cut = Cut(length, arrays=not options.no_arr, texts=not options.no_str)

    def show(event: Any) -> None:
        if options.csv:
            print(csv_of(event, cut), flush=True)
        else:
            print(event_text(event, cut, flow=options.flow_style) + "---", flush=True)

    async with remote.node() as node:
        entries = await graph.entries_of(remote, node)
        cls = _service_type(options.service_type, name, entries)
        events = topics(entries, hidden=True).get(topic)
        publishers = [each for each, _ in events.publishers] if events else []
        if not publishers:
            print(_no_events(name), file=sys.stderr, flush=True)
        reliable = bool(publishers) and all(each.reliable for each in publishers)
        qos = QoS(_DEPTH, "reliable" if reliable else "best_effort", "volatile")
        feed = Feed(show)
        node.create_subscription(cls.Event, topic, feed.take, qos)
        tune_for_long_run()
        await feed.wait()


def _service_type(given: str, name: str, entries: Iterable[RegistryEntry]) -> Any:
    types = [given] if given else suggestions.services(entries, hidden=True).get(name, [])
    if not types:
        hint = graph.unknown_service_hint(name, entries)
        raise hinted(NotFound(f"Cannot find type for '{name}'"), hint)
    try:
        found = definitions.load(service_type_name(types[0]))
    except srvgen.DefinitionError as error:
        problem = f"The service type '{types[0]}' is invalid"
        raise srvgen.DefinitionError(problem, hint=str(error)) from None
    if not hasattr(found, "Event"):
        problem = f"The service type '{types[0]}' is invalid"
        raise srvgen.DefinitionError(problem, hint="it is not a service")
    return found


def _no_events(name: str) -> str:
    return (
        f"note: no program publishes the calls of {name} yet. Its server needs"
        ' node.configure_introspection(service, "contents"); taskrpc-server needs --introspection'
        " contents; an rclpy program needs"
        " configure_introspection(clock, qos, ServiceIntrospectionState.CONTENTS)"
    )
