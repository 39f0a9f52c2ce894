"""Promise 5: while a server is killed again and again, each request becomes exactly one task."""

import asyncio
import collections
import contextlib
import os
import random
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.attempts import Attempts

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
CLIENTS = 8

PLANTED = {
    "nothing": "",
    "no deduplication": """
from taskrpc.wire.once import Ledger, Verdict
decide = Ledger.decide
def forgetful(*arguments):
    verdict = decide(*arguments)
    return Verdict.NEW if verdict in (Verdict.DONE, Verdict.ATTACH) else verdict
Ledger.decide = forgetful
""",
    "acknowledged before it is stored": """
import asyncio
from taskrpc.tasks.book import TaskBook
save = TaskBook.save
async def early(self, *tasks, **options):
    later = lambda: asyncio.ensure_future(save(self, *tasks, **options))
    asyncio.get_running_loop().call_later(0.05, later)
TaskBook.save = early
""",
    "completions that do not survive": """
from taskrpc.tasks.completions import TaskCompletions
from taskrpc.wire.once import Remembered
recall = TaskCompletions.recall
async def forgetful(self):
    return Remembered((await recall(self)).store_id)
TaskCompletions.recall = forgetful
""",
}
PROGRAM = "import sys\n{patch}\nfrom taskrpc.cli.server import main\nsys.exit(main(sys.argv[1:]))\n"


class Server:
    """The task server in a process of its own, which can be killed and started again."""

    def __init__(self, folder, patch):
        self.db = folder / "tasks.db"
        self.program = PROGRAM.format(patch=patch)
        self.process = None
        self.env = {**os.environ, "PYTHONPATH": str(ROOT)}

    async def start(self):
        # Tasks that wait are counted, not driven: a queue that is paused stays so.
        options = ["--db", str(self.db), "--queue-limit", "1000000", "--log-level", "error"]
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", self.program, *options, env=self.env, stderr=subprocess.PIPE
        )
        line = await self.process.stderr.readline()
        while b"ready" not in line:
            assert line, "the server did not start"
            line = await self.process.stderr.readline()

    async def kill(self):
        self.process.kill()
        await self.process.wait()

    def stored(self):
        """How many tasks there are of each target, as the file says; by nobody's leave."""
        with contextlib.closing(sqlite3.connect(self.db)) as file:
            rows = file.execute("SELECT json_extract(record, '$.target') FROM task").fetchall()
        return collections.Counter(target for (target,) in rows)


class Rehearsal:
    """Clients that submit, and what they were told."""

    def __init__(self, server, counts, seed):
        self.server = server
        self.chance = random.Random(seed)
        self.told = {}  # target -> task_id, None where the outcome is unknown
        self.counts = counts
        self.over = False

    async def client(self, number, node, pace):
        client = node.create_client(RobotTask, "/robot_task", timeout=60)
        each = 0
        while not self.over:
            await asyncio.sleep(pace)
            each += 1
            target = f"{1 + number / 10:g},{1 + each / 100000:.5f}"
            request = RobotTask.Request(task_type="move", target=target, priority=5)
            try:
                self.told[target] = (await client.call(request)).task_id
                self.counts["accepted"] += 1
            except taskrpc.OutcomeUnknown:
                self.told[target] = None
                self.counts["unknown"] += 1

    async def run(self, kills):
        pace = 0.0 if kills < 100 else 0.1  # millions of tasks would measure restarts instead
        await self.server.start()
        async with taskrpc.Node("clients") as node:
            pause = srvgen.load("taskrpc_interfaces/srv/PauseTasks")
            client = node.create_client(pause, "/robot_task/pause")
            await client.call(pause.Request(), retry=taskrpc.RetryPolicy())
            clients = [asyncio.ensure_future(self.client(n, node, pace)) for n in range(CLIENTS)]
            for _ in range(kills):
                await asyncio.sleep(self.chance.uniform(0.02, 0.4))
                await self.server.kill()
                self.counts["kills"] += 1
                await self.server.start()
            await asyncio.sleep(0.3)
            self.over = True
            await asyncio.gather(*clients)
        await self.server.kill()

    def check(self):
        stored = self.server.stored()
        known = {target: task_id for target, task_id in self.told.items() if task_id is not None}
        ids = collections.Counter(known.values())
        self.counts["lost"] = sum(stored[target] == 0 for target in known)
        self.counts["doubled"] = sum(count > 1 for count in stored.values())
        self.counts["one number for two"] = sum(count > 1 for count in ids.values())
        self.counts["nobody's"] = sum(target not in self.told for target in stored)


@pytest.fixture
def sandbox(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "run").mkdir(mode=0o700)
    return tmp_path


BROKEN = ("lost", "doubled", "one number for two", "nobody's", "unknown")


@pytest.fixture
def rehearse(sandbox, monkeypatch, counts, seed):
    """Kill a server, with a bug or without, so many times under eight clients."""

    async def rehearsed(kills, *, patch="nothing"):
        rehearsal = Rehearsal(Server(sandbox, PLANTED[patch]), counts, seed)
        wait = Attempts._wait_after

        def counted(self, error):
            waits = wait(self, error)
            counts["sent again"] += waits is not None and self._in_doubt
            return waits

        monkeypatch.setattr(Attempts, "_wait_after", counted)
        try:
            await asyncio.wait_for(rehearsal.run(kills), 60 + 10 * kills)
        finally:
            if rehearsal.server.process and rehearsal.server.process.returncode is None:
                await rehearsal.server.kill()
        rehearsal.check()

    return rehearsed


async def test_requests_of_a_server_that_is_killed_again_and_again(rehearse, counts, large):
    kills = 10_000 if large else 30
    await rehearse(kills)
    counts.require(kills=kills, sent_again=kills // 3, accepted=10 * kills)
    assert counts.broken(*BROKEN) == {}


@pytest.mark.parametrize("patch", [name for name in PLANTED if name != "nothing"])
async def test_the_harness_sees_what_is_planted(rehearse, counts, patch):
    await rehearse(8, patch=patch)
    assert counts.broken(*BROKEN)
