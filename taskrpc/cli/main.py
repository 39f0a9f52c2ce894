"""The `taskrpc` command: hands each command to the module of its name, imported only then.

Such a module, `taskrpc.cli.NAME`, has a function

    def configure(parser: argparse.ArgumentParser) -> None

which gives the parser its arguments and ends with `parser.set_defaults(run=...)`. The function set
there takes the parsed options and returns the exit code; `parsing.add_group` and
`parsing.add_command` do this for a command that has commands of its own. A mistake of the user's
is raised: `command.guarded` prints any TaskRpcError, DefinitionError or OSError as one message
(one line of JSON where `--json` was given) and knows its exit code.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from srvgen.cli import process
from taskrpc.cli.shared.command import UsageError, run_main

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from argparse import Namespace

    from taskrpc.cli.shared.parsing import Parser

_PURPOSES = {
    "service": "Various service related sub-commands",
    "topic": "Various topic related sub-commands",
    "interface": "Show information about interfaces",
    "node": "Various node related sub-commands",
    "param": "Various param related sub-commands",
    "pkg": "Various package related sub-commands",
    "daemon": "Answer as ros2 does about its daemon",
    "colcon": "Answer as colcon does: packages run here without a build",
    "task": "Submit tasks to the task server and watch them",
    "alias": "Let a shell know ros2",
    "ps": "List the taskrpc processes of this user",
    "stop": "End taskrpc processes of this user",
    "doctor": "Find out why something does not work",
    "classroom": "Let the laptops of a class call the robot here",
    "join": "Let programs of this user call a lab's server",
    "leave": "Forget the lab that was joined",
    "run": "Run a ROS 2 program without ROS",
    "graduate": "Find what a program would do differently on a real robot",
    "export": "Take programs and definitions to a real robot",
    "ros": "Let plain python import rclpy",
    "demo": "Watch a task server, three clients and a robot at work",
}

_NOT_HERE = {
    "launch": "start each program by a taskrpc run of its own",
    "action": "there are no actions yet; services and topics are there",
    "bag": "nothing is recorded; taskrpc topic echo --csv prints to a file",
    "lifecycle": "call a node's services, as /NODE/change_state, with taskrpc service call",
    "component": "start each node by a taskrpc run of its own",
    "control": "there is no controller manager",
    "multicast": "programs find each other without multicast; ask taskrpc doctor",
    "security": "see taskrpc classroom, and taskrpc-server --tls-cert and --token-file",
    "wtf": "its other name is taskrpc doctor",
}
"""Commands of ros2 that are not among ours, and what to do instead."""

_IN_FOLDERS = frozenset("classroom demo doctor param pkg service task topic".split())
"""Commands of several modules: a folder, in which `command_line` is read first."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_main(_run, argv)


def _run(arguments: list[str]) -> int:
    command = next((each for each in arguments if not each.startswith("-")), "")
    if command in _NOT_HERE:
        raise UsageError(f"taskrpc has no command '{command}': {_NOT_HERE[command]}")
    options: Namespace = parser_of(command).parse_args(arguments)
    if options.version:
        return _print_version()
    process.start_work()
    return int(options.run(options))


def parser_of(command: str) -> Parser:
    """The parser, with the arguments of the one command that is used."""
    from taskrpc.cli.shared.parsing import Parser, add_command, add_group

    parser = Parser(prog="taskrpc", description="ROS 2 services without ROS.")
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = add_group(parser)
    for name, purpose in _PURPOSES.items():
        own = add_command(commands, name, purpose)
        if name == command:
            home = f"{name}.command_line" if name in _IN_FOLDERS else name
            import_module(f"taskrpc.cli.{home}").configure(own)
    return parser


def _print_version() -> int:
    from importlib.metadata import version

    print(f"taskrpc {version('taskrpc')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
