"""`taskrpc ps`: lists the running taskrpc programs of this user, and their services."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from taskrpc.cli.robot.task.view import aligned
from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.processes import Process, clock_time, processes
from taskrpc.spi import process_state

_HEADINGS = ("PID", "SINCE", "DOMAIN", "SCRIPT", "FOLDER", "SERVICES")


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `ps`."""
    parser.add_argument("--json", action="store_true", help="Print a JSON array")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    found = processes()
    if options.json:
        print(json.dumps([_facts(process) for process in found]))
    else:
        print(*aligned([_HEADINGS, *map(_row, found)]), sep="\n")
    return Exit.DONE


def _facts(process: Process) -> dict[str, object]:
    return {
        "pid": process.pid,
        "script": process.script,
        "folder": process.folder,
        "services": process.services,
        "state": _state(process),
        "since": process.since,
        "domain": process.domain,
    }


def _row(process: Process) -> Sequence[str]:
    return (
        str(process.pid),
        clock_time(process.since),
        str(process.domain),
        process.script,
        process.folder,
        _services(process),
    )


def _services(process: Process) -> str:
    state, services = _state(process), " ".join(process.services) or "-"
    return services if state == "running" else f"{services} ({state})"


def _state(process: Process) -> str:
    if process_state.is_stopped(process.pid):
        return "stopped"
    return "ending" if process.is_ending else "running"
