"""`taskrpc classroom reset`: begins the next group, with or without a running server."""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import srvgen
from taskrpc.cli.course.classroom.group import RESET
from taskrpc.cli.shared.command import UsageError, hinted
from taskrpc.cli.shared.remote import HERE
from taskrpc.course.classroom.archive import summary, write_archive
from taskrpc.course.classroom.attendance import Attendance
from taskrpc.course.classroom.register import Register
from taskrpc.errors import TaskRpcError
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.spi import Registry, domain_id, suggestions

REFRESH = 1.5
"""Seconds until a running server has noticed new accounts; it looks each second."""
_TIMEOUT = 60.0  # seconds for a reset: thousands of tasks may have to be stored


def confirmed(options: argparse.Namespace) -> bool:
    """Ask whether to end the group, except with `--yes`. Raises UsageError without a terminal."""
    if options.yes:
        return True
    if not sys.stdin.isatty():
        problem = "expected --yes, because nobody can be asked here"
        raise UsageError(f"taskrpc classroom reset: error: {problem}")
    question = "End this group: cancel its tasks, and put the robot to its start? [y/N] "
    return input(question).strip().lower() in ("y", "yes")


def end_group(register: Register, databases: Sequence[Path]) -> None:
    """End the present group, and print what was done.

    `databases` are those of the robots; they are used only if no server runs. Raises TaskRpcError.
    """
    services = _running()
    if not services:
        print(_end_stored(register, databases))
    for service in services:
        print(asyncio.run(_call(service)))


def _running() -> Sequence[str]:
    """Return the reset services of this machine's servers.

    Raises TaskRpcError if a task server runs that is not the server of the class.
    """
    entries = suggestions.others(Registry(domain_id()).entries())
    names = [each.name for entry in entries for each in entry.services]
    found = sorted({name for name in names if name.endswith(f"/{RESET}")})
    for entry in entries:
        if not found and entry.offers("/robot_task"):
            raise hinted(
                TaskRpcError(f"{entry.script} (pid {entry.pid}) is no server of a class"),
                f"end it with `taskrpc stop {entry.pid}`, or start it with `taskrpc classroom"
                " --serve`",
            )
    return found


async def _call(service: str) -> str:
    trigger = srvgen.load("std_srvs/srv/Trigger")
    async with HERE.node() as node:
        client = node.create_client(trigger, service, timeout=_TIMEOUT)
        response = await client.call(trigger.Request())
    return f"{service.removesuffix('/reset')}: {response.message}"


def _end_stored(register: Register, databases: Sequence[Path]) -> str:
    """End the group in the files, while no server runs; returns what was done."""
    existing = [database for database in databases if database.exists()]
    try:
        count, path = asyncio.run(_end_stored_tasks(register, existing))
        attendance = register.attendance_file
        if attendance.exists():
            Attendance(attendance).clear()
    except OSError as error:
        raise TaskRpcError(f"{error.filename}: {error.strerror}") from None
    return f"no server runs: {summary(count, path)}"


async def _end_stored_tasks(
    register: Register, databases: Sequence[Path]
) -> tuple[int, Path | None]:
    """Archive the tasks of stores, then forget them; returns their number and the archive."""
    now, tasks = time.time(), list[Task]()
    stores = [SqliteStore(database) for database in databases]
    try:
        found = [(await store.load()).tasks for store in stores]
        for task in (task for stored in found for task in stored):
            is_ended = task.state.is_ended
            tasks.append(task if is_ended else task.ended(TaskState.CANCELED, now, message="reset"))
        path = write_archive(register, tasks, now)
        for store, stored in zip(stores, found, strict=True):
            await store.apply([], [task.task_id for task in stored])
            await store.remember_pause(False)
    finally:
        for store in stores:
            await store.close()
    return len(tasks), path
