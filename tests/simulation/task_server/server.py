"""A server: `server.py main` has tasks and a disk, `server.py helper` only the plain services.

It shuts down and starts again now and then, and its accounts change.
"""

import asyncio
import contextlib
import json
import os
import random
import sys
import time

from messages import Announcer
from moments import CALM, END, RECOVERED
from records import fails, now, record
from stores import (
    FailingCompletions,
    FailingDisk,
    RecordedTasks,
    disk_number,
    record_contents,
    remember_disk,
    tasks_file,
)

import srvgen
import taskrpc
from taskrpc.robot.protocol import RobotStopped

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
GRACE = 2.0
"""Seconds that running calls get when a server drains."""
INSIDE = "the server's inside"
"""The message of a callback's exception, which no caller may read."""
ROLES = {"user0": "submit", "user1": "submit", "user2": "operate"}


class Robot:
    """A robot that only waits, and records its motions."""

    speed = 1.0
    task_types = ("move",)

    def __init__(self):
        self._left = 0.0
        self._going = asyncio.Event()
        self._going.set()
        self._is_stopped = False

    def plan(self, task_type, target, start):
        return taskrpc.Plan(0.3, start)

    def pose(self):
        return taskrpc.Pose(0.0, 0.0, 0.0)

    async def execute(self, task_type, target, report):
        record("moved", target)
        self._left = random.uniform(0.05, 0.8)
        try:
            while self._left:
                await self._going.wait()
                step = min(self._left, 0.2)
                await asyncio.sleep(step)
                if self._is_stopped:
                    raise RobotStopped("stopped")
                self._left -= step
        finally:
            self._left = 0.0
            self._is_stopped = False
            self._going.set()
        return {}

    def remaining(self):
        return self._left

    def pause(self):
        self._going.clear()

    def resume(self):
        self._going.set()

    def stop(self):
        self._is_stopped = self._left > 0
        self._going.set()


class AccountsFile:
    """A file of accounts that changes while the server uses it."""

    def __init__(self, name):
        self.path = f"accounts-{name}.json"
        self._rows = {
            user: {"secret": f"secret-of-the-{user}", "role": role, "revoked": False}
            for user, role in ROLES.items()
        }
        record("accounts", ROLES)
        self._write()

    async def change(self):
        """Change and restore accounts until the faults end."""
        while now() < CALM:
            await self._pause(CALM)
            user = random.choice(tuple(ROLES))
            row = self._rows[user]
            if now() < CALM and random.random() < 0.5:
                row["revoked"] = True
            elif now() < CALM:
                row["role"] = random.choice(("observe", "submit", "operate"))
            self._changed(user)
            await self._pause(CALM)
            row.update(role=ROLES[user], revoked=False)
            self._changed(user)

    async def _pause(self, until):
        await asyncio.sleep(max(0.0, min(random.expovariate(0.5), until - now())))

    def _changed(self, user):
        self._record(user)
        self._write()

    def _record(self, user):
        record("account", user, self._rows[user]["role"], self._rows[user]["revoked"])

    def _write(self):
        new = f"{self.path}.new"
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
            json.dump({"accounts": self._rows}, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, self.path)


class Life:
    """The time from a start to an end; the main server's disk may be a new one."""

    def __init__(self, accounts, disk_number):
        self._accounts = accounts
        self._disk = FailingDisk()
        self._number = disk_number
        """The number of the disk, None for the helper."""
        self._tasks = None

    async def run(self, until):
        if self._number is None:
            async with self._node() as node:
                await self._wait(node, until)
            return
        completions = FailingCompletions(self._disk, self._number)
        try:
            async with self._node() as node:
                node.create_service(Add, "once", self._handle_once, exactly_once=completions)
                self._tasks = RecordedTasks(self._disk, self._number)
                async with taskrpc.TaskServer(
                    node, Robot(), self._tasks, settle=0.02, wall_clock=time.time
                ):
                    await self._wait(node, until)
        finally:
            await completions.close()

    @contextlib.asynccontextmanager
    async def _node(self):
        """The node with the plain services and the publishers."""
        path = self._accounts.path
        async with taskrpc.Node("server", accounts=path, keepalive="robot") as node:
            for kind, options in (
                ("plain", {}),
                ("repeatable", {"idempotent": True}),
                ("steer", {"role": taskrpc.Role.OPERATE}),
            ):
                node.create_service(Add, kind, self._handle, concurrency=4, join=True, **options)
            Announcer(node, sys.argv[1], random)
            yield node

    async def _wait(self, node, until):
        while now() < until:
            await asyncio.sleep(random.choice((0.3, 1.0)) if now() < CALM else 1.0)
            self._disk.is_full = now() < CALM and random.random() < 0.1
            if self._disk.is_full:
                record("full disk")
            if self._tasks is not None and self._tasks.file.is_broken and now() > CALM:
                break  # only a new start can use the file again
        record("drain", now() + GRACE)
        await node.drain(GRACE)

    async def _handle(self, request, response):
        kind = taskrpc.current_call().service[1:]
        left = taskrpc.current_call().time_left() or 0.0
        latest = now() + left
        try:
            await asyncio.sleep(self._begin(request, kind))
        except asyncio.CancelledError:
            record("stopped", request.a)
            raise
        record("ran", request.a, latest)
        if fails(request.a, kind):
            raise ValueError(INSIDE)
        response.sum = request.a + request.b
        return response

    async def _handle_once(self, request, response):
        await asyncio.sleep(self._begin(request, "once"))
        if fails(request.a, "once"):
            raise taskrpc.HandlerError("ABORTED", f"{request.a} fails")
        response.sum = request.a + request.b
        return taskrpc.Effect(response, [("INSERT INTO effects VALUES (?)", (request.a,))])

    def _begin(self, request, kind):
        """How many seconds the work takes."""
        seconds = random.choice((0.0, 0.3, 1.0, 3.0)) * random.random()
        record("run", request.a, now() + seconds, taskrpc.current_call().principal, kind)
        return seconds


async def main(name):
    accounts = AccountsFile(name)
    changing = asyncio.create_task(accounts.change())
    number = None
    if name == "main":
        number = disk_number()
        if os.path.exists(tasks_file(number)) and now() < CALM and random.random() < 0.3:
            number += 1
            remember_disk(number)
            record("new disk")
    last_start = CALM if name == "main" else RECOVERED
    while now() < END:
        until = now() + (2.0 if name == "main" else 1.0) + random.expovariate(0.25)
        record("server starts", number)
        try:
            await Life(accounts, number).run(until if until < last_start else END)
        except (taskrpc.StoreError, taskrpc.OutcomeUnknown) as error:
            record("cannot start", str(error))
            await asyncio.sleep(0.4)
        else:
            await asyncio.sleep(random.choice((0.01, 0.3, 1.5)) * random.random())
    await changing
    await asyncio.sleep(3.0)
    left = asyncio.all_tasks() - {asyncio.current_task()}
    timers = [each for each in asyncio.get_running_loop()._scheduled if not each.cancelled()]
    if left or timers:
        record("left behind", f"{left} {timers}")
    for each in range(0 if number is None else number + 1):
        await record_contents(each)


asyncio.run(main(sys.argv[1]))
