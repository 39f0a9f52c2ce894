"""`taskrpc param`: a node's parameters, as `ros2 param` has them."""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.cli.command import Exit, NotFound, hinted
from taskrpc.cli.parsing import Parser, add_command, add_group
from taskrpc.cli.remote import add_connect, add_discovery, remote_of
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.cli.param_services import ParamServices
    from taskrpc.cli.parsing import Commands

    Action: TypeAlias = Callable[[argparse.Namespace, ParamServices], Awaitable[Exit]]

_KINDS = {
    1: "Boolean value is:",
    2: "Integer value is:",
    3: "Double value is:",
    4: "String value is:",
    5: "Byte values are:",
    6: "Boolean values are:",
    7: "Integer values are:",
    8: "Double values are:",
    9: "String values are:",
}
_NAMES = {
    0: "not set",
    1: "boolean",
    2: "integer",
    3: "double",
    4: "string",
    5: "byte array",
    6: "boolean array",
    7: "integer array",
    8: "double array",
    9: "string array",
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about parameters."""
    commands = add_group(parser)
    _add_list(commands)
    command = _add(commands, "get", "Get parameter", _get)
    command.add_argument("parameter_name", help="Name of the parameter")
    what = "Hide the type information"
    command.add_argument("--hide-type", action="store_true", help=what)
    command = _add(commands, "set", "Set parameter", _set)
    command.add_argument("parameter_name", help="Name of the parameter")
    command.add_argument("value", help="Value of the parameter, as YAML has it")
    command = _add(commands, "describe", "Show descriptive information about parameters", _describe)
    command.add_argument("parameter_names", nargs="+", help="Names of the parameters")
    command = _add(commands, "delete", "Delete parameter", _delete)
    command.add_argument("parameter_name", help="Name of the parameter")
    _add(commands, "dump", "Show all of the parameters of a node as a YAML file", _dump)
    command = _add(commands, "load", "Load parameter file for a node", _load)
    command.add_argument("parameter_file", help="Parameter file")
    what = "Do not load parameters that the file has for every node (/**)"
    command.add_argument("--no-use-wildcard", action="store_true", help=what)


def _add_list(commands: Commands) -> None:
    command = add_command(commands, "list", "Output a list of available parameters")
    command.add_argument("node_name", nargs="?", help="Name of the ROS node")
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", action="store_true", help=what)
    what = "Only list parameters with the provided prefixes"
    command.add_argument("--param-prefixes", nargs="+", default=[], help=what)
    command.add_argument("--param-type", action="store_true", help="Print parameter types")
    what = "Only list parameters that match the regular expression"
    command.add_argument("--filter", metavar="REGEX", help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_list)


def _add(commands: Commands, verb: str, purpose: str, action: Action) -> Parser:
    command = add_command(commands, verb, purpose)
    command.add_argument("node_name", help="Name of the ROS node")
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", action="store_true", help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_run, action=action)
    return command


def _run(options: argparse.Namespace) -> Exit:
    return asyncio.run(_with_node(options))


async def _with_node(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.graph import entries_of
    from taskrpc.cli.param_services import ParamServices, checked_owner
    from taskrpc.cli.shells import expanded

    remote = remote_of(options)
    options.node_name = expanded(options.node_name, kind="node name")
    async with remote.node() as node:
        checked_owner(options.node_name, await entries_of(remote, node))
        action: Action = options.action
        return await action(options, ParamServices(node, options.node_name))


# The actions


def _list(options: argparse.Namespace) -> Exit:
    return asyncio.run(_list_all(options))


async def _list_all(options: argparse.Namespace) -> Exit:
    from taskrpc import names
    from taskrpc.cli.graph import entries_of
    from taskrpc.cli.param_services import ParamServices, checked_owner, owners
    from taskrpc.cli.shells import expanded

    remote = remote_of(options)
    async with remote.node() as node:
        entries = await entries_of(remote, node)
        if options.node_name:
            found = [checked_owner(expanded(options.node_name, kind="node name"), entries)]
        else:
            hidden = options.include_hidden_nodes
            found = [name for name in owners(entries) if hidden or not names.is_hidden(name)]
        for owner in found:
            lines = await _lines(ParamServices(node, owner), options)
            if not options.node_name:
                print(f"{owner}:")
            print("".join(f"  {line}\n" for line in lines), end="", flush=True)
    return Exit.DONE


async def _lines(services: ParamServices, options: argparse.Namespace) -> list[str]:
    import re

    found = await services.names(options.param_prefixes)
    if options.filter:
        found = [name for name in found if re.search(options.filter, name)]
    if not options.param_type:
        return found
    descriptors = await services.descriptors(found)
    return [f"{each.name} (type: {_NAMES[each.type]})" for each in descriptors]


async def _get(options: argparse.Namespace, services: ParamServices) -> Exit:
    values = await services.values([options.parameter_name])
    if not values or values[0].type not in _KINDS:
        from srvgen.names import did_you_mean

        hint = did_you_mean(options.parameter_name, await services.names())
        raise hinted(NotFound("Parameter not set"), hint)
    value = values[0]
    text = str(_plain(value))
    print(text if options.hide_type else f"{_KINDS[value.type]} {text}")
    return Exit.DONE


async def _set(options: argparse.Namespace, services: ParamServices) -> Exit:
    from taskrpc.rclpy.parameter import get_parameter_value

    value = get_parameter_value(options.value)
    result = (await services.set([_message(options.parameter_name, value)]))[0]
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"Set parameter successful{reason}")
        return Exit.DONE
    print(f"Setting parameter failed{reason}", file=sys.stderr)
    return Exit.ERROR


async def _describe(options: argparse.Namespace, services: ParamServices) -> Exit:
    for descriptor in await services.descriptors(options.parameter_names):
        print("\n".join(_described(descriptor)))
    return Exit.DONE


async def _delete(options: argparse.Namespace, services: ParamServices) -> Exit:
    import srvgen

    nothing = srvgen.load("rcl_interfaces/msg/ParameterValue")()
    result = (await services.set([_message(options.parameter_name, nothing)]))[0]
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"Deleted parameter successfully{reason}")
        return Exit.DONE
    print(f"Deleting parameter failed{reason}", file=sys.stderr)
    return Exit.ERROR


async def _dump(options: argparse.Namespace, services: ParamServices) -> Exit:
    import yaml

    found = await services.names()
    values = await services.values(found)
    tree: dict[str, Any] = {}
    for name, value in zip(found, values, strict=True):
        *groups, last = name.split(".")
        level = tree
        for group in groups:
            level = level.setdefault(group, {})
        level[last] = _plain(value)
    content = {options.node_name: {"ros__parameters": tree}}
    print(yaml.safe_dump(content, default_flow_style=False), end="")
    return Exit.DONE


async def _load(options: argparse.Namespace, services: ParamServices) -> Exit:
    from taskrpc.rclpy.parameter import parameter_dict_from_yaml_file

    try:
        found = parameter_dict_from_yaml_file(
            options.parameter_file,
            use_wildcard=not options.no_use_wildcard,
            target_nodes=[options.node_name],
        )
    except OSError as error:
        problem = f"cannot read {options.parameter_file}: {error.strerror or error}"
        raise TaskRpcError(problem) from None
    except RuntimeError as error:
        raise TaskRpcError(str(error)) from None
    results = await services.set(list(found.values()))
    code = Exit.DONE
    for name, result in zip(found, results, strict=True):
        reason = f": {result.reason}" if result.reason else ""
        if result.successful:
            print(f"Set parameter {name} successful{reason}")
        else:
            print(f"Set parameter {name} failed{reason}", file=sys.stderr)
            code = Exit.ERROR
    return code


# Values


def _plain(value: Any) -> Any:
    from taskrpc.rclpy.parameter import parameter_value_to_python

    found = parameter_value_to_python(value)
    return list(found) if hasattr(found, "tolist") or isinstance(found, tuple) else found


def _message(name: str, value: Any) -> Any:
    import srvgen

    return srvgen.load("rcl_interfaces/msg/Parameter")(name=name, value=value)


def _described(descriptor: Any) -> list[str]:
    lines = [f"Parameter name: {descriptor.name}", f"  Type: {_NAMES[descriptor.type]}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    rules = []
    if descriptor.read_only:
        rules.append("    Read only: true")
    for bounds in (*descriptor.integer_range, *descriptor.floating_point_range):
        rules += [f"    Min value: {bounds.from_value}", f"    Max value: {bounds.to_value}"]
        if bounds.step:
            rules.append(f"    Step: {bounds.step}")
    if descriptor.additional_constraints:
        rules.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return lines + (["  Constraints:", *rules] if rules else [])
