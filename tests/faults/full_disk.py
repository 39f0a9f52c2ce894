"""Fills a small disk with tasks, makes room, continues; prints the answers and contents as JSON.

Run it in a separate namespace, where it may mount a disk: `unshare -rm python full_disk.py DIR`.
"""

import asyncio
import json
import shutil
import subprocess
import sys
from pathlib import Path

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from tests.faults.submitting import task

AT_ONCE = 8


class Filler:
    """Saves tasks, several at once, and records the answers."""

    def __init__(self, store):
        self.store, self.number = store, 0
        self.told = {"done": [], "refused": [], "unknown": [], "sentences": []}

    async def save(self):
        self.number += 1
        number = self.number
        one = task(number, number)
        try:
            await self.store.apply([one])
        except StoreError as error:
            self.told["refused"].append(number)
            self.told["sentences"].append(str(error))
        except OutcomeUnknown as error:
            self.told["unknown"].append(number)
            self.told["sentences"].append(str(error))
        else:
            self.told["done"].append(number)

    async def wave(self):
        await asyncio.gather(*(self.save() for _ in range(AT_ONCE)))


async def found(folder):
    store = SqliteStore(folder / "tasks.db")
    tasks = (await store.load()).tasks
    await store.close()
    return [each.task_id for each in tasks]


async def main(disk, aside):
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(600_000))
    store = SqliteStore(disk / "tasks.db")
    filler = Filler(store)
    while len(filler.told["refused"]) < 5 * AT_ONCE and filler.number < 20_000:
        await filler.wave()
    when_full = len(filler.told["done"])
    shutil.copytree(disk, aside / "full", ignore=shutil.ignore_patterns("ballast", "*.lock"))
    ballast.unlink()
    for _ in range(10):
        await filler.wave()
    shutil.copytree(disk, aside / "after", ignore=shutil.ignore_patterns("*.lock"))
    await store.close()
    return {
        **filler.told,
        "done when full": filler.told["done"][:when_full],
        "killed when full": await found(aside / "full"),
        "killed afterwards": await found(aside / "after"),
        "closed": await found(disk),
    }


if __name__ == "__main__":
    place = Path(sys.argv[1])
    (place / "disk").mkdir()
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place / "disk")], check=True
    )
    print(json.dumps(asyncio.run(main(place / "disk", place))))
