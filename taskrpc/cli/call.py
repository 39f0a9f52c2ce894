"""`taskrpc-call` and `taskrpc service call`: call a service from a command line."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence

from srvgen.cli import process
from taskrpc.cli.shared.command import Exit, UsageError, run_main, standard_input

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    import argparse

_DEFAULT_TIMEOUT = 10.0
_EPILOG = """\
both lines make the same call; the first needs no quotes in any shell:
  %(prog)s /robot_task task_type=move target=3,4 priority=8
  %(prog)s /robot_task "{task_type: move, target: '3,4', priority: 8}"
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `taskrpc-call` and return its exit code."""
    return run_main(_run, argv)


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of a call."""
    from argparse import RawDescriptionHelpFormatter

    from taskrpc.cli.shared.parsing import Parser

    assert isinstance(parser, Parser)
    parser.mixed = True
    parser.description = "Call a service"
    parser.epilog = _EPILOG
    parser.formatter_class = RawDescriptionHelpFormatter
    _add_positional(parser)
    _add_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Make the calls that the options describe; returns the exit code."""
    from taskrpc.cli.shared import values

    type_name, request = values.split_type(options.request)
    if options.stdin:
        if request:
            raise UsageError("--stdin: expected no request on the command line, got one")
        request = [standard_input()]
    import asyncio

    from taskrpc.cli.shared.calling import Plan, perform
    from taskrpc.cli.shared.remote import remote_of

    plan = Plan(
        options.service_name,
        type_name,
        tuple(request),
        timeout=options.timeout,
        retries=options.retries,
        request_id=_request_id(options),
        rate=options.rate,
        count=options.count or (0 if options.rate else 1),
        as_json=options.json,
        remote=remote_of(options),
    )
    asyncio.run(perform(plan))
    return Exit.DONE


def _request_id(options: argparse.Namespace) -> str:
    given: str = options.request_id
    if given and (options.rate or options.count > 1):
        raise UsageError("--request-id: an id names one call; got --rate or --count")
    return given


def _run(arguments: list[str]) -> int:
    from taskrpc.cli.shared.parsing import Parser

    parser = Parser(prog="taskrpc-call")
    configure(parser)
    if "_ARGCOMPLETE" in os.environ:
        from taskrpc.cli.completion import complete

        complete(parser)
    options = parser.parse_args(arguments)
    process.start_work()
    return run(options)


def _add_positional(parser: argparse.ArgumentParser) -> None:
    what = "Name of the service to call to (e.g. '/add_two_ints')"
    parser.add_argument("service_name", help=what)
    what = (
        "Type of the service (e.g. 'std_srvs/srv/Empty'; optional, because the server reports it),"
        ' then values to fill the request with, in YAML format (e.g. "{a: 1, b: 2}") or as'
        " FIELD=VALUE; without values the request has its defaults"
    )
    parser.add_argument("request", nargs="*", default=[], metavar="TYPE, VALUES", help=what)
    parser.usage = "%(prog)s [options] service_name [TYPE] [YAML | FIELD=VALUE ...]"


def _add_options(parser: argparse.ArgumentParser) -> None:
    from taskrpc.cli.shared.parsing import number, whole
    from taskrpc.cli.shared.remote import add_connect

    add = parser.add_argument
    add("--stdin", action="store_true", help="Read values from standard input")
    positive = number("greater than zero", lambda value: value > 0)
    what = "Repeat the call at a specific rate in Hz"
    add("-r", "--rate", metavar="N", type=positive, help=what)
    what = "Call this many times (default: once; with --rate until interrupted)"
    add("--count", metavar="N", type=whole(1), default=0, help=what)
    what = f"Seconds for waiting and the call; 0 or inf: no limit (default: {_DEFAULT_TIMEOUT:g})"
    add("--timeout", metavar="S", type=_time_limit, default=_DEFAULT_TIMEOUT, help=what)
    what = "Repeat a failed call up to N times, if repeating is safe (default: 0)"
    add("--retries", metavar="N", type=whole(0), default=0, help=what)
    what = (
        "The id of this request; repeating a request with the same id returns the stored response,"
        " also from another program (exactly-once services)"
    )
    add("--request-id", metavar="ID", default="", help=what)
    what = "Print each response as one line of JSON (NaN and infinity as null)"
    add("--json", action="store_true", help=what)
    add_connect(parser)


def _time_limit(text: str) -> float | None:
    """Return a timeout in seconds, or None (no limit, as in ros2) for 0 and `inf`."""
    from argparse import ArgumentTypeError

    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0:  # also true for NaN
        expected = "seconds, or 0 or inf for no limit"
        raise ArgumentTypeError(f"expected {expected}, got {text!r}")
    return seconds if 0 < seconds < math.inf else None


if __name__ == "__main__":
    sys.exit(main())
