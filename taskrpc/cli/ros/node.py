"""`taskrpc node`: list and info, as in `ros2 node`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator

from taskrpc.cli.ros.action.action_graph import Action, actions
from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.parsing import add_command, add_group, print_names
from taskrpc.cli.shared.remote import add_connect, add_discovery, remote_of
from taskrpc.spi import ServiceEndpoint, TopicEndpoint, names

_SECTIONS = (
    "Subscribers",
    "Publishers",
    "Service Servers",
    "Service Clients",
    "Action Servers",
    "Action Clients",
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about nodes."""
    commands = add_group(parser)
    info = add_command(commands, "info", "Output information about a node")
    info.add_argument("node_name", help="Fully qualified node name (e.g. '/task_server')")
    what = "Display hidden topics, services, and actions as well"
    info.add_argument("--include-hidden", action="store_true", help=what)
    info.set_defaults(run=_info)
    listing = add_command(commands, "list", "Output a list of available nodes")
    what = "Display all nodes even hidden ones"
    listing.add_argument("-a", "--all", action="store_true", help=what)
    what = "Only display the number of nodes discovered"
    listing.add_argument("-c", "--count-nodes", "--count", action="store_true", help=what)
    listing.set_defaults(run=_list)
    for command in (info, listing):
        add_connect(command)
        add_discovery(command)
        command.add_argument("--json", action="store_true", help="Print JSON")


def _list(options: argparse.Namespace) -> int:
    entries = graph.look(remote_of(options))
    found = sorted(name for entry in entries for name in entry.nodes)
    shown = [name for name in found if options.all or not names.is_hidden_node(name)]
    if len(set(shown)) < len(shown) and not options.count_nodes:
        problem = "there are nodes in the graph that share an exact name"
        effect = "which can have unintended side effects"
        print(f"WARNING: Be aware that {problem}, {effect}.", file=sys.stderr)
    return print_names(shown, count=options.count_nodes, as_json=options.json)


def _info(options: argparse.Namespace) -> int:
    entries = graph.look(remote_of(options))
    name = quoting.expanded(options.node_name, kind="node name")
    running = [node for entry in entries for node in entry.nodes]
    hidden = options.include_hidden
    known = [node for node in running if hidden or not names.is_hidden_node(node)]
    if (count := known.count(name)) > 1:
        several = f'There are {count} nodes in the graph with the exact name "{name}".'
        print(f"{several} You are seeing information about all of them.", file=sys.stderr)
    if name not in known:
        from srvgen.definitions.names import did_you_mean

        hint = did_you_mean(name, known)
        if name in running:
            hint = f"{name} is hidden; add --include-hidden"
        raise hinted(NotFound(f"Unable to find node '{name}'"), hint)
    sections: dict[str, dict[str, str]] = {section: {} for section in _SECTIONS}
    sections["Subscribers"] = _of_node(name, (e.subscriptions for e in entries), hidden)
    sections["Publishers"] = _of_node(name, (e.publishers for e in entries), hidden)
    sections["Service Servers"] = _of_node(name, (e.services for e in entries), hidden)
    sections["Service Clients"] = _of_node(name, (e.clients for e in entries), hidden)
    known_actions = actions(entries)
    sections["Action Servers"] = _actions(name, known_actions, "servers")
    sections["Action Clients"] = _actions(name, known_actions, "clients")
    if options.json:
        print(json.dumps({"name": name, **sections}))
    else:
        print("\n".join(_text(name, sections)))
    return Exit.DONE


def _actions(node: str, known: dict[str, Action], side: str) -> dict[str, str]:
    """Return the names and types of the actions that a node offers or uses."""
    nodes = {name: getattr(action, side) for name, action in known.items()}
    return {name: found[node] for name, found in nodes.items() if node in found}


def _of_node(
    node: str, groups: Iterable[Iterable[ServiceEndpoint | TopicEndpoint]], hidden: bool
) -> dict[str, str]:
    """Return the names and types of a node's endpoints, sorted by name."""
    found = {each.name: each.type_name for group in groups for each in group if each.node == node}
    return {name: found[name] for name in sorted(found) if hidden or not names.is_hidden(name)}


def _text(name: str, sections: dict[str, dict[str, str]]) -> Iterator[str]:
    yield name
    for section, found in sections.items():
        yield f"  {section}:"
        yield from (f"    {service}: {type_}" for service, type_ in found.items())
        # ros2 prints an empty section as one blank line.
        if not found:
            yield ""
