"""`taskrpc demo`: shows the lecture's system in one process, in memory, in twelve seconds."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import number

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from rich.console import Console

    from taskrpc.cli.robot.demo.story import Line

_SPEEDS = (0.5, 20.0)  # below: dull; above: the robot drives too far in a millisecond

_READING = 1.8
"""How many times slower than the other demo the story of a fleet is told: it has more lines."""

_NEXT = """
Next, in two terminals:
  taskrpc-server
  taskrpc-call /robot_task task_type=move target=warehouse priority=8"""


_NEXT_FLEET = """
Next, with a PostgreSQL, in a terminal for each robot:
  taskrpc-server --db postgresql://USER@HOST/DATABASE --robot-name robot_1"""


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc demo` its options."""
    least, most = _SPEEDS
    speed = number(f"from {least:g} to {most:g}", lambda value: least <= value <= most)
    what = f"Simulated seconds per second, {least:g} to {most:g} (default: 4.5)"
    parser.add_argument("--speed", metavar="X", type=speed, default=4.5, help=what)
    what = "Print lines instead of drawing a picture"
    parser.add_argument("--plain", action="store_true", help=what)
    what = "Show three robots that share one queue, also when a server is lost"
    parser.add_argument("--fleet", action="store_true", help=what)
    parser.set_defaults(run=run)


def run(options: Namespace) -> Exit:
    """Perform the demo; returns ERROR if an estimate was wrong."""
    import asyncio

    if options.fleet:
        return _show_fleet(options.speed)

    from taskrpc.cli.robot.demo.estimates import are_right, check_estimates, summary

    console = None if options.plain else _terminal()
    tasks = asyncio.run(_perform(options.speed, console))
    rows = check_estimates(tasks, options.speed)
    print("\n".join(["", *summary(rows), _NEXT]))
    return Exit.DONE if are_right(rows) else Exit.ERROR


def _show_fleet(speed: float) -> Exit:
    """Tell the story of a fleet; returns ERROR if a task was lost or ran twice."""
    import time

    from taskrpc.cli.robot.demo.fleet_story import is_right, perform, summary

    performance = perform()  # on virtual time; only the telling takes time
    began = time.monotonic()
    for line in performance.lines:
        at = line.at / speed * _READING
        time.sleep(max(0.0, at - (time.monotonic() - began)))
        _print(line)
    print("\n".join(["", *summary(performance), _NEXT_FLEET]))
    return Exit.DONE if is_right(performance) else Exit.ERROR


async def _perform(speed: float, console: Console | None) -> list[Any]:
    from taskrpc.cli.robot.demo.story import open_stage, perform

    if console is None:
        async with open_stage(speed=speed, on_line=_print) as stage:
            return await perform(stage)
    from taskrpc.cli.robot.demo.screen import Picture

    async with open_stage(speed=speed) as stage:
        with Picture(console, stage).shown():
            return await perform(stage)


def _terminal() -> Console | None:
    """Return the terminal on stdout; None if there is none, or it is too small for a picture."""
    if not sys.stdout.isatty():
        return None
    from rich.console import Console

    from taskrpc.cli.robot.demo.screen import SMALLEST

    console = Console()
    is_able = console.is_terminal and not console.is_dumb_terminal
    is_large = console.width >= SMALLEST[0] and console.height >= SMALLEST[1]
    return console if is_able and is_large else None


def _print(line: Line) -> None:
    print(f"{line.at:5.1f} s  {line.actor:<9}  {line.text}", flush=True)
