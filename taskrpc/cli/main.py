"""The `taskrpc` command: imports the module of the command that is used, and runs it.

The module of a command, which `_MODULES` names, has a function

    def configure(parser: argparse.ArgumentParser) -> None

that adds the arguments of the command to the parser and ends with `parser.set_defaults(run=...)`.
The `run` function gets the parsed options and returns the exit code. A command with subcommands
uses `parsing.add_group` and `parsing.add_command`. A command reports a mistake of the user by
raising a TaskRpcError, DefinitionError or OSError: `command.guarded` prints it as one message
(one line of JSON with `--json`) and chooses the exit code.

Other packages add commands as entry points of the group `taskrpc.commands`. The value of an entry
point is the name of such a module, and the first line of its docstring is the command's purpose.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module

from srvgen.cli import process
from taskrpc.cli.shared.command import UsageError, run_main

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from argparse import Namespace
    from types import ModuleType
    from typing import NoReturn

    from taskrpc.cli.shared.parsing import Parser

_GROUPS = {
    "Commands": {
        "service": "Call services, list them and watch their calls",
        "action": "Send goals to actions, list them and watch them",
        "topic": "Read topics, publish on them and measure them",
        "interface": "Show the definitions of messages and services",
        "node": "List nodes and what they offer",
        "task": "Submit tasks to the robot and watch them",
        "view": "Open the live page of the task server, or a recording, in the browser",
        "bag": "Record topics and calls, and play them again",
        "run": "Run a ROS 2 program without ROS",
        "launch": "Run a launch file, which starts several programs together",
        "bridge": "Connect browsers and programs that do not use taskrpc",
        "door": "Check a policy: what browsers and agents may do",
        "router": "Run a router of Zenoh for programs that use this transport",
        "demo": "Watch a task server, three clients and a robot at work",
        "top": "Watch nodes, services, calls, the queue and the robot live",
        "doctor": "Find out why something does not work",
        "simulate": "Run your programs many times with faults, until they break",
        "ps": "List your taskrpc processes on this machine",
        "stop": "End your taskrpc processes on this machine",
    },
    "Your shell and your Python": {
        "shell": "Make a shell accept `ros2` lines, with completion",
        "ros": "Make `import rclpy` work in plain python, an editor or a notebook",
    },
    "Classes": {
        "classroom": "Let the laptops of a class call the robot of this machine",
        "join": "Call the robot of a lab from this laptop",
        "lab": "Do an exercise of the course, and check it",
        "scene": "Show a typical mistake, why it happens, and the cure",
    },
    "ROS packages": {
        "param": "Read and set the parameters of nodes",
        "lifecycle": "Read and change the states of lifecycle nodes",
        "pkg": "Create and find packages",
        "colcon": "Check a workspace without a build; accept `colcon build` lines",
        "daemon": "Accept `ros2 daemon` lines; taskrpc needs no daemon",
        "export": "Take programs and definitions to a real robot",
        "graduate": "List what a program would do differently on a real robot",
    },
}
"""The commands and their purposes, under the headings of `taskrpc --help`."""

COMMANDS = {name: purpose for group in _GROUPS.values() for name, purpose in group.items()}
"""The commands of `taskrpc --help` and their purposes."""

_ELSEWHERE = {
    "component": "start each node with its own taskrpc run",
    "control": "there is no controller manager",
    "multicast": "programs find each other without multicast; taskrpc doctor tests the connection",
    "security": "see taskrpc classroom, and taskrpc-server --tls-cert and --token-file",
    "wtf": "its other name is taskrpc doctor",
}
"""Commands of ros2 that taskrpc does not have, and what to do instead."""

ENTRY_POINTS = "taskrpc.commands"
"""The group of entry points in which other packages list their commands."""

_MODULES = {
    "action": "taskrpc.cli.ros.action.command_line",
    "bag": "taskrpc.cli.ros.bag.command_line",
    "daemon": "taskrpc.cli.ros.daemon",
    "doctor": "taskrpc.cli.ros.doctor.command_line",
    "interface": "taskrpc.cli.ros.interface",
    "launch": "taskrpc.cli.ros.launch",
    "lifecycle": "taskrpc.cli.ros.lifecycle.command_line",
    "node": "taskrpc.cli.ros.node",
    "param": "taskrpc.cli.ros.param.command_line",
    "pkg": "taskrpc.cli.ros.pkg.command_line",
    "run": "taskrpc.cli.ros.run",
    "service": "taskrpc.cli.ros.service.command_line",
    "topic": "taskrpc.cli.ros.topic.command_line",
    "demo": "taskrpc.cli.robot.demo.command_line",
    "task": "taskrpc.cli.robot.task.command_line",
    "top": "taskrpc.cli.observe.top.command_line",
    "view": "taskrpc.cli.observe.view.command_line",
    "classroom": "taskrpc.cli.course.classroom.command_line",
    "join": "taskrpc.cli.course.join",
    "lab": "taskrpc.cli.course.lab.command_line",
    "scene": "taskrpc.cli.course.scene.command_line",
    "bridge": "taskrpc.cli.network.bridge.command_line",
    "door": "taskrpc.cli.network.door",
    "ps": "taskrpc.cli.network.ps",
    "router": "taskrpc.cli.network.router.command_line",
    "stop": "taskrpc.cli.network.stop",
    "colcon": "taskrpc.cli.workspace.colcon",
    "export": "taskrpc.cli.workspace.export",
    "graduate": "taskrpc.cli.workspace.graduate",
    "ros": "taskrpc.cli.workspace.ros",
    "shell": "taskrpc.cli.workspace.shell",
    "simulate": "taskrpc.cli.workspace.simulate",
}
"""The module of each command; a command of several modules has a folder."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_main(_run, argv)


def _run(arguments: list[str]) -> int:
    if "_ARGCOMPLETE" in os.environ:
        _complete()
    command = next((each for each in arguments if not each.startswith("-")), "")
    if command in _ELSEWHERE:
        raise UsageError(f"taskrpc has no command '{command}': {_ELSEWHERE[command]}")
    parser = parser_of(command)
    options: Namespace = parser.parse_args(arguments)
    if options.version:
        return _print_version()
    if command and options.run is parser.get_default("run"):
        from taskrpc.errors import TaskRpcError

        raise TaskRpcError(
            f"the package that adds the command '{command}' sets no function that runs it: its"
            " configure must call parser.set_defaults(run=...)"
        )
    process.start_work()
    return int(options.run(options) or 0)  # a command of another package may return None


def _complete() -> NoReturn:
    from srvgen.cli.completion import words_before
    from taskrpc.cli.completion import complete

    complete(parser_of(next((word for word in words_before() if not word.startswith("-")), "")))


def parser_of(command: str) -> Parser:
    """The parser, with the arguments of the one command that is used."""
    from argparse import SUPPRESS, RawDescriptionHelpFormatter

    from taskrpc.cli.shared.parsing import Parser, add_command, add_group

    parser = Parser(prog="taskrpc", description="ROS 2 services without ROS")
    parser.formatter_class = RawDescriptionHelpFormatter
    added = {} if command in COMMANDS else _added_commands(command)
    parser.epilog = _overview(added)
    parser.add_argument("--version", action="store_true", help="Print the version and exit")
    commands = add_group(parser)
    commands.help = SUPPRESS  # argparse would list all commands under one heading
    parser.usage = "taskrpc [-h] [--version] COMMAND ..."  # after the group, which takes it over
    for name, purpose in COMMANDS.items():
        own = add_command(commands, name, purpose)
        if name == command:
            import_module(_MODULES[name]).configure(own)
    for name, module in added.items():
        own = add_command(commands, name, _purpose(module))
        if name == command:
            module.configure(own)
    return parser


def _added_commands(command: str) -> dict[str, ModuleType]:
    """Return the module of this command if another package adds it, else those of all packages.

    A broken package must not take the commands of taskrpc with it: its command is left out, with
    a line on stderr.
    """
    from importlib.metadata import entry_points

    found: dict[str, ModuleType] = {}
    points = entry_points(group=ENTRY_POINTS)
    for each in sorted(points.select(name=command) or points):
        if each.name in COMMANDS:
            continue
        try:
            if ":" in each.value:
                raise TypeError("expected the name of a module only, without a colon")
            module = import_module(each.value)
            if not callable(getattr(module, "configure", None)):
                raise AttributeError("the module has no function configure(parser)")
        except Exception as error:
            package = each.dist.name if each.dist else each.value
            problem = f"{type(error).__name__}: {error}"
            print(
                f"taskrpc: the package {package} adds the command {each.name!r} with the module"
                f" {each.value}, which cannot be used: {problem}",
                file=sys.stderr,
            )
        else:
            found[each.name] = module
    return found


def _purpose(module: ModuleType) -> str:
    return (module.__doc__ or "").strip().partition("\n")[0].rstrip(".")


def _overview(added: dict[str, ModuleType]) -> str:
    lines = []
    groups = dict(_GROUPS)
    if added:
        groups["Of other packages"] = {name: _purpose(each) for name, each in added.items()}
    for heading, group in groups.items():
        lines.append(f"{heading}:")
        lines += [f"  {name:<10} {purpose}" for name, purpose in group.items()]
        lines.append("")
    lines += [
        "Call `taskrpc COMMAND -h` for more detailed usage.",
    ]
    return "\n".join(lines)


def _print_version() -> int:
    from importlib.metadata import version

    print(f"taskrpc {version('taskrpc')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
