"""`taskrpc classroom roster`: the students, their last calls, and their queued tasks."""

from __future__ import annotations

import asyncio
import json
import time
from typing import Any

from taskrpc import Account
from taskrpc.cli.robot.task.task_services import TaskServices
from taskrpc.cli.robot.task.view import aligned
from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.remote import HERE
from taskrpc.cli.shared.robots import task_service
from taskrpc.course.classroom.attendance import last_calls
from taskrpc.course.classroom.register import Register
from taskrpc.errors import TaskRpcError
from taskrpc.spi import robot_namespace

_TIMEOUT = 2.0  # seconds for a call of the task server
_HEADINGS = "NAME", "STATE", "LAST CALL", "WAITING", "UNTIL"


def show(register: Register, *, as_json: bool) -> Exit:
    """Print a class's roster."""
    seen = last_calls(register.attendance_file)
    waiting = asyncio.run(_waiting(register.robots))
    written = register.names()
    rows = [_row(account, written, seen, waiting) for account in register.accounts()]
    if as_json:
        print(json.dumps(rows))
        return Exit.DONE
    lines = [_line(row) for row in rows]
    for line in aligned([_HEADINGS, *lines], right=(3,)):
        print(line)
    if waiting is None:
        print("(the task server is not running, so the number of queued tasks is unknown)")
    return Exit.DONE


async def _waiting(robots: int) -> list[str] | None:
    """Return the client of each queued task, as the server names it; None without a server."""
    tasks: list[Any] = []
    async with HERE.node() as node:
        try:
            for number in range(1, robots + 1):
                service = task_service(robot_namespace(number))
                tasks += await TaskServices(node, service, timeout=_TIMEOUT).tasks()
        except TaskRpcError:
            return None
    return [task.client for task in tasks if task.state == task.QUEUED]


def _row(
    account: Account, written: dict[str, str], seen: dict[str, float], waiting: list[str] | None
) -> dict[str, Any]:
    name = account.name
    return {
        "name": written.get(name, name),
        "account": name,
        "state": _state(account, name in seen),
        "last_call": seen.get(name),
        "waiting": None if waiting is None else waiting.count(name),
        "until": account.expires or None,
    }


def _line(row: dict[str, Any]) -> list[str]:
    name, account, *others = row.values()
    shown = name if name == account else f"{name} ({account})"
    return [shown, *(_shown(value) for value in others)]


def _state(account: Account, joined: bool) -> str:
    if account.revoked:
        return "revoked"
    if account.refusal(time.time()):
        return "expired"
    return "joined" if joined else "invited"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        try:
            return time.strftime("%Y-%m-%d %H:%M", time.localtime(value))
        except (OverflowError, OSError, ValueError):  # later than the system can represent
            return "-"
    return "-" if value is None else str(value)
