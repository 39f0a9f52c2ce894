"""Facts about topics without subscribing: names, types, publishers and subscriptions."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import print_names
from taskrpc.cli.shared.remote import remote_of
from taskrpc.spi import RegistryEntry, TopicEndpoint, names

if TYPE_CHECKING:
    import argparse

_KINDS = {"PUBLISHER": 1, "SUBSCRIPTION": 2}
"""The kinds of endpoints, with their values in rclpy's `EndpointTypeEnum`."""

Endpoints: TypeAlias = list[tuple[TopicEndpoint, RegistryEntry]]


class Topic:
    """One topic: its publishers and subscriptions, each with its process."""

    def __init__(self) -> None:
        self.publishers: Endpoints = []
        self.subscriptions: Endpoints = []

    @property
    def types(self) -> list[str]:
        """The names of its types; several if programs disagree."""
        return sorted({each.type_name for each, _ in self.publishers + self.subscriptions})


def topics(entries: Iterable[RegistryEntry], *, hidden: bool = False) -> dict[str, Topic]:
    """Return all topics by name."""
    found: dict[str, Topic] = {}
    for entry in entries:
        for each in entry.publishers:
            found.setdefault(each.name, Topic()).publishers.append((each, entry))
        for each in entry.subscriptions:
            found.setdefault(each.name, Topic()).subscriptions.append((each, entry))
    return {name: found[name] for name in sorted(found) if hidden or not names.is_hidden(name)}


def message_type_name(text: str) -> str:
    """Return the full name of a message's type; `pkg/Name` means `pkg/msg/Name`."""
    package, *rest = text.split("/")
    return f"{package}/msg/{rest[0]}" if len(rest) == 1 else text


def unknown(topic: str, known: Iterable[str]) -> NotFound:
    """Return the error for a topic that no program has."""
    from srvgen.definitions.names import did_you_mean

    return hinted(NotFound(f"Unknown topic '{topic}'"), did_you_mean(topic, known))


def print_list(options: argparse.Namespace) -> int:
    """Print the topics."""
    hidden = options.include_hidden_topics or getattr(options, "all", False)
    found = topics(graph.look(remote_of(options)), hidden=hidden)
    if options.count_topics:
        print(len(found))
    elif options.json:
        print(json.dumps([{"name": name, "types": each.types} for name, each in found.items()]))
    elif options.verbose:
        if found:
            print("\n".join(_verbose(found)))
    else:
        for name, topic in found.items():
            print(f"{name} [{', '.join(topic.types)}]" if options.show_types else name)
    return Exit.DONE


def _verbose(found: dict[str, Topic]) -> Iterator[str]:
    for title, what in ("Published", "publisher"), ("Subscribed", "subscriber"):
        yield f"{title} topics:"
        for name, topic in found.items():
            endpoints = topic.publishers if what == "publisher" else topic.subscriptions
            if endpoints:
                plural = "s" if len(endpoints) > 1 else ""
                yield f" * {name} [{', '.join(topic.types)}] {len(endpoints)} {what}{plural}"
        yield ""


def print_found(options: argparse.Namespace) -> int:
    """Print the topics of a type."""
    wanted = message_type_name(options.topic_type)
    found = topics(graph.look(remote_of(options)), hidden=options.include_hidden_topics)
    matching = [name for name, topic in found.items() if wanted in topic.types]
    return print_names(matching, count=options.count_topics, as_json=options.json)


def print_type(options: argparse.Namespace) -> int:
    """Print the type of a topic."""
    return print_names(_topic(options)[1].types)


def print_info(options: argparse.Namespace) -> int:
    """Print the facts about a topic."""
    name, topic = _topic(options)
    type_ = topic.types[0] if len(topic.types) == 1 else str(topic.types)
    if options.json:
        print(json.dumps(_as_json(name, topic)))
        return Exit.DONE
    print(f"Type: {type_}")
    for title, kind, endpoints in (
        ("Publisher", "PUBLISHER", topic.publishers),
        ("Subscription", "SUBSCRIPTION", topic.subscriptions),
    ):
        gap = "\n" if options.verbose else ""
        print(f"{gap}{title} count: {len(endpoints)}")
        for endpoint, entry in endpoints if options.verbose else ():
            print("\n" + "\n".join(_lines(kind, endpoint, entry)))
    if options.verbose:
        print()
    return Exit.DONE


def _lines(kind: str, endpoint: TopicEndpoint, entry: RegistryEntry) -> Iterator[str]:
    namespace, _, node = endpoint.node.rpartition("/")
    yield f"Node name: {node}"
    yield f"Node namespace: {namespace or '/'}"
    yield f"Topic type: {endpoint.type_name}"
    yield f"Topic type hash: {endpoint.type_hash}"
    yield f"Endpoint type: {kind}"
    yield f"GID: {graph.gid(entry, endpoint, _KINDS[kind])}"
    if entry.pid:
        yield f"Process: {entry.script} (pid {entry.pid}, in {entry.folder})"
    if entry.address:
        yield f"Address: {entry.address}"
    yield from graph.qos_lines(
        reliable=endpoint.reliable, depth=endpoint.depth, latched=endpoint.latched
    )


def _as_json(name: str, topic: Topic) -> dict[str, object]:
    endpoints = {"PUBLISHER": topic.publishers, "SUBSCRIPTION": topic.subscriptions}
    facts = {
        f"{kind.lower()}s": [
            {
                "node": each.node,
                "type": each.type_name,
                "gid": graph.gid(entry, each, _KINDS[kind]),
                "depth": each.depth,
                "reliability": "reliable" if each.reliable else "best_effort",
                "durability": "transient_local" if each.latched else "volatile",
                "pid": entry.pid,
            }
            for each, entry in of_kind
        ]
        for kind, of_kind in endpoints.items()
    }
    return {"name": name, "types": topic.types, **facts}


def _topic(options: argparse.Namespace) -> tuple[str, Topic]:
    name = quoting.expanded(options.topic_name, kind="topic name")
    found = topics(graph.look(remote_of(options)), hidden=True)
    if name not in found:
        raise unknown(name, found)
    return name, found[name]
