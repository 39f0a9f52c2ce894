"""`taskrpc stop`: end taskrpc programs of this user, and only those."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Sequence

from taskrpc import platform
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted
from taskrpc.cli.shared.processes import Process, listing, processes

PATIENCE = 5.0
"""Seconds that a process gets to end."""

_POLL = 0.05


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `stop`."""
    what = "A pid, a script (server.py), a node or a service; optional if only one program runs"
    parser.add_argument("name", nargs="?", metavar="NAME", help=what)
    parser.add_argument("--all", action="store_true", help="End all of them")
    what = "End them at once, without waiting for calls in flight"
    parser.add_argument("--force", action="store_true", help=what)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.all and options.name:
        raise UsageError("taskrpc stop: error: expected NAME or --all, got both")
    chosen = processes() if options.all else _chosen(options.name)
    if not chosen:
        print("no taskrpc program is running")
    for process in chosen:
        # Between our look and this call it may have ended by itself.
        with contextlib.suppress(ProcessLookupError):
            platform.end_process(process.pid, at_once=options.force)
    remaining = _wait_for_end(chosen)
    for process in chosen:
        if process.pid not in remaining:
            print(f"stopped {process}")
    if remaining:
        raise _still_running([each for each in chosen if each.pid in remaining])
    return Exit.DONE


def _chosen(name: str | None) -> Sequence[Process]:
    """The one process that a name means, or the only one that runs."""
    running = processes()
    found = [each for each in running if name is None or each.is_meant_by(name)]
    if len(found) == 1 or (name is None and not found):
        return found
    if not found:
        there = f"there are {listing(running)}" if running else "no taskrpc program is running"
        hint = quoting.name_hint(name or "") or there
        raise hinted(NotFound(f"found no taskrpc program {name!r}"), hint)
    problem = f"expected one program, found {len(found)}: {listing(found)}"
    raise hinted(NotFound(problem), "give a pid, or --all")


def _wait_for_end(chosen: Sequence[Process]) -> set[int]:
    """The pids of those that still run after a while."""
    wanted = {process.pid for process in chosen}
    deadline = time.monotonic() + PATIENCE
    while (left := wanted & {process.pid for process in processes()}) and (
        time.monotonic() < deadline
    ):
        time.sleep(_POLL)
    return left


def _still_running(left: Sequence[Process]) -> NotFound:
    error = NotFound(f"still running after {PATIENCE:g} s: {listing(left)}")
    for process in left:
        error = hinted(error, f"{process} {_why(process)}")
    return error


def _why(process: Process) -> str:
    """Why a process that was told to end still runs; it was looked up before it was told."""
    now = next((each for each in processes() if each.pid == process.pid), process)
    if now.is_ending:
        return "still answers calls and then ends; --force does not wait for them"
    if process.services:
        return "does not react: a callback may block its event loop; --force ends it at once"
    return "handles the signal itself; --force ends it at once"
