"""The files of the main server: SQLite behind a disk that is slow, fills up and fails."""

import asyncio
import os
import random

from moments import CALM
from records import now, record

from taskrpc import OutcomeUnknown, SqliteCompletions, StoreError
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore

SCHEMA = ["CREATE TABLE IF NOT EXISTS effects (number INTEGER NOT NULL)"]


def tasks_file(number):
    """The file of the tasks on a disk."""
    return f"tasks{number}.db"


def effects_file(number):
    """The file of the exactly-once service on a disk."""
    return f"effects{number}.db"


def disk_number():
    """The number of the disk that the server uses."""
    if not os.path.exists("disk"):
        return 0
    with open("disk") as file:
        return int(file.read())


def remember_disk(number):
    """Let the next start use this disk, too."""
    with open("disk.new", "w") as file:
        file.write(str(number))
        file.flush()
        os.fsync(file.fileno())
    os.replace("disk.new", "disk")


class FailingDisk:
    """Fails before the faults end: a write may fail without a change or with an unknown outcome."""

    def __init__(self):
        self.is_full = False

    @property
    def may_fail(self):
        return now() < CALM


class File:
    """One open file: each write takes time; after an unknown outcome it must be opened again."""

    def __init__(self, disk):
        self._disk = disk
        self._turn = asyncio.Lock()
        self.is_broken = False

    async def write(self, write):
        async with self._turn:
            self._check()
            await self._wait()
            if self._disk.is_full:
                record("no room")
                raise StoreError("the disk is full; nothing was stored")
            if self._disk.may_fail and random.random() < 0.04:
                await self._fail(write)
            await write()
            await self._wait()

    async def read(self):
        """Wait until the file can be read."""
        await self._wait()
        self._check()
        if self._disk.may_fail and random.random() < 0.06:
            record("failed read")
            raise StoreError("the file cannot be read")

    async def _fail(self, write):
        if random.random() < 0.6:
            record("failed commit")
            raise StoreError("nothing was stored")
        record("unknown commit")
        self.is_broken = True
        if random.random() < 0.5:
            await write()
        raise OutcomeUnknown("it is unknown whether it was stored")

    def _check(self):
        if self.is_broken:
            raise StoreError("the file cannot be used before it is opened anew")

    async def _wait(self):
        await asyncio.sleep(random.choice((0.0, 0.002, 0.03)) * random.random())


def brief(task):
    """What the ledger needs of a task."""
    return task.task_id, task.state.name, task.priority, task.arrival, task.target


class RecordedTasks:
    """A `TaskStore` that records what was loaded and stored."""

    def __init__(self, disk, number):
        self.file = File(disk)
        self._number = number
        self._store = SqliteStore(tasks_file(number))
        self.open_now = self._store.open_now
        self.history = self._store.history

    async def load(self):
        await self.file.read()
        stored = await self._store.load()
        record("loaded", self._number, [brief(task) for task in stored.tasks])
        return stored

    async def apply(self, saved, forgotten=(), completion=None, clients=()):
        record("saving", [brief(task) for task in saved])
        numbers = [task.task_id for task in saved]
        try:
            await self.file.write(lambda: self._store.apply(saved, forgotten, completion, clients))
        except BaseException as error:
            record("not saved", numbers, isinstance(error, StoreError))
            raise
        record("saved", numbers)

    async def remember_pause(self, paused):
        await self.file.write(lambda: self._store.remember_pause(paused))

    async def clear(self):
        await self.file.write(self._store.clear)

    async def close(self):
        await self._store.close()


class FailingCompletions:
    """A `CompletionStore` on a failing disk."""

    def __init__(self, disk, number):
        self._file = File(disk)
        self._store = SqliteCompletions(effects_file(number), SCHEMA)
        self.open_now = self._store.open_now

    async def recall(self):
        self._file.is_broken = False
        await self._file.read()
        return await self._store.recall()

    async def complete(self, completion, effect, forgotten=()):
        await self._file.write(lambda: self._store.complete(completion, effect, forgotten))

    async def close(self):
        await self._store.close()


async def record_contents(number):
    """Record what a disk contains at the end, if anything; no server uses it."""
    if not os.path.exists(tasks_file(number)):
        return
    store = SqliteStore(tasks_file(number))
    tasks = (await store.load()).tasks
    await store.close()
    effects = SqliteCompletions(effects_file(number), SCHEMA)
    found = await effects.query("SELECT number FROM effects")
    await effects.close()
    record("disk", number, [brief(task) for task in tasks], [row[0] for row in found])
