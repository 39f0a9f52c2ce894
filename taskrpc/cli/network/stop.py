"""`taskrpc stop`: ends taskrpc programs of this user, and no other programs."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import srvgen
from taskrpc.cli.ros.action.action_graph import actions
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted
from taskrpc.cli.shared.processes import Process, listing, processes
from taskrpc.node import Node
from taskrpc.spi import STATUS_QOS, names_of, process_state, signals, states_in, suggestions

END_TIMEOUT = 5.0
"""Seconds that a process gets to end."""

_POLL = 0.05  # seconds between two looks at the registry
_STATUS_TIMEOUT = 1.0
"""Seconds for the status of actions to arrive; an action without goals sends none."""


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
    signalled = [each for each in chosen if _signal(each, at_once=options.force)]
    remaining = _wait_for_end(signalled)
    for process in signalled:
        if process.pid not in remaining:
            print(f"stopped {process}")
    if foreign := [each for each in chosen if each not in signalled]:
        raise _foreign(foreign)
    if remaining:
        raise _still_running([each for each in signalled if each.pid in remaining])
    return Exit.DONE


def _signal(process: Process, *, at_once: bool) -> bool:
    """Tell a process to end; False if it may be another one than its registry entry describes."""
    if not suggestions.wrote_its_entries(process.pid):
        return False
    try:
        signals.end_process(process.pid, at_once=at_once)
    except ProcessLookupError:
        pass  # it has ended by itself since the look at the registry
    except PermissionError:  # it belongs to another user, so it wrote no entry of this user's
        return False
    return True


def _foreign(found: Sequence[Process]) -> NotFound:
    hint = (
        "a process with this pid did not write the registry entry; another program did, or a"
        " program in a container, where it has another pid: end it there"
    )
    return hinted(NotFound(f"not ended: {listing(found)}"), hint)


def _chosen(name: str | None) -> Sequence[Process]:
    """Return the one process that a name means, or without a name the only one that runs."""
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
    """Wait up to `END_TIMEOUT`; returns the pids of the processes that still run."""
    wanted = {process.pid for process in chosen}
    deadline = time.monotonic() + END_TIMEOUT
    while (left := _running(wanted)) and time.monotonic() < deadline:
        time.sleep(_POLL)
    return left


def _running(pids: set[int]) -> set[int]:
    """Return those that still run; one may have left the registry, but not ended."""
    listed = {process.pid for process in processes()}
    return {pid for pid in pids if pid in listed or not process_state.has_ended(pid)}


def _still_running(left: Sequence[Process]) -> NotFound:
    error = NotFound(f"still running after {END_TIMEOUT:g} s: {listing(left)}")
    for process in left:
        error = hinted(error, f"{process} {_why(process)}")
    return error


async def _actions_with_goals(process: Process) -> list[str]:
    """Return the actions of a process whose goals run, as the status of each says."""
    offered = [name for name, each in actions(process.entries).items() if each.servers]
    running: set[str] = set()
    heard = asyncio.Event()

    def on_status(name: str, message: Any) -> None:
        if any(state.is_active for state in states_in(message).values()):
            running.add(name)
            heard.set()

    if offered:
        status = srvgen.load("action_msgs/msg/GoalStatusArray")
        node = Node(f"_taskrpc_cli_{os.getpid()}", namespace="/")
        node.domain = process.domain
        async with node:
            for name in offered:
                topic = names_of(name).status
                node.create_subscription(status, topic, partial(on_status, name), STATUS_QOS)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_STATUS_TIMEOUT):
                    await heard.wait()
    return sorted(running)


def _why(before: Process) -> str:
    """Return why a process still runs; `before` is its entry from before the signal."""
    now = next((each for each in processes() if each.pid == before.pid), None)
    if now is None:
        return (
            "has destroyed its nodes, but a thread that is no daemon, or other code, still runs;"
            " --force ends it at once"
        )
    if process_state.ignores_end(before.pid):
        return "ignores the signal to end (SIGTERM); --force ends it at once"
    if held_by := asyncio.run(_actions_with_goals(now)):
        return f"waits for running goals of {', '.join(held_by)}; --force does not wait for them"
    if before.services and not now.services:
        return "waits for calls in flight, and then ends; --force does not wait for them"
    return (
        "does not react: a callback or a loop may block it, or it handles the signal itself;"
        " --force ends it at once"
    )
