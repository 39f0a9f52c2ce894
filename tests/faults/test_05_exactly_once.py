"""Promise 5: while a server is killed repeatedly, each request becomes exactly one task."""

import asyncio
import collections
import contextlib
import random
import sqlite3

import pytest

import srvgen
import taskrpc
from taskrpc.core.attempts import Attempts
from taskrpc.core.request_ids.ids import StoredCompletions
from taskrpc.robot.tasks.records.repository import TaskCompletions, TaskRepository
from tests.faults.harness import Bug
from tests.faults.planted import forget_what_was_done
from tests.faults.programs import TASK_SERVER, kill

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
CLIENTS = 8
BROKEN = ("lost", "doubled", "one number for two", "unknown task", "unknown")


def acknowledge_before_it_is_stored(patch):
    save = TaskRepository.save_with_callback

    def early(self, then, *tasks, **options):
        loop = asyncio.get_running_loop()
        loop.call_later(0.05, lambda: save(self, lambda error: None, *tasks, **options))
        then(None)

    patch(TaskRepository, "save_with_callback", early)


def lose_the_completions(patch):
    recall = TaskCompletions.recall

    async def forgetful(self):
        return StoredCompletions((await recall(self)).store_id)

    patch(TaskCompletions, "recall", forgetful)


class Server:
    """The task server in a separate process, which can be killed and restarted."""

    def __init__(self, folder, programs):
        self.db = folder / "tasks.db"
        self._programs = programs
        self._program = None

    async def start(self):
        # Queued tasks are counted and never run: the queue stays paused.
        options = ["--db", str(self.db), "--queue-limit", "1000000", "--log-level", "error"]
        self._program = await self._programs.start(
            TASK_SERVER, *options, ready="taskrpc-server", name="server.py"
        )

    async def kill(self):
        await kill(self._program)

    def stored(self):
        """The number of tasks for each target, read directly from the file."""
        with contextlib.closing(sqlite3.connect(self.db)) as file:
            rows = file.execute("SELECT json_extract(record, '$.target') FROM task").fetchall()
        return collections.Counter(target for (target,) in rows)


class Rehearsal:
    """Clients that submit tasks, and the responses they received."""

    def __init__(self, server, counts, chance):
        self.server = server
        self.chance = chance
        self.told = {}  # target -> task_id, None where the outcome is unknown
        self.counts = counts
        self.over = False

    async def client(self, number, node):
        # With a retry policy, a client without a server waits for the next one.
        retry = taskrpc.RetryPolicy()
        client = node.create_client(RobotTask, "/robot_task", timeout=60, retry=retry)
        each = 0
        while not self.over:
            each += 1
            target = f"{1 + number / 10:g},{1 + each / 100000:.5f}"
            request = RobotTask.Request(task_type="move", target=target, priority=5)
            try:
                answer = await client.call(request)
                assert answer.success, answer.message
                self.told[target] = answer.task_id
                self.counts["accepted"] += 1
            except taskrpc.OutcomeUnknown:
                self.told[target] = None
                self.counts["unknown"] += 1

    async def run(self, kills):
        await self.server.start()
        async with taskrpc.Node("clients") as node:
            pause = srvgen.load("taskrpc_interfaces/srv/PauseTasks")
            client = node.create_client(pause, "/robot_task/pause")
            await client.call(pause.Request(), retry=taskrpc.RetryPolicy())
            async with asyncio.TaskGroup() as group:
                for number in range(CLIENTS):
                    group.create_task(self.client(number, node))
                await self.kill_again_and_again(kills)
                await asyncio.sleep(0.3)
                self.over = True
        await self.server.kill()
        stored = self.compare()
        self.counts["unknown task"] = sum(target not in self.told for target in stored)

    async def kill_again_and_again(self, kills):
        for number in range(1, kills + 1):
            await asyncio.sleep(self.chance.uniform(0.02, 0.4))
            await self.server.kill()
            self.counts["kills"] += 1
            if number & (number - 1) == 0:  # less often over time: each look reads more tasks
                self.compare()
            await self.server.start()
            if self.counts.broken(*BROKEN):
                break

    def compare(self):
        """Compare the clients' responses with the file; returns its contents."""
        stored = self.server.stored()
        known = {target: task_id for target, task_id in self.told.items() if task_id is not None}
        ids = collections.Counter(known.values())
        self.counts["lost"] = sum(stored[target] == 0 for target in known)
        self.counts["doubled"] = sum(count > 1 for count in stored.values())
        self.counts["one number for two"] = sum(count > 1 for count in ids.values())
        return stored


@pytest.fixture
def sent_again(counts, monkeypatch):
    """Counts how often a client repeats a request that may have been executed."""
    wait = Attempts._wait_after

    def counted(self, error):
        waits = wait(self, error)
        counts["sent again"] += waits is not None and self._in_doubt
        return waits

    monkeypatch.setattr(Attempts, "_wait_after", counted)


@pytest.mark.planted(
    Bug(forget_what_was_done, "doubled"),
    Bug(acknowledge_before_it_is_stored, "lost"),
    Bug(lose_the_completions, "unknown"),
)
@pytest.mark.usefixtures("sent_again")
async def test_requests_to_a_repeatedly_killed_server_execute_exactly_once(
    tmp_path, programs, counts, seed, large
):
    # A few kills for each store: reading a growing store would take most of the time.
    kills, stores = (50, 200) if large else (15, 1)
    chance = random.Random(seed)
    for number in range(stores):
        (folder := tmp_path / f"store{number}").mkdir()
        rehearsal = Rehearsal(Server(folder, programs), counts, chance)
        await asyncio.wait_for(rehearsal.run(kills), 60 + 10 * kills)
        counts.check(*BROKEN, happened=("kills", "sent again", "accepted"))
    total = kills * stores
    counts.require(kills=total, sent_again=total // 3, accepted=10 * total)
