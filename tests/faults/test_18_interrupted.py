"""Promise 18: a task that ran when the server died is INTERRUPTED, and never silently run again.

The server is killed in the middle of tasks; a robot that writes down what it does is the witness.
"""

import asyncio
import collections
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
import taskrpc

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
PROGRAM = "import sys\n{patch}\nfrom taskrpc.cli.server import main\nsys.exit(main(sys.argv[1:]))\n"
RUN_AGAIN = """
import msgspec
from taskrpc.tasks.book import TaskBook
from taskrpc.tasks.model import State
open_book = TaskBook.open
async def reopened(self):
    tasks = await open_book(self)
    again = lambda task: msgspec.structs.replace(task, state=State.QUEUED)
    return [again(task) if task.state.is_begun else task for task in tasks]
TaskBook.open = reopened
"""
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
ListTasks = srvgen.load("taskrpc_interfaces/srv/ListTasks")
RequeueTask = srvgen.load("taskrpc_interfaces/srv/RequeueTask")
DropTask = srvgen.load("taskrpc_interfaces/srv/DropTask")


class Notebook:
    """What the robot wrote."""

    def __init__(self, path):
        self.path = path

    def lines(self):
        return self.path.read_text().split("\n")[:-1] if self.path.exists() else []

    def runs(self):
        """How often each target's task was begun."""
        return collections.Counter(each[6:] for each in self.lines() if each.startswith("began"))

    def in_hand(self):
        """The target of the task that was begun last, if it did not end."""
        last = (self.lines() or [""])[-1]
        return last.removeprefix("began ") if last.startswith("began") else None


class Rehearsal:
    """A server that is killed in mid-task, and a user who decides what becomes of the task."""

    def __init__(self, folder, counts, seed, patch):
        self.db, self.notebook = folder / "tasks.db", Notebook(folder / "notebook")
        self.counts, self.chance = counts, random.Random(seed)
        self.program = PROGRAM.format(patch=patch)
        self.allowed = collections.Counter()  # how often each target may be begun
        self.dropped = set()

    async def start(self):
        """Start the server; returns what it says of the tasks before."""
        robot = ["--robot", "tests.faults.notebook_robot:NotebookRobot", "--speed", "20"]
        options = ["--db", str(self.db), "--log-level", "error", "--settle", "0", *robot]
        self.process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", self.program, *options),
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT), "NOTEBOOK": str(self.notebook.path)},
            stderr=subprocess.PIPE,
        )
        said = [await self.process.stderr.readline()]
        while said[-1] and b"ready" not in said[-1]:
            said.append(await self.process.stderr.readline())
        assert said[-1], "the server did not start"
        return b"".join(said).decode()

    async def kill_in_mid_task(self):
        """Kill it while the robot drives; returns the target to which it drove."""
        while True:
            while self.notebook.in_hand() is None:
                await asyncio.sleep(0.005)
            await asyncio.sleep(self.chance.uniform(0.0, 0.15))
            if self.notebook.in_hand():
                break
        self.process.kill()
        await self.process.wait()
        self.counts["kills"] += 1
        return self.notebook.in_hand()

    async def run(self, kills):
        await self.start()
        async with taskrpc.Node("user") as self.node:
            for each in range(kills):
                await self.submit(2)
                target = await self.kill_in_mid_task()
                said = await self.start()
                if target is None:  # it ended in the last moment
                    self.counts["ended as it was killed"] += 1
                    continue
                await self.decide(target, said, requeue=each % 2 == 0)
            await self.judge()

    async def call(self, service, name, **fields):
        client = self.node.create_client(service, name, timeout=30)
        return await client.call(service.Request(**fields), retry=taskrpc.RetryPolicy())

    async def submit(self, count):
        for _ in range(count):
            # One after the other at two ends of a corridor, so that each drive takes a while.
            number = len(self.allowed)
            target = f"{3 + number % 2 * 3},{4 - number / 100000:.5f}"
            self.allowed[target] = 1
            answer = await self.call(
                RobotTask, "/robot_task", task_type="move", target=target, priority=5
            )
            assert answer.success, answer.message

    async def tasks(self):
        """All tasks by their targets."""
        found, page = {}, ""
        while True:
            answer = await self.call(ListTasks, "/robot_task/list", all=True, page=page)
            found |= {task.target: task for task in answer.tasks}
            page = answer.next_page
            if not page:
                return found

    async def decide(self, target, said, *, requeue):
        """Look at what was interrupted, and have it run again or give it up."""
        task = (await self.tasks())[target]
        if task.state != "INTERRUPTED":
            self.counts["not interrupted"] += 1
            return
        self.counts["interrupted"] += 1
        self.counts["not told"] += f"task {task.task_id} was interrupted" not in said
        service, verb = (RequeueTask, "requeue") if requeue else (DropTask, "drop")
        answer = await self.call(service, f"/robot_task/{verb}", task_id=task.task_id)
        self.counts[f"{verb} refused"] += not answer.success
        self.allowed[target] += requeue
        self.dropped.update(() if requeue else [target])

    async def judge(self):
        while any(task.state in {"QUEUED", "RUNNING"} for task in (await self.tasks()).values()):
            await asyncio.sleep(0.1)
        runs = self.notebook.runs()
        self.counts["run again"] = sum((runs - self.allowed).values())
        tasks = await self.tasks()
        for target in self.allowed:
            state = "CANCELED" if target in self.dropped else "SUCCEEDED"
            self.counts["not as decided"] += tasks[target].state != state


BROKEN = ("not interrupted", "not told", "requeue refused", "drop refused", "run again")


@pytest.fixture
def rehearse(tmp_path, monkeypatch, counts, seed):
    """Kill a server, with a bug or without, so many times in the middle of tasks."""
    for name, variable in (("run", "XDG_RUNTIME_DIR"), ("state", "XDG_STATE_HOME")):
        (tmp_path / name).mkdir(mode=0o700)
        monkeypatch.setenv(variable, str(tmp_path / name))

    async def rehearsed(kills, patch=""):
        rehearsal = Rehearsal(tmp_path, counts, seed, patch)
        try:
            await asyncio.wait_for(rehearsal.run(kills), 60 + 10 * kills)
        finally:
            if rehearsal.process.returncode is None:
                rehearsal.process.kill()
                await rehearsal.process.wait()

    return rehearsed


async def test_what_ran_when_the_server_died_waits_for_a_decision(rehearse, counts, large):
    kills = 1000 if large else 8
    await rehearse(kills)
    counts.require(kills=kills, interrupted=kills // 2)
    assert counts.broken(*BROKEN, "not as decided") == {}


async def test_a_server_that_runs_it_again_is_found_out(rehearse, counts):
    await rehearse(4, RUN_AGAIN)
    assert counts.broken("run again")
    assert counts.broken("not interrupted")
