"""Completion with the TAB key: the names of services, topics, nodes, types and executables."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from typing import TYPE_CHECKING, NoReturn

from srvgen.cli import completion
from taskrpc.cli.ros.action.action_graph import actions
from taskrpc.cli.ros.topic.topic_graph import topics
from taskrpc.cli.shared import definitions, graph
from taskrpc.cli.shared.remote import HERE
from taskrpc.spi import names, suggestions

if TYPE_CHECKING:
    from taskrpc.spi import RegistryEntry


def complete(parser: ArgumentParser) -> NoReturn:
    """Print the completions for the word at the cursor, and exit."""
    completion.complete(parser, _FINDERS)


def _entries() -> list[RegistryEntry]:
    return graph.look(HERE)


def _services(_: Namespace) -> Iterable[str]:
    return suggestions.services(_entries())


def _topics(_: Namespace) -> Iterable[str]:
    return topics(_entries())


def _nodes(_: Namespace) -> Iterable[str]:
    return [name for each in _entries() for name in each.nodes if not names.is_hidden_node(name)]


def _interfaces(kind: str) -> Iterable[str]:
    search = definitions.search()
    found = (name for package in search.packages() for name in search.interfaces(package))
    return [name for name in found if f"/{kind}/" in name or not kind]


def _type_of_service(options: Namespace) -> Iterable[str]:
    """Complete the type of the service named before it; every type if no program offers it."""
    service = getattr(options, "service_name", "")
    return suggestions.services(_entries(), hidden=True).get(service) or _interfaces("srv")


def _request(options: Namespace) -> Iterable[str]:
    """Complete the type of a request; the values that follow it are not completed."""
    return [] if options.request else _type_of_service(options)


def _type_of_topic(options: Namespace) -> Iterable[str]:
    """Complete the type of the topic named before it; every type if no program has that topic."""
    known = topics(_entries(), hidden=True).get(options.topic_name)
    return known.types if known else _interfaces("msg")


def _actions(_: Namespace) -> Iterable[str]:
    return actions(_entries())


def _type_of_action(options: Namespace) -> Iterable[str]:
    """Complete the type of the action named before it; every type if no program has it."""
    known = actions(_entries()).get(getattr(options, "action_name", ""))
    return known.types if known else _interfaces("action")


def _goal(options: Namespace) -> Iterable[str]:
    """Complete the type of a goal; the values that follow it are not completed."""
    return [] if options.goal else _type_of_action(options)


def _packages(_: Namespace) -> Iterable[str]:
    from pathlib import Path

    from taskrpc.ros import workspace

    return {*workspace.packages(Path.cwd()), *definitions.search().packages()}


def _programs(options: Namespace) -> Iterable[str]:
    """Complete a package of this workspace, then one of the package's executables."""
    from pathlib import Path

    from taskrpc.ros import installed, workspace

    found = workspace.packages(Path.cwd())
    given = getattr(options, "rest", None) or []
    if not given:
        return found
    folder = found.get(given[0]) if len(given) == 1 else None
    return installed.executables(folder) if folder else ()


def _scenes(_: Namespace) -> Iterable[str]:
    from taskrpc.course.scenes.catalogue import SCENES

    return [each.name for each in SCENES]


_FINDERS: dict[str, completion.Finder] = {
    "service_name": _services,
    "action_name": _actions,
    "action_type": _type_of_action,
    "goal": _goal,
    "topic_name": _topics,
    "topic_names": _topics,
    "node_name": _nodes,
    "request": _request,
    "scene_name": _scenes,
    "service_type": _type_of_service,
    "message_type": _type_of_topic,
    "topic_type": lambda _: _interfaces("msg"),
    "type": lambda _: _interfaces(""),
    "package_name": _packages,
    "rest": _programs,
}
"""The function for each argument, by its `dest`."""
