"""Promise 18: a task that ran when the server died is INTERRUPTED, and never restarts silently.

The server is killed during tasks; the robot's own record shows what happened.
"""

import asyncio
import collections
import random

import msgspec
import pytest

import srvgen
import taskrpc
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.repository import TaskRepository
from taskrpc.robot.tasks.responses import Resumed
from tests.faults.harness import Bug
from tests.faults.programs import TASK_SERVER, kill

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
ListTasks = srvgen.load("taskrpc_interfaces/srv/ListTasks")
RequeueTask = srvgen.load("taskrpc_interfaces/srv/RequeueTask")
DropTask = srvgen.load("taskrpc_interfaces/srv/DropTask")
BROKEN = (
    "not interrupted",
    "not told",
    "requeue refused",
    "drop refused",
    "run again",
    "not as decided",
)


def runs_it_again(patch):
    open_book = TaskRepository.open

    def queued(task):
        return (
            msgspec.structs.replace(task, state=TaskState.QUEUED) if task.state.is_begun else task
        )

    async def reopened(book):
        return [queued(task) for task in await open_book(book)]

    patch(TaskRepository, "open", reopened)


def says_nothing_of_it(patch):
    patch(Resumed, "__str__", lambda resumed: f"resumed {resumed.queued} tasks")


class Notebook:
    """The robot's record."""

    def __init__(self, path):
        self.path = path

    def lines(self):
        return self.path.read_text().split("\n")[:-1] if self.path.exists() else []

    def runs(self):
        """How often the task of each target was started."""
        return collections.Counter(each[6:] for each in self.lines() if each.startswith("began"))

    def in_hand(self):
        """The target of the last started task, if it has not ended."""
        last = (self.lines() or [""])[-1]
        return last.removeprefix("began ") if last.startswith("began") else None


class Rehearsal:
    """A server that is killed during a task, and a user who decides about the task."""

    def __init__(self, folder, programs, counts, seed):
        self.db, self.notebook = folder / "tasks.db", Notebook(folder / "notebook")
        self.programs, self.counts, self.chance = programs, counts, random.Random(seed)
        self.allowed = collections.Counter()  # how often the task of each target may start
        self.dropped = set()

    async def start(self):
        """Start the server; returns its line about earlier tasks."""
        robot = ["--robot", "tests.faults.notebook_robot:NotebookRobot", "--speed", "20"]
        options = ["--db", str(self.db), "--log-level", "error", "--settle", "0", *robot]
        self.server = await self.programs.start(
            TASK_SERVER, *options, ready="taskrpc-server ready", name="server.py"
        )
        return self.programs.said

    async def kill_in_mid_task(self):
        """Kill it while the robot drives; returns the target of the drive."""
        while True:
            while self.notebook.in_hand() is None:
                await asyncio.sleep(0.005)
            await asyncio.sleep(self.chance.uniform(0.0, 0.15))
            if self.notebook.in_hand():
                break
        await kill(self.server)
        self.counts["kills"] += 1
        return self.notebook.in_hand()

    async def run(self, kills):
        await self.start()
        async with taskrpc.Node("user") as self.node:
            for each in range(kills):
                await self.submit(2 - self.to_come())
                target = await self.kill_in_mid_task()
                said = await self.start()
                if target is None:  # it ended just before the kill
                    self.counts["ended as it was killed"] += 1
                    continue
                await self.decide(target, said, requeue=each % 2 == 0)
                if self.counts.broken(*BROKEN):
                    break
            await self.judge()

    async def call(self, service, name, **fields):
        client = self.node.create_client(service, name, timeout=30)
        return await client.call(service.Request(**fields), retry=taskrpc.RetryPolicy())

    async def submit(self, count):
        for _ in range(count):
            # Alternately at the two ends of a corridor, so that each drive takes some time.
            number = len(self.allowed)
            target = f"{3 + number % 2 * 3},{4 - number / 100000:.5f}"
            self.allowed[target] = 1
            answer = await self.call(
                RobotTask, "/robot_task", task_type="move", target=target, priority=5
            )
            assert answer.success, answer.message

    def to_come(self):
        """The number of tasks that may still start."""
        return self.allowed.total() - self.notebook.runs().total()

    async def tasks(self):
        """All tasks by target."""
        found, page = {}, ""
        while True:
            answer = await self.call(ListTasks, "/robot_task/list", all=True, page=page)
            found |= {task.target: task for task in answer.tasks}
            page = answer.next_page
            if not page:
                return found

    async def decide(self, target, said, *, requeue):
        """Find the interrupted task, and requeue it or drop it."""
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


@pytest.mark.planted(Bug(runs_it_again, "run again"), Bug(says_nothing_of_it, "not told"))
async def test_task_that_ran_when_the_server_died_waits_for_a_decision(
    tmp_path, monkeypatch, programs, counts, seed, large
):
    kills = 1000 if large else 30
    rehearsal = Rehearsal(tmp_path, programs, counts, seed)
    monkeypatch.setenv("NOTEBOOK", str(rehearsal.notebook.path))
    await asyncio.wait_for(rehearsal.run(kills), 60 + 10 * kills)
    counts.check(*BROKEN, happened=("kills", "interrupted"))
    counts.require(kills=kills, interrupted=kills // 2)
