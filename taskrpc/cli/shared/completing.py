"""What may stand next on a command line: verbs, options, and the names of what is there."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

from taskrpc.cli.main import parser_of
from taskrpc.errors import TaskRpcError

Names: TypeAlias = "Iterable[str]"


def candidates(words: Sequence[str]) -> list[str]:
    """What the last of the words may become; the others stand before it, after `taskrpc`."""
    *before, begun = words or [""]
    parser: argparse.ArgumentParser = parser_of(next(iter(before), ""))
    given: list[str] = []
    is_value = False
    for word in before:
        verbs = _verbs(parser)
        if word.startswith("-") or is_value:
            is_value = not is_value and _takes_value(parser, word)
        elif word in verbs:
            parser = verbs[word]
        elif verbs:
            return []
        else:
            given.append(word)
    if is_value:
        return []
    try:
        found = set(_options(parser) if begun.startswith("-") else _next(parser, given))
    except (TaskRpcError, OSError):
        found = set()  # a key press is no occasion for a message
    return sorted(name for name in found if name.startswith(begun))


def _verbs(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _takes_value(parser: argparse.ArgumentParser, option: str) -> bool:
    return any(option in each.option_strings and each.nargs != 0 for each in parser._actions)


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [
        option
        for action in parser._actions
        if action.help != argparse.SUPPRESS
        for option in action.option_strings
    ]


def _next(parser: argparse.ArgumentParser, given: list[str]) -> Names:
    """What the first argument may be that is not given yet."""
    if verbs := _verbs(parser):
        return verbs
    places = [action for action in parser._actions if not action.option_strings]
    if not places:
        return ()
    place = places[min(len(given), len(places) - 1)]
    finder = _FINDERS.get(place.dest)
    return finder(given) if finder is not None else ()


def _services(_: list[str]) -> Names:
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import HERE

    return graph.services(graph.look(HERE))


def _topics(_: list[str]) -> Names:
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import HERE
    from taskrpc.cli.topic.topic_graph import topics

    return topics(graph.look(HERE))


def _nodes(_: list[str]) -> Names:
    from taskrpc import names
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import HERE

    entries = graph.look(HERE)
    return [name for entry in entries for name in entry.nodes if not names.is_hidden(name)]


def _interfaces(kind: str) -> Names:
    from taskrpc.cli.shared import definitions

    search = definitions.search()
    names = (name for package in search.packages() for name in search.interfaces(package))
    return [name for name in names if f"/{kind}/" in name or not kind]


def _type_of_service(given: list[str]) -> Names:
    """The type that a service has; every type where it is not there."""
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import HERE

    known = graph.services(graph.look(HERE), hidden=True) if given else {}
    return known.get(given[0], []) if given and given[0] in known else _interfaces("srv")


def _type_of_topic(given: list[str]) -> Names:
    """The type that a topic has; every type where it is not there."""
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import HERE
    from taskrpc.cli.topic.topic_graph import topics

    known = topics(graph.look(HERE), hidden=True) if given else {}
    return known[given[0]].types if given and given[0] in known else _interfaces("msg")


def _packages(_: list[str]) -> Names:
    from pathlib import Path

    from taskrpc.cli.shared import definitions
    from taskrpc.ros import workspace

    return {*workspace.packages(Path.cwd()), *definitions.search().packages()}


def _programs(given: list[str]) -> Names:
    """Packages of the workspace here, then a package's executables; files the shell knows."""
    from pathlib import Path

    from taskrpc.ros import cmake, executables, workspace

    found = workspace.packages(Path.cwd())
    if not given:
        return found
    folder = found.get(given[0]) if len(given) == 1 else None
    if folder is None:
        return ()
    return {*executables.entry_points(folder), *cmake.programs(folder)}


_FINDERS: dict[str, Callable[[list[str]], Names]] = {
    "service_name": _services,
    "topic_name": _topics,
    "topic_names": _topics,
    "node_name": _nodes,
    "request": _type_of_service,
    "service_type": _type_of_service,
    "message_type": _type_of_topic,
    "topic_type": lambda given: _interfaces("msg"),
    "type": lambda given: _interfaces(""),
    "package_name": _packages,
    "rest": _programs,
}
