"""`taskrpc lifecycle`: nodes, list, get and set, as in `ros2 lifecycle`."""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.cli.shared.command import Exit, NotFound
from taskrpc.cli.shared.parsing import Parser, add_command, add_group, number, print_names
from taskrpc.cli.shared.remote import add_connect, add_discovery, remote_of
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.cli.ros.lifecycle.lifecycle_services import LifecycleServices
    from taskrpc.cli.shared.parsing import Commands

    Action: TypeAlias = Callable[[argparse.Namespace, LifecycleServices], Coroutine[Any, Any, Exit]]


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about lifecycle nodes."""
    commands = add_group(parser)
    _add_get(commands)
    command = _add(commands, "list", "Output a list of available transitions", _list)
    what = "Display all existing transitions"
    command.add_argument("-a", "--all", action="store_true", help=what)
    _add_nodes(commands)
    command = _add(commands, "set", "Trigger lifecycle state transition", _set)
    command.add_argument("transition", help="The lifecycle transition: its label or its number")


def _add(commands: Commands, verb: str, purpose: str, action: Action) -> Parser:
    command = add_command(commands, verb, purpose)
    command.add_argument("node_name", help="Name of the ROS node")
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", action="store_true", help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_run, action=action, timeout=None)
    return command


def _add_get(commands: Commands) -> None:
    command = add_command(commands, "get", "Get lifecycle state for one or more nodes")
    what = "Name of the ROS node; without it, get the state of all nodes"
    command.add_argument("node_name", nargs="?", help=what)
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", "-a", "--all", action="store_true", help=what)
    above_zero = number("greater than 0", lambda seconds: seconds > 0)
    what = "Seconds to wait for the response of a node; without it, there is no limit"
    command.add_argument("--timeout", metavar="N", type=above_zero, help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=lambda options: asyncio.run(_get(options)))


def _add_nodes(commands: Commands) -> None:
    command = add_command(commands, "nodes", "Output a list of nodes with lifecycle")
    what = "Display all nodes even hidden ones"
    command.add_argument("-a", "--all", action="store_true", help=what)
    what = "Only display the number of nodes discovered"
    command.add_argument("-c", "--count-nodes", action="store_true", help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_nodes)


def _nodes(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.lifecycle.lifecycle_services import lifecycle_nodes
    from taskrpc.cli.shared import graph

    found = lifecycle_nodes(graph.look(remote_of(options)), hidden=options.all)
    return print_names(found, count=options.count_nodes)


async def _get(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.ros.lifecycle.lifecycle_services import (
        LifecycleServices,
        checked_node,
        lifecycle_nodes,
    )
    from taskrpc.cli.shared.graph import entries_of
    from taskrpc.cli.shared.quoting import expanded

    remote, hidden = remote_of(options), options.include_hidden_nodes
    async with remote.node() as node:
        entries = await entries_of(remote, node)
        if options.node_name:
            name = expanded(options.node_name, kind="node name")
            found = [checked_node(name, entries, hidden=hidden)]
        else:
            found = lifecycle_nodes(entries, hidden=hidden)
        for name in found:
            try:
                state = await LifecycleServices(node, name, options.timeout).state()
            except TaskRpcError as error:
                if options.node_name:
                    raise
                problem = f"Exception while calling service of node '{name}': {error}"
                print(problem, file=sys.stderr)
            else:
                prefix = "" if options.node_name else f"{name}: "
                print(f"{prefix}{state.label} [{state.id}]", flush=True)
    return Exit.DONE


def _run(options: argparse.Namespace) -> Exit:
    return asyncio.run(_with_node(options))


async def _with_node(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.ros.lifecycle.lifecycle_services import LifecycleServices, checked_node
    from taskrpc.cli.shared.graph import entries_of
    from taskrpc.cli.shared.quoting import expanded

    remote = remote_of(options)
    name = expanded(options.node_name, kind="node name")
    async with remote.node() as node:
        entries = await entries_of(remote, node)
        checked_node(name, entries, hidden=options.include_hidden_nodes)
        action: Action = options.action
        return await action(options, LifecycleServices(node, name, options.timeout))


async def _list(options: argparse.Namespace, services: LifecycleServices) -> Exit:
    for each in await services.transitions(possible_now=not options.all):
        print(
            f"- {each.transition.label} [{each.transition.id}]\n"
            f"\tStart: {each.start_state.label}\n"
            f"\tGoal: {each.goal_state.label}"
        )
    return Exit.DONE


async def _set(options: argparse.Namespace, services: LifecycleServices) -> Exit:
    possible = [each.transition for each in await services.transitions(possible_now=True)]
    # A label counts before a number, as in ros2.
    wanted = [each for each in possible if each.label == options.transition]
    wanted += [each for each in possible if str(each.id) == options.transition]
    if not wanted:
        lines = [f"- {each.label} [{each.id}]" for each in possible]
        raise NotFound("\n".join(["Unknown transition requested, available ones are:", *lines]))
    if await services.change(wanted[0]):
        print("Transitioning successful")
    else:  # the call itself worked, so the exit code is 0, as in ros2
        print("Transitioning failed", file=sys.stderr)
    return Exit.DONE
