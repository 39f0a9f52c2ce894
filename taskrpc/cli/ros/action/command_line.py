"""`taskrpc action`: echo, find, info, list, send_goal and type, as in `ros2 action`."""

from __future__ import annotations

import argparse
import math

from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted, standard_input
from taskrpc.cli.shared.parsing import Commands, Parser, add_command, add_group, print_names

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from taskrpc.cli.ros.action.action_graph import Action

_TIMEOUT = 10.0
_NAME = "Name of the action (e.g. '/fibonacci')"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about actions."""
    commands = add_group(parser)
    _add_echo(commands)
    _add_find(commands)
    _add_info(commands)
    _add_list(commands)
    _add_send_goal(commands)
    _add_type(commands)


def _add_echo(commands: Commands) -> None:
    from taskrpc.cli.shared.parsing import add_lengths

    parser = add_command(commands, "echo", "Print the messages of an action")
    parser.add_argument("action_name", help=_NAME)
    what = "Type of the action (e.g. 'example_interfaces/action/Fibonacci')"
    parser.add_argument("action_type", nargs="?", default="", help=what)
    what = (
        "Parts of the action to output, separated by |: GOAL_SERVICE, CANCEL_SERVICE,"
        " RESULT_SERVICE, FEEDBACK_TOPIC, STATUS_TOPIC (default: all)"
    )
    parser.add_argument("-i", "--interfaces", metavar="NAMES", help=what)
    what = "Output all values separated by commas (e.g. for plotting)"
    parser.add_argument("--csv", action="store_true", help=what)
    add_lengths(parser, flow_style="Output each array in one line")
    _add_remote(parser)
    parser.set_defaults(run=_echo)


def _add_find(commands: Commands) -> None:
    parser = add_command(commands, "find", "Output a list of available actions of a given type")
    what = "Name of the action type to filter for (e.g. 'example_interfaces/action/Fibonacci')"
    parser.add_argument("action_type", help=what)
    _add_list_options(parser)
    parser.set_defaults(run=_find)


def _add_info(commands: Commands) -> None:
    parser = add_command(commands, "info", "Print information about an action")
    parser.add_argument("action_name", help=_NAME)
    what = "Additionally show the action type"
    parser.add_argument("-t", "--show-types", action="store_true", help=what)
    what = "Only display the number of action clients and action servers"
    parser.add_argument("-c", "--count", action="store_true", help=what)
    _add_json(parser)
    parser.set_defaults(run=_info)


def _add_list(commands: Commands) -> None:
    parser = add_command(commands, "list", "Output a list of available actions")
    what = "Additionally show the action type"
    parser.add_argument("-t", "--show-types", action="store_true", help=what)
    _add_list_options(parser)
    parser.set_defaults(run=_list)


def _add_type(commands: Commands) -> None:
    parser = add_command(commands, "type", "Output an action's type")
    parser.add_argument("action_name", help=_NAME)
    _add_json(parser)
    parser.set_defaults(run=_type)


def _add_send_goal(commands: Commands) -> None:
    parser = add_command(commands, "send_goal", "Send a goal and wait for its result")
    assert isinstance(parser, Parser)
    parser.mixed = True
    parser.add_argument("action_name", help=_NAME)
    what = (
        "Type of the action (e.g. 'example_interfaces/action/Fibonacci'; optional, because the"
        ' server reports it), then values of the goal, in YAML format (e.g. "{order: 10}") or as'
        " FIELD=VALUE; other fields keep their defaults"
    )
    parser.add_argument("goal", nargs="*", default=[], metavar="TYPE, VALUES", help=what)
    parser.usage = "%(prog)s [options] action_name [TYPE] [YAML | FIELD=VALUE ...]"
    parser.add_argument("--stdin", action="store_true", help="Read the goal from standard input")
    what = "Print the feedback of the goal"
    parser.add_argument("-f", "--feedback", action="store_true", help=what)
    what = (
        "How many seconds to wait until the server accepts or rejects the goal"
        f"; 0 or inf: no limit (default: {_TIMEOUT:g})"
    )
    parser.add_argument("--timeout", metavar="S", type=_time_limit, default=_TIMEOUT, help=what)
    what = "Print the feedback and the result as one line of JSON each"
    parser.add_argument("--json", action="store_true", help=what)
    _add_remote(parser)
    parser.set_defaults(run=_send_goal)


def _add_list_options(parser: argparse.ArgumentParser) -> None:
    what = "Only display the number of actions discovered"
    parser.add_argument("-c", "--count-actions", "--count", action="store_true", help=what)
    _add_json(parser)


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="Print JSON")
    _add_remote(parser)


def _add_remote(parser: argparse.ArgumentParser) -> None:
    from taskrpc.cli.shared.remote import add_connect, add_discovery

    add_connect(parser)
    add_discovery(parser)


def _echo(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.action import echo

    return echo.echo(options)


def _send_goal(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.action import send_goal
    from taskrpc.cli.shared import values
    from taskrpc.cli.shared.remote import remote_of

    type_name, given = values.split_type(options.goal)
    if options.stdin:
        if given:
            raise UsageError("--stdin: expected no goal on the command line, got one")
        given = [standard_input()]
    plan = send_goal.Plan(
        options.action_name,
        type_name,
        tuple(given),
        timeout=options.timeout,
        shows_feedback=options.feedback,
        as_json=options.json,
        remote=remote_of(options),
    )
    return send_goal.run(plan)


def _list(options: argparse.Namespace) -> int:
    found = _look(options)
    if options.count_actions:
        print(len(found))
    elif options.json:
        import json

        print(json.dumps([{"name": name, "types": each.types} for name, each in found.items()]))
    else:
        for name, action in found.items():
            print(f"{name} [{', '.join(action.types)}]" if options.show_types else name)
    return Exit.DONE


def _find(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.action.action_graph import action_type_name

    wanted = action_type_name(options.action_type)
    matching = [name for name, action in _look(options).items() if wanted in action.types]
    return print_names(matching, count=options.count_actions, as_json=options.json)


def _type(options: argparse.Namespace) -> int:
    from srvgen.definitions.names import did_you_mean
    from taskrpc.cli.shared import quoting

    name, found = quoting.expanded(options.action_name, kind="action name"), _look(options)
    if name not in found:
        raise hinted(NotFound(f"Unknown action '{name}'"), did_you_mean(name, found))
    return print_names(found[name].types, as_json=options.json)


def _info(options: argparse.Namespace) -> int:
    from taskrpc.cli.ros.action.action_graph import Action
    from taskrpc.cli.shared import quoting

    name = quoting.expanded(options.action_name, kind="action name")
    action = _look(options).get(name, Action())
    if options.json:
        import json

        sides = {"clients": action.clients, "servers": action.servers}
        print(json.dumps({"name": name, "types": action.types, **sides}))
        return Exit.DONE
    print(f"Action: {options.action_name}")
    for kind, nodes in ("clients", action.clients), ("servers", action.servers):
        print(f"Action {kind}: {len(nodes)}")
        for node, type_name in () if options.count else nodes.items():
            print(f"    {node} [{type_name}]" if options.show_types else f"    {node}")
    return Exit.DONE


def _look(options: argparse.Namespace) -> dict[str, Action]:
    from taskrpc.cli.ros.action.action_graph import actions
    from taskrpc.cli.shared import graph
    from taskrpc.cli.shared.remote import remote_of

    return actions(graph.look(remote_of(options)))


def _time_limit(text: str) -> float | None:
    """Return a timeout in seconds, or None (no limit, as in ros2) for 0 and `inf`."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0:  # also true for NaN
        expected = "seconds, or 0 or inf for no limit"
        raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
    return seconds if 0 < seconds < math.inf else None
