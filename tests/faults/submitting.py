"""Submits to a store from many callers, and prints the requests and their results."""

import asyncio
import itertools
import os
import random
import sys
from pathlib import Path

from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.storage import database
from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore

CALLERS = 8


def task(number, operation):
    return Task(
        task_id=number,
        task_type="move",
        target="x" * (operation % 200),
        priority=5,
        arrival=number,
        submitted_at=0.0,
        message=str(operation),
    )


class Caller:
    """Queues tasks, changes them and drops them, one after the other."""

    def __init__(self, store, say, operations, numbers, chance):
        self.store, self.say, self.chance = store, say, chance
        self.operations, self.numbers = operations, numbers
        self.mine = []

    async def call(self, count):
        for _ in range(count):
            number = next(self.numbers)
            if self.mine and self.chance.random() < 0.3:
                number = self.chance.choice(self.mine)
            old = [each for each in self.mine if each != number and self.chance.random() < 0.1]
            await self.apply(next(self.operations), number, old)

    async def apply(self, operation, number, old):
        done = Completion("", bytes(16), operation, 1, bytes(16), b"", 0, float(operation))
        self.say("begun", operation, number, *old)
        try:
            await self.store.apply([task(number, operation)], old, done)
        except StoreError:
            self.say("refused", operation)
        except OutcomeUnknown:
            self.say("unknown", operation)
        else:
            self.say("done", operation)
            self.mine = [each for each in self.mine if each not in {*old, number}] + [number]


async def main(folder, seed, count, limit):
    said = os.open(Path(folder) / "said", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    operations, numbers = itertools.count(1), itertools.count(1)
    store = SqliteStore(Path(folder) / "tasks.db")
    await store.load()
    if limit:
        import resource  # not on Windows, which has no strace either

        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    callers = [
        Caller(
            store,
            lambda *words: os.write(said, (" ".join(map(str, words)) + "\n").encode()),
            operations,
            numbers,
            random.Random(f"{seed} {each}"),
        )
        for each in range(CALLERS)
    ]
    await asyncio.gather(*(caller.call(count // CALLERS) for caller in callers))
    await store.close()


def often_checkpointed(connect):
    """Makes checkpoints frequent, so that a short recording contains some."""

    def connected(path):
        connection = connect(path)
        connection.execute("PRAGMA wal_autocheckpoint = 60")
        return connection

    return connected


if __name__ == "__main__":
    database._connect = often_checkpointed(database._connect)
    asyncio.run(main(sys.argv[1], *map(int, sys.argv[2:5])))
