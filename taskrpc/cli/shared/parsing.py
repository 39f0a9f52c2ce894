"""Command lines for argparse that behave like ros2cli: groups, help, usage."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Sequence

from srvgen.cli import process
from taskrpc.cli.shared.command import Exit, UsageError, hinted

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from typing import Any, NoReturn, TypeAlias

Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


class Parser(argparse.ArgumentParser):
    """An argument parser that raises UsageError where argparse would exit."""

    mixed = False
    """Whether options may stand between any two positional arguments."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parse the known arguments; the second value has the unknown ones."""
        if not self.mixed or "_ARGCOMPLETE" in os.environ:  # argcomplete needs the plain order
            return super().parse_known_args(args, namespace)
        # argparse mixes only in a separate method, which calls this one again.
        self.mixed = False
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self.mixed = True

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """End the command. Raises OSError if the help text cannot be written."""
        process.check_output()
        super().exit(status, message)

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with the usage, and a hint if the command is misspelt."""
        hint = ""
        if message.startswith("argument Call `"):
            from srvgen.definitions.names import did_you_mean  # only a mistake needs it

            message = "unknown command " + message.partition("invalid choice: ")[2]
            word, *known = re.findall(r"[\w-]+", message.removeprefix("unknown command "))
            hint = did_you_mean(word, known[2:])  # after "choose from"
        raise hinted(UsageError(f"{self.prog}: error: {message}", self.format_usage()), hint)


def add_group(parser: argparse.ArgumentParser) -> Commands:
    """Give a command subcommands; called without one, it prints its help, as ros2 does."""
    parser.set_defaults(run=lambda _: print_help(parser))
    more = f"Call `{parser.prog} <command> -h` for more detailed usage."
    return parser.add_subparsers(title="Commands", metavar=more, parser_class=Parser)


def add_command(commands: Commands, name: str, purpose: str) -> Parser:
    """Return a parser for one command of a group; the caller sets its `run` default."""
    return commands.add_parser(name, help=purpose, description=purpose)


def add_ignored(parser: argparse.ArgumentParser, *names: str, **settings: Any) -> None:
    """Accept an option of ROS that does nothing here; the help page does not show it."""
    parser.add_argument(*names, help=argparse.SUPPRESS, **settings)


def number(rule: str, allowed: Callable[[float], bool]) -> Callable[[str], float]:
    """Return the `type` of an option for a number; errors say "expected a number", then `rule`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or not allowed(value):
            raise argparse.ArgumentTypeError(f"expected a number {rule}, got {text!r}")
        return value

    return parse


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return the `type` of an option for a whole number."""
    rule = f"from {least} on" if most is None else f"from {least} to {most}"

    def parse(text: str) -> int:
        # Python refuses to read very long numbers.
        value = int(text) if text.isdecimal() and len(text) < 20 else -1
        if value < least or (most is not None and value > most):
            raise argparse.ArgumentTypeError(f"expected a whole number {rule}, got {text!r}")
        return value

    return parse


def add_lengths(parser: argparse.ArgumentParser, *, flow_style: str) -> None:
    """Add ros2's options that shorten messages; `flow_style` is the help of `--flow-style`."""
    what = "Output long texts and arrays in full"
    parser.add_argument("-f", "--full-length", action="store_true", help=what)
    what = "Maximum number of characters and elements to output (default: 128)"
    parser.add_argument(
        "-l", "--truncate-length", metavar="N", type=whole(0), default=128, help=what
    )
    what = "Do not output the contents of arrays"
    parser.add_argument("--no-arr", action="store_true", help=what)
    what = "Do not output the contents of texts"
    parser.add_argument("--no-str", action="store_true", help=what)
    parser.add_argument("--flow-style", action="store_true", help=flow_style)


def add_allow_origin(parser: argparse.ArgumentParser) -> None:
    """Give a command that serves WebSockets the option for pages of other servers."""
    what = "Also accept web pages from this server, such as http://lab.local:8000; null for files"
    add = parser.add_argument
    add("--allow-origin", metavar="ORIGIN", type=_origin, action="append", default=[], help=what)


def _origin(text: str) -> str:
    """Return a valid origin. Raises argparse's ArgumentTypeError."""
    if text != "null" and not re.fullmatch(r"https?://[^/?#@\s]+", text, re.IGNORECASE):
        problem = f"expected an origin such as http://lab.local:8000, got {text!r}"
        raise argparse.ArgumentTypeError(problem)
    return text


def print_help(parser: argparse.ArgumentParser) -> Exit:
    """Print a parser's help."""
    parser.print_help()
    return Exit.DONE


def print_names(names: Sequence[str], *, count: bool = False, as_json: bool = False) -> Exit:
    """Print names one a line, or their number, or a JSON array."""
    if count:
        print(len(names))
    elif as_json:
        import json

        print(json.dumps(names))
    else:
        for name in names:
            print(name)
    return Exit.DONE
