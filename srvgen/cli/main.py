"""The `srvgen` command: generate, check, fix, describe, show, hash and stubs."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from . import process
from .arguments import Commands, Parser, add_command, root, with_sources, with_type

_GARBAGE = 100_000
"""The number of new objects before a garbage collection."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0 done, 1 an error, 2 wrong usage, 130 Ctrl-C."""
    if argv is not None:
        return _guarded(argv)
    process.begin()
    # A command is short: garbage collection would take a tenth of its time.
    gc.set_threshold(_GARBAGE)
    atexit.register(gc.freeze)
    try:
        code = _guarded(sys.argv[1:])
    except KeyboardInterrupt:  # a second Ctrl-C, while a message was printed
        code = process.INTERRUPTED
    return process.end(code)


def _guarded(argv: Sequence[str]) -> int:
    """Run the command; failing output gives one message, or none for a closed pipe."""
    try:
        code = _run(argv)
        process.check_output()
    except KeyboardInterrupt:
        return process.INTERRUPTED
    except OSError as error:
        failure = process.output_failure()
        if failure is None:
            raise
        if isinstance(error, BrokenPipeError):
            return 0  # the reader of the output stopped early
        print(f"cannot write to standard output: {failure.strerror}", file=sys.stderr)
        return 1
    return code


def _run(argv: Sequence[str]) -> int:
    parser = _parser()
    if "_ARGCOMPLETE" in os.environ:
        from .completion import complete, interfaces

        complete(parser, {"type": interfaces, "sources": interfaces, "names": interfaces})
    options = parser.parse_args(argv)
    if "run" not in options:
        parser.print_help(sys.stderr)
        return 2
    # Not at the top: `--help` does not need these modules.
    from ..errors import DefinitionError
    from . import commands
    from .report import Report

    _print_notes()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # The code page of a Windows pipe may not have all characters of comments.
        sys.stdout.reconfigure(errors="backslashreplace")
    report = Report(as_json=getattr(options, "json", False))
    process.start_work()
    try:
        getattr(commands, options.run)(options, report)
    except DefinitionError as error:
        report.error(error)
    sys.stdout.flush()
    report.finish()
    return report.exit_code


def _parser() -> Parser:
    parser, commands = root()
    _add_generate(commands)
    check = with_sources(commands, "check", "Report every problem in definitions", default=".")
    check.add_argument("--json", action="store_true", help="One JSON line per problem")
    check.set_defaults(run="check")
    correct = "Correct mistakes with one possible correction, and report the others"
    fix = with_sources(commands, "fix", correct)
    fix.add_argument(
        "--dry-run", action="store_true", help="Write nothing; print what would change as a diff"
    )
    fix.set_defaults(run="fix")
    describe = with_sources(commands, "describe", "Print definitions as JSON")
    describe.add_argument("--json", action="store_true", help="One line per interface")
    describe.set_defaults(run="print_descriptions")
    _add_show(commands)
    digest = with_type(commands, "hash", "Print the RIHS01 hash of a type")
    digest.add_argument("--json", action="store_true", help="As a JSON object")
    digest.set_defaults(run="print_hash")
    _add_stubs(commands)
    return parser


def _add_generate(commands: Commands) -> None:
    command = with_sources(commands, "generate", "Write importable Python packages")
    command.add_argument(
        "-o", dest="out", metavar="OUT", type=Path, required=True, help="The folder to write to"
    )
    command.add_argument(
        "--check", action="store_true", help="Write nothing; exit 1 if the output would differ"
    )
    command.set_defaults(run="write_packages")


def _add_show(commands: Commands) -> None:
    command = with_type(commands, "show", "Print a definition with its nested definitions")
    which = command.add_mutually_exclusive_group()
    which.add_argument(
        "--all-comments", action="store_true", help="Show the comments of nested definitions too"
    )
    which.add_argument("--no-comments", action="store_true", help="Show no comments")
    command.set_defaults(run="print_definition")


_STUBS = """\
Write stubs (.pyi), so that editors and type checkers know the classes and fields that the import
hook and srvgen.load provide"""
_STUBS_NOTES = """\
Pyright and Pylance find ./typings; for mypy, set mypy_path = "typings". The stubs also type
srvgen.load("my_msgs/srv/Fetch") if the name is a literal. Run the command again after a change of
a definition. Pyright may report reportMissingModuleSource (a stub without a source): these packages
have no Python files, so you can turn that warning off."""


def _add_stubs(commands: Commands) -> None:
    command = add_command(commands, "stubs", "Write stubs for editors and type checkers")
    command.description, command.epilog = _STUBS, _STUBS_NOTES
    command.add_argument(
        "names",
        metavar="TYPE|PACKAGE",
        nargs="*",
        help="Write stubs for these and their dependencies (default: all packages found)",
    )
    command.add_argument(
        "-o",
        dest="out",
        metavar="DIR",
        type=Path,
        default=Path("typings"),
        help="The folder to write to (default: typings)",
    )
    command.set_defaults(run="write_stubs")


def _print_notes() -> None:
    """Print log records of the library on stderr, one line each."""
    import logging

    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("note: %(message)s"))
    logger = logging.getLogger("srvgen")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False
