"""Facts about topics without reading them: names, types, publishers and subscriptions."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from taskrpc import names
from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import print_names
from taskrpc.cli.shared.remote import remote_of
from taskrpc.transport.discovery.entries import RegistryEntry
from taskrpc.wire.messages import TopicEndpoint

if TYPE_CHECKING:
    import argparse

_KINDS = {"PUBLISHER": 1, "SUBSCRIPTION": 2}
"""The kinds of endpoints, with their values in rclpy's `EndpointTypeEnum`."""

Ends: TypeAlias = list[tuple[TopicEndpoint, RegistryEntry]]


class Topic:
    """One topic: its publishers and subscriptions, each with its process."""

    def __init__(self) -> None:
        self.publishers: Ends = []
        self.subscriptions: Ends = []

    @property
    def types(self) -> list[str]:
        """The names of its types; several where programs disagree."""
        return sorted({each.type_name for each, _ in self.publishers + self.subscriptions})


def topics(entries: Iterable[RegistryEntry], *, hidden: bool = False) -> dict[str, Topic]:
    """Every topic by its name."""
    found: dict[str, Topic] = {}
    for entry in entries:
        for each in entry.publishers:
            found.setdefault(each.name, Topic()).publishers.append((each, entry))
        for each in entry.subscriptions:
            found.setdefault(each.name, Topic()).subscriptions.append((each, entry))
    return {name: found[name] for name in sorted(found) if hidden or not names.is_hidden(name)}


def message_type_name(text: str) -> str:
    """The full name of a message's type; `pkg/Name` means `pkg/msg/Name`."""
    package, *rest = text.split("/")
    return f"{package}/msg/{rest[0]}" if len(rest) == 1 else text


def unknown(topic: str, known: Iterable[str]) -> NotFound:
    """The error of a topic that nobody has."""
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
            ends = topic.publishers if what == "publisher" else topic.subscriptions
            if ends:
                plural = "s" if len(ends) > 1 else ""
                yield f" * {name} [{', '.join(topic.types)}] {len(ends)} {what}{plural}"
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
    """Print what is known of a topic."""
    name, topic = _topic(options)
    type_ = topic.types[0] if len(topic.types) == 1 else str(topic.types)
    if options.json:
        print(json.dumps(_as_json(name, topic)))
        return Exit.DONE
    print(f"Type: {type_}")
    for title, kind, ends in (
        ("Publisher", "PUBLISHER", topic.publishers),
        ("Subscription", "SUBSCRIPTION", topic.subscriptions),
    ):
        gap = "\n" if options.verbose else ""
        print(f"{gap}{title} count: {len(ends)}")
        for end, entry in ends if options.verbose else ():
            print("\n" + "\n".join(_end(kind, end, entry)))
    if options.verbose:
        print()
    return Exit.DONE


def _end(kind: str, end: TopicEndpoint, entry: RegistryEntry) -> Iterator[str]:
    namespace, _, node = end.node.rpartition("/")
    yield f"Node name: {node}"
    yield f"Node namespace: {namespace or '/'}"
    yield f"Topic type: {end.type_name}"
    yield f"Topic type hash: {end.type_hash}"
    yield f"Endpoint type: {kind}"
    yield f"GID: {graph.gid(entry, end, _KINDS[kind])}"
    if entry.pid:
        yield f"Process: {entry.script} (pid {entry.pid}, in {entry.folder})"
    if entry.address:
        yield f"Address: {entry.address}"
    yield from graph.qos_lines(reliable=end.reliable, depth=end.depth, latched=end.latched)


def _as_json(name: str, topic: Topic) -> dict[str, object]:
    ends = {"PUBLISHER": topic.publishers, "SUBSCRIPTION": topic.subscriptions}
    told = {
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
        for kind, of_kind in ends.items()
    }
    return {"name": name, "types": topic.types, **told}


def _topic(options: argparse.Namespace) -> tuple[str, Topic]:
    name = quoting.expanded(options.topic_name, kind="topic name")
    found = topics(graph.look(remote_of(options)), hidden=True)
    if name not in found:
        raise unknown(name, found)
    return name, found[name]
