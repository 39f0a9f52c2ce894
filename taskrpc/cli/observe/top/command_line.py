"""`taskrpc top`: watch nodes, services, calls, the queue and the robot."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import number
from taskrpc.cli.shared.remote import add_connect, remote_of

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from rich.console import Console

    from taskrpc.cli.shared.remote import Remote
    from taskrpc.observe.top.model import View
    from taskrpc.observe.top.reading import Reader

_PERIODS = (0.2, 60.0)


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc top` its options."""
    least, most = _PERIODS
    period = number(f"from {least:g} to {most:g}", lambda value: least <= value <= most)
    what = f"Seconds between two readings, {least:g} to {most:g} (default: 1)"
    parser.add_argument("--period", metavar="S", type=period, default=1.0, help=what)
    what = "Measure for one period, print the result and end"
    parser.add_argument("--once", action="store_true", help=what)
    what = "Print one JSON object for each period"
    parser.add_argument("--json", action="store_true", help=what)
    what = "Show hidden nodes and services too"
    parser.add_argument("-a", "--all", action="store_true", help=what)
    add_connect(parser)
    parser.set_defaults(run=_run)


def _run(options: Namespace) -> Exit:
    import asyncio

    remote = remote_of(options)
    console = None
    if not options.once and not options.json and sys.stdout.isatty():
        from taskrpc.cli.observe.top.screen import open_console

        console = open_console()
    asyncio.run(_watch(options, remote, console))
    return Exit.DONE


async def _watch(options: Namespace, remote: Remote, console: Console | None) -> None:
    from taskrpc.observe.top.reading import Reader

    async with remote.node() as node:
        reader = Reader(node, address=remote.address, period=options.period, hidden=options.all)
        if console is None:
            await _print(options, reader, remote.address)
        else:
            from taskrpc.cli.observe.top.screen import show

            await show(console, reader.read, options.period)


async def _print(options: Namespace, reader: Reader, address: str) -> None:
    """Print a block of lines, or one line of JSON, after each period.

    Raises ServiceUnavailable for `--once` if the only program to watch does not answer.
    """
    import asyncio

    from taskrpc.errors import ServiceUnavailable

    loop = asyncio.get_running_loop()
    await reader.read()
    due = loop.time()
    while True:
        due = max(due + options.period, loop.time())
        await asyncio.sleep(due - loop.time())
        view = await reader.read()
        problems = [each.problem for each in reader.programs if each.statistics is None]
        if options.once and address and len(problems) == len(reader.programs):
            raise ServiceUnavailable(problems[0] or f"the program at {address} has no statistics")
        print(_as_json(view) if options.json else _as_text(view), flush=True)
        if options.once:
            return
        if not options.json:
            print(flush=True)


def _as_text(view: View) -> str:
    from taskrpc.cli.observe.top.picture import ASCII, UNICODE, picture, text_of

    signs = UNICODE
    try:
        "".join(UNICODE).encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        signs = ASCII
    return "\n".join(map(text_of, picture(view, signs=signs)))


def _as_json(view: View) -> str:
    import json

    return json.dumps(as_object(view))


def as_object(view: View) -> dict[str, object]:
    """Return a view as `--json` prints it: rates a second, durations in milliseconds."""
    from msgspec import to_builtins

    from taskrpc.errors import Code

    known = {code.value: code.name for code in Code}
    return {
        "time": view.time,
        "domain": view.domain,
        "window": round(view.seconds, 3),
        "services": [
            {
                "name": row.name,
                "nodes": list(row.nodes),
                "calls_per_second": row.per_second,
                "p50_ms": _milliseconds(row.p50),
                "p99_ms": _milliseconds(row.p99),
                "errors": row.errors,
                "codes": {known.get(code, str(code)): count for code, count in row.codes.items()},
                "running": row.running,
                "waiting": row.waiting,
            }
            for row in view.services
        ],
        "nodes": [to_builtins(row) for row in view.nodes],
        "task_servers": [{**_fields(row), "state": row.state} for row in view.task_servers],
    }


def _fields(row: Any) -> dict[str, Any]:
    from msgspec import structs

    found = structs.asdict(row)
    found["pose"] = None if row.pose is None else row.pose._asdict()
    found["tasks"] = [structs.asdict(task) for task in row.tasks]
    return found


def _milliseconds(value: float | None) -> float | None:
    return None if value is None else round(value * 1000, 4)
