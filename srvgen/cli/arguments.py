"""The argument parser of `srvgen`, and arguments that several commands share."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from . import process

Commands: TypeAlias = "argparse._SubParsersAction[Parser]"

SOURCE = """\
A definition file, a package folder, a folder of packages, or the name of a type or
package that can be found"""


class Parser(argparse.ArgumentParser):
    """An argument parser that suggests a command for a misspelt one."""

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Exit; raises OSError if the help text could not be written."""
        process.check_output()
        super().exit(status, message)

    def error(self, message: str) -> NoReturn:
        """Print usage and message, with a hint, and exit with 2."""
        found = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if found:
            from ..definitions.names import did_you_mean  # only errors need it

            known = re.findall(r"[\w-]+", found[2])
            hint = did_you_mean(found[1], known) or f"choose from {', '.join(known)}"
            message = f"unknown command {found[1]!r}; {hint}"
        super().error(message)


def root() -> tuple[Parser, Commands]:
    """The parser of `srvgen`, and the object to which commands are added."""
    parser = Parser(prog="srvgen", description="ROS 2 interface definitions in Python, without ROS")
    what = "Print the version and exit"
    parser.add_argument("--version", action=_Version, nargs=0, help=what)
    return parser, parser.add_subparsers(title="commands", metavar="COMMAND")


def add_command(commands: Commands, name: str, purpose: str) -> Parser:
    """Add the parser of one command."""
    command: Parser = commands.add_parser(name, help=purpose, description=purpose)
    command.add_argument(
        "-I",
        dest="include",
        metavar="PATH",
        type=_folder,
        action="append",
        default=[],
        help="Search this folder for packages first (may be repeated)",
    )
    return command


def with_sources(commands: Commands, name: str, purpose: str, *, default: str = "") -> Parser:
    """Add a command that works on any number of sources, by default on `default`."""
    command = add_command(commands, name, purpose)
    command.add_argument(
        "sources",
        metavar="SRC",
        nargs="*" if default else "+",
        default=[default],
        help=SOURCE + (" (default: the current folder)" if default else ""),
    )
    return command


def with_type(commands: Commands, name: str, purpose: str) -> Parser:
    """Add a command that works on one type."""
    command = add_command(commands, name, purpose)
    command.add_argument(
        "type",
        metavar="TYPE",
        help="A type, such as example_interfaces/srv/AddTwoInts, or its file",
    )
    return command


def _folder(text: str) -> Path:
    path = Path(text)
    if not path.is_dir():
        came = "a file" if path.exists() else "a path that does not exist"
        raise argparse.ArgumentTypeError(f"expected a folder, got {came}: {text}")
    return path


class _Version(argparse.Action):
    """Prints the version. An action of its own, because finding the version is slow."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        try:
            found = version("taskrpc")
        except PackageNotFoundError:
            found = "(not installed)"
        print(f"srvgen {found}")
        parser.exit()
