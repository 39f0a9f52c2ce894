"""`taskrpc param`: reads and sets the parameters of nodes, as in `ros2 param`."""

from __future__ import annotations

import argparse
import asyncio
import re
import sys
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted
from taskrpc.cli.shared.parsing import Parser, add_command, add_group, number
from taskrpc.cli.shared.remote import add_connect, add_discovery, remote_of
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from srvgen.stubs.rcl_interfaces.msg import (
        FloatingPointRange,
        IntegerRange,
        Parameter,
        ParameterDescriptor,
        ParameterValue,
        SetParametersResult,
    )
    from taskrpc.cli.ros.param.param_services import ParamServices
    from taskrpc.cli.shared.parsing import Commands

    Action: TypeAlias = Callable[[argparse.Namespace, ParamServices], Awaitable[Exit]]

RESPONSE_TIMEOUT = 5.0
"""Seconds that a node gets to respond."""

_POLL = 0.1  # seconds between two looks for a node
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
    what = "Name of a parameter and its value in YAML; several pairs set several parameters"
    command.add_argument("pairs", nargs="+", metavar="name value", help=what)
    what = "Set all parameters, or none if one is refused"
    command.add_argument("--atomic", action="store_true", help=what)
    command = _add(commands, "describe", "Show descriptive information about parameters", _describe)
    command.add_argument("parameter_names", nargs="+", help="Names of the parameters")
    command = _add(commands, "delete", "Delete parameter", _delete)
    command.add_argument("parameter_name", help="Name of the parameter")
    _add(commands, "dump", "Show all of the parameters of a node as a YAML file", _dump)
    command = _add(commands, "load", "Load parameter file for a node", _load)
    command.add_argument("parameter_file", help="Parameter file")
    what = "Ignore the parameters that the file has for all nodes (/**)"
    command.add_argument("--no-use-wildcard", action="store_true", help=what)


def _add_list(commands: Commands) -> None:
    command = add_command(commands, "list", "Output a list of available parameters")
    command.add_argument("node_name", nargs="?", help="Name of the ROS node")
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", action="store_true", help=what)
    what = "Only list parameters with the provided prefixes"
    command.add_argument("--param-prefixes", nargs="+", default=[], help=what)
    command.add_argument("--param-type", action="store_true", help="Print parameter types")
    what = "Only list parameters whose beginning matches a regular expression"
    command.add_argument("--filter", metavar="REGEX", type=_expression, help=what)
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_list)


def _add(commands: Commands, verb: str, purpose: str, action: Action) -> Parser:
    command = add_command(commands, verb, purpose)
    command.add_argument("node_name", help="Name of the ROS node")
    what = "Consider hidden nodes as well"
    command.add_argument("--include-hidden-nodes", action="store_true", help=what)
    at_least = number("from 0 on", lambda seconds: seconds >= 0)
    what = "Seconds to wait until the node is available (default: 0)"
    command.add_argument("--timeout", metavar="N", type=at_least, default=0.0, help=what)
    what = f"Seconds to wait for the response of the node (default: {RESPONSE_TIMEOUT:g})"
    command.add_argument(
        "--service-timeout", metavar="N", type=at_least, default=RESPONSE_TIMEOUT, help=what
    )
    add_connect(command)
    add_discovery(command)
    command.set_defaults(run=_run, action=action)
    return command


def _expression(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        problem = f"expected a regular expression, got {text!r}: {error}"
        raise argparse.ArgumentTypeError(problem) from None


def _run(options: argparse.Namespace) -> Exit:
    return asyncio.run(_with_node(options))


async def _with_node(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.ros.param.param_services import ParamServices, checked_owner
    from taskrpc.cli.shared.graph import entries_of
    from taskrpc.cli.shared.quoting import expanded

    remote = remote_of(options)
    options.node_name = expanded(options.node_name, kind="node name")
    async with remote.node() as node:
        deadline = asyncio.get_running_loop().time() + options.timeout
        while True:
            try:
                entries = await entries_of(remote, node)
                checked_owner(options.node_name, entries, hidden=options.include_hidden_nodes)
                break
            except NotFound:
                if asyncio.get_running_loop().time() >= deadline:
                    raise
            await asyncio.sleep(_POLL)
        action: Action = options.action
        services = ParamServices(node, options.node_name, options.service_timeout)
        return await action(options, services)


# The actions


def _list(options: argparse.Namespace) -> Exit:
    return asyncio.run(_list_all(options))


async def _list_all(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.ros.param.param_services import ParamServices, checked_owner, owners
    from taskrpc.cli.shared.graph import entries_of
    from taskrpc.cli.shared.quoting import expanded
    from taskrpc.spi import names

    remote = remote_of(options)
    async with remote.node() as node:
        entries = await entries_of(remote, node)
        hidden = options.include_hidden_nodes
        if options.node_name:
            name = expanded(options.node_name, kind="node name")
            found = [checked_owner(name, entries, hidden=hidden)]
        else:
            found = [name for name in owners(entries) if hidden or not names.is_hidden(name)]
        for owner in found:
            lines = await _lines(ParamServices(node, owner, RESPONSE_TIMEOUT), options)
            if not options.node_name and lines:
                print(f"{owner}:")
            print("".join(f"  {line}\n" for line in lines), end="", flush=True)
    return Exit.DONE


async def _lines(services: ParamServices, options: argparse.Namespace) -> list[str]:
    found = await services.names(options.param_prefixes)
    if options.filter:
        found = [name for name in found if options.filter.match(name)]
    if not options.param_type:
        return found
    descriptors = await services.descriptors(found)
    return [f"{each.name} (type: {_NAMES[each.type]})" for each in descriptors]


async def _get(options: argparse.Namespace, services: ParamServices) -> Exit:
    values = await services.values([options.parameter_name])
    if not values or values[0].type not in _KINDS:
        from srvgen.definitions.names import did_you_mean

        hint = did_you_mean(options.parameter_name, await services.names())
        raise hinted(NotFound("Parameter not set."), hint)
    value = values[0]
    text = str(_plain(value))
    print(text if options.hide_type else f"{_KINDS[value.type]} {text}")
    return Exit.DONE


async def _set(options: argparse.Namespace, services: ParamServices) -> Exit:
    from .ros_values import get_parameter_value

    names, values = options.pairs[::2], options.pairs[1::2]
    if len(names) != len(values):
        problem = "Parameters must be provided as name/value pairs: name value [name value ...]."
        raise UsageError(f"{problem} Got {len(options.pairs)} argument(s).")
    wanted = [
        _message(name, get_parameter_value(value))
        for name, value in zip(names, values, strict=True)
    ]
    if options.atomic:
        result = await services.set_together(wanted)
        done, failed = (
            "Set parameters atomically successful",
            "Setting parameters atomically failed",
        )
        return _report(result, done, failed)
    results = await services.set(wanted)
    several = [f"{name}: " for name in names] if len(names) > 1 else [""]
    codes = [
        _report(result, f"{name}Set parameter successful", f"{name}Setting parameter failed")
        for name, result in zip(several, results, strict=True)
    ]
    return max(codes)


def _report(result: SetParametersResult, done: str, failed: str) -> Exit:
    """Print whether a change succeeded; returns the exit code."""
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"{done}{reason}")
        return Exit.DONE
    print(f"{failed}{reason}", file=sys.stderr)
    return Exit.ERROR


async def _describe(options: argparse.Namespace, services: ParamServices) -> Exit:
    known = await services.names()
    for name in options.parameter_names:
        if name not in known:
            from srvgen.definitions.names import did_you_mean

            problem = f"Unknown parameter '{name}' of {options.node_name}"
            raise hinted(NotFound(problem), did_you_mean(name, known))
    for descriptor in await services.descriptors(options.parameter_names):
        print("\n".join(_described(descriptor)))
    return Exit.DONE


async def _delete(options: argparse.Namespace, services: ParamServices) -> Exit:
    import srvgen

    nothing = srvgen.load("rcl_interfaces/msg/ParameterValue")()
    result = (await services.set([_message(options.parameter_name, nothing)]))[0]
    return _report(result, "Deleted parameter successfully", "Deleting parameter failed")


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
    print(yaml.safe_dump(content, default_flow_style=False))
    return Exit.DONE


async def _load(options: argparse.Namespace, services: ParamServices) -> Exit:
    import yaml

    from .ros_values import parameter_dict_from_yaml_file

    try:
        found = parameter_dict_from_yaml_file(
            options.parameter_file,
            use_wildcard=not options.no_use_wildcard,
            target_nodes=[options.node_name],
        )
    except OSError as error:
        problem = f"cannot read {options.parameter_file}: {error.strerror or error}"
        raise TaskRpcError(problem) from None
    except UnicodeDecodeError:
        raise TaskRpcError(f"cannot read {options.parameter_file}: expected UTF-8 text") from None
    except yaml.YAMLError as error:
        problem = f"{options.parameter_file} is not valid YAML: {' '.join(str(error).split())}"
        raise TaskRpcError(problem) from None
    except RuntimeError as error:
        raise TaskRpcError(str(error)) from None
    results = await services.set(list(found.values()))
    codes = [
        _report(result, f"Set parameter {name} successful", f"Set parameter {name} failed")
        for name, result in zip(found, results, strict=True)
    ]
    return max(codes, default=Exit.DONE)


# Values


def _plain(value: ParameterValue) -> Any:
    from .ros_values import parameter_value_to_python

    found = parameter_value_to_python(value)
    return list(found) if hasattr(found, "tolist") or isinstance(found, tuple) else found


def _message(name: str, value: ParameterValue) -> Parameter:
    import srvgen

    return srvgen.load("rcl_interfaces/msg/Parameter")(name=name, value=value)


def _described(descriptor: ParameterDescriptor) -> list[str]:
    lines = [f"Parameter name: {descriptor.name}", f"  Type: {_NAMES[descriptor.type]}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    lines.append("  Constraints:")
    if descriptor.read_only:
        lines.append("    Read only: true")
    ranges: list[FloatingPointRange | IntegerRange]
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    for bounds in ranges[:1]:
        lines += [f"    Min value: {bounds.from_value}", f"    Max value: {bounds.to_value}"]
        if bounds.step:
            lines.append(f"    Step: {bounds.step}")
    if descriptor.additional_constraints:
        lines.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return lines
