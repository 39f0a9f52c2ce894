"""Promise 17: acknowledged tasks are on the disk, and refused tasks never appear.

A store under load is recorded, call by call. From the recording the harness generates disks that a
machine failure could leave behind at any moment. Each of them is opened and checked.
"""

import asyncio
import json
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from taskrpc.core.storage import database
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from tests.faults import submitting
from tests.faults.disk_states import Disk, recorded
from tests.faults.harness import Bug

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
PROGRAM = Path(submitting.__file__)
FAST = Path("/dev/shm")  # if there is one: thousands of small files are created there

SYNC_FAILS = "fdatasync:error=EIO:when={}"
MOMENTS = range(20, 50, 3)  # the syncs that fail: some of them belong to a COMMIT
BROKEN = ("lost", "came to light", "torn apart", "corrupt")


def syncs_only_at_checkpoints(patch):
    _set_synchronous(patch, "NORMAL")


def never_syncs(patch):
    _set_synchronous(patch, "OFF")


def _set_synchronous(patch, how):
    connect = database._connect

    def hasty(path):
        connection = connect(path)
        connection.execute(f"PRAGMA synchronous = {how}")
        return connection

    patch(database, "_connect", hasty)


def acknowledges_before_the_commit(patch):
    apply, begun = SqliteStore.apply, []

    async def early(*arguments):
        begun.append(asyncio.ensure_future(apply(*arguments)))
        await asyncio.sleep(0)

    patch(SqliteStore, "apply", early)


def takes_the_unknown_for_refused(patch):
    def guess(self, number, error):
        raise error

    patch(database.Database, "_find_out", guess)


@pytest.fixture
def folder(tmp_path, counts):
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed")
    probe = subprocess.run(["strace", "-f", "true"], capture_output=True, text=True, check=False)
    if probe.returncode:
        pytest.skip(f"strace may not follow programs here: {probe.stderr.splitlines()[0]}")
    # A unique name: other processes run the same test.
    made = Path(tempfile.mkdtemp(prefix="disks-", dir=FAST if FAST.is_dir() else tmp_path))
    yield made
    shutil.rmtree(made)


class Ledger:
    """The program's output: the tasks that a disk must, may and must not contain."""

    def __init__(self):
        self.begun, self.done, self.refused = {}, set(), set()

    def hear(self, text):
        for line in text.decode().splitlines():
            verdict, operation, *numbers = line.split()
            if verdict == "begun":
                self.begun[int(operation)] = tuple(map(int, numbers))
            elif verdict == "done":
                self.done.add(int(operation))
            elif verdict == "refused":
                self.refused.add(int(operation))

    def judge(self, stored, counts):
        """Count the differences between a store's tasks and the expected ones."""
        there = {completion.sequence for completion in stored.completions}
        counts["lost"] += len(self.done - there)
        counts["came to light"] += len(self.refused & there)
        tasks = {}
        for operation in sorted(there):
            number, *old = self.begun[operation]
            tasks[number] = submitting.task(number, operation)
            for each in old:
                tasks.pop(each)
        counts["torn apart"] += dict(tasks) != {task.task_id: task for task in stored.tasks}


async def look(folder, files, ledger, counts):
    """Open a disk as the next server does."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    store = SqliteStore(folder / "tasks.db")
    try:
        stored = await store.load()
    except Exception as error:
        counts["corrupt"] += 1
        print(f"corrupt: {error}")
        return
    finally:
        await store.close()
    counts["disks"] += 1
    ledger.judge(stored, counts)


async def rehearse(folder, programs, seed, counts, *, large, limit=0, inject=()):
    """Record the program, then check a bounded number of disks at random moments."""
    operations, disks = (2400, 8_000) if large else (240, 300)
    there = folder / "recorded"
    shutil.rmtree(there, ignore_errors=True)
    there.mkdir()
    command = programs.command(PROGRAM, str(there), str(seed), str(operations), str(limit))
    events = recorded(command, there, inject=inject)
    chance = random.Random(seed)
    wanted = sorted(_moments(events, disks, chance))
    disk, ledger = Disk(ignored=("-shm",)), Ledger()
    counts["failed syncs"] += sum(kind == "sync" and not worked for kind, _, worked in events)
    for moment, (kind, name, detail) in enumerate(events):
        if name != "said":
            disk.follow(kind, name, detail)
        elif kind == "write":
            ledger.hear(detail[1])
        while wanted and wanted[0] == moment:
            wanted.pop(0)
            left = chance.choice([disk.left, disk.seen, lambda: disk.left(chance)])
            await look(folder / "left", left(), ledger, counts)
    counts["acknowledged"] += len(ledger.done)
    counts["refused"] += len(ledger.refused)
    counts["unknown"] += len(ledger.begun) - len(ledger.done) - len(ledger.refused)


def _moments(events, count, chance):
    """Random moments, more of them just after a refusal."""
    refusals = [
        moment
        for moment, (kind, name, detail) in enumerate(events)
        if (kind, name) == ("write", "said") and b"refused" in detail[1]
    ]
    special = chance.choices(refusals, k=count // 3) if refusals else []
    return special + chance.choices(range(len(events)), k=count - len(special))


@pytest.mark.planted(
    Bug(syncs_only_at_checkpoints, "lost"),
    Bug(never_syncs, "lost"),
    Bug(acknowledges_before_the_commit, "lost"),
)
async def test_acknowledged_tasks_survive_a_machine_failure_at_any_time(
    folder, programs, seed, counts, large
):
    await rehearse(folder, programs, seed, counts, large=large)
    counts.check(*BROKEN, "refused", "unknown")
    counts.require(disks=250, acknowledged=200)


@pytest.mark.planted(Bug(takes_the_unknown_for_refused, "came to light"))
async def test_response_is_true_after_a_failed_sync(folder, programs, seed, counts, large):
    for moment in MOMENTS:
        fault = SYNC_FAILS.format(moment)
        await rehearse(folder, programs, seed + moment, counts, large=large, inject=[fault])
        if counts.broken(*BROKEN) or counts["refused"] > 8:
            break
    counts.check(*BROKEN)
    counts.require(disks=250, acknowledged=200, failed_syncs=1, refused=9)


async def test_acknowledged_tasks_survive_a_permanent_disk_failure(
    folder, programs, seed, counts, large
):
    fault = SYNC_FAILS.format("30+")
    await rehearse(folder, programs, seed, counts, large=large, inject=[fault])
    counts.check(*BROKEN)
    counts.require(disks=250, acknowledged=50, failed_syncs=2, refused=50, unknown=1)


async def test_task_without_disk_space_is_refused_and_never_appears(
    folder, programs, seed, counts, large
):
    await rehearse(folder, programs, seed, counts, large=large, limit=150_000)
    counts.check(*BROKEN)
    counts.require(disks=250, acknowledged=100, refused=3)


async def test_full_disk_is_reported_clearly_and_loses_nothing(tmp_path, counts):
    place = ["unshare", "-rm"]
    if shutil.which("unshare") is None:
        pytest.skip("unshare is not installed")
    probe = subprocess.run([*place, "true"], capture_output=True, text=True, check=False)
    if probe.returncode:
        pytest.skip(f"no disk can be mounted here: {probe.stderr.strip()}")
    command = [*place, sys.executable, "-m", "tests.faults.full_disk", str(tmp_path)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    told = json.loads(ran.stdout)
    counts.update({name: len(told[name]) for name in ("done", "refused", "unknown")})
    counts.require(done=200, refused=40)
    assert set(told["sentences"]) == {
        f"{tmp_path / 'disk' / 'tasks.db'}: the disk is full; nothing was stored"
    }
    assert told["killed when full"] == sorted(told["done when full"])
    assert told["killed afterwards"] == told["closed"] == sorted(told["done"])
    assert max(told["done"]) > max(told["refused"]), "there was room again"
