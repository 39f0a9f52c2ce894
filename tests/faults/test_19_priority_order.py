"""Promise 19: the robot takes tasks by priority, first come first served among equals.

Meanwhile, clients submit, drop, move, pause and resume tasks at the same time.

Each history of the callers' requests and responses, and of the robot's starts, must be
linearizable: each request took effect at one instant between call and response, and at each
instant at which a task started it was the first of a plain sorted queue.
"""

import asyncio
import itertools
import logging
import random
from dataclasses import dataclass, field, replace

import pytest

from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.queue.task_queue import TaskQueue
from tests.faults.harness import Bug
from tests.faults.planted import begin_while_paused
from tests.robot.tasks.fakes import FullStore, LineRobot

pytestmark = pytest.mark.faults

KINDS = ("submit", "drop", "reprioritise", "pause", "resume")
WEIGHTS = (10, 2, 3, 1, 3)


def last_come_first_served(patch):
    patch(Task, "order_key", property(lambda task: (-task.priority, -task.arrival)))


def moves_only_in_the_list(patch):
    def moved(queue, task_id, priority):
        return []

    patch(TaskQueue, "reprioritise", moved)


@dataclass
class Operation:
    """An operation from its call to its response, or the start of a task."""

    kind: str
    argument: tuple
    called: int
    answered: int = 0
    told: tuple = ()
    """The response: the task's id, or whether the operation was done."""


@dataclass(frozen=True)
class Queue:
    """The model: queued tasks by (-priority, arrival), whether it is paused, the next arrival."""

    waiting: frozenset = field(default_factory=frozenset)
    """Of (-priority, arrival, task_id)."""
    paused: bool = False
    arrivals: int = 0
    dropped: frozenset = field(default_factory=frozenset)

    def after(self, operation):
        """The queue after this operation; None if its response is impossible here."""
        return getattr(self, operation.kind)(operation)

    def submit(self, operation):
        (priority,), (task_id,) = operation.argument, operation.told
        entry = (-priority, self.arrivals, task_id)
        return replace(self, waiting=self.waiting | {entry}, arrivals=self.arrivals + 1)

    def drop(self, operation):
        (task_id,), (done,) = operation.argument, operation.told
        entry = self._entry(task_id)
        if entry is None:
            # Dropping a dropped task again is allowed.
            return self if not done or task_id in self.dropped else None
        rest, dropped = self.waiting - {entry}, self.dropped | {task_id}
        return replace(self, waiting=rest, dropped=dropped) if done else None

    def reprioritise(self, operation):
        task_id, priority = operation.argument
        entry = self._entry(task_id)
        if (entry is not None) != operation.told[0]:
            return None
        if entry is None:
            return self
        return replace(self, waiting=self.waiting - {entry} | {(-priority, *entry[1:])})

    def pause(self, operation):
        return replace(self, paused=True)

    def resume(self, operation):
        return replace(self, paused=False)

    def begin(self, operation):
        if self.paused or not self.waiting or min(self.waiting)[2] != operation.argument[0]:
            return None
        return replace(self, waiting=self.waiting - {min(self.waiting)})

    def _entry(self, task_id):
        return next((entry for entry in self.waiting if entry[2] == task_id), None)


def is_linearizable(history, counts):
    """Whether an order of the operations fits that respects responses before later calls."""
    history = sorted(history, key=lambda each: each.called)
    tried = set()
    ways = [(frozenset(range(len(history))), Queue())]
    while ways:
        left, queue = ways.pop()
        if not left:
            return True
        if (left, queue) in tried:
            continue
        tried.add((left, queue))
        counts["states tried"] += 1
        first_answer = min(history[number].answered for number in left)
        for number in left:
            if history[number].called <= first_answer:
                after = queue.after(history[number])
                if after is not None:
                    ways.append((left - {number}, after))
    return False


class Recorder:
    """Calls the manager from several callers at once, and records the history."""

    def __init__(self, manager, robot, chance, counts):
        self.manager, self.chance, self.counts = manager, chance, counts
        self.history, self.submitted = [], []
        self._instants = itertools.count()
        self._free = 0
        self._execute, robot.execute = robot.execute, self._begun

    async def _begun(self, *arguments):
        # It was taken at some instant after the robot became free.
        task_id = self.manager.running.task_id
        began = Operation("begin", (task_id,), self._free, next(self._instants))
        self.history.append(began)
        self.counts["begin"] += 1
        try:
            return await self._execute(*arguments)
        finally:
            self._free = next(self._instants)

    async def caller(self, count):
        for _ in range(count):
            await asyncio.sleep(self.chance.choice([0, 0.001, 0.3, 1, 3]))
            await self._ask(self.chance.choices(KINDS, WEIGHTS)[0])

    async def _ask(self, kind):
        manager, called = self.manager, next(self._instants)
        argument = self._argument(kind)
        if kind == "submit":
            answer = await manager.submit("move", f"{self.chance.randrange(4)}", *argument)
            self.submitted.append(answer.task_id)
            told = (answer.task_id,)
        else:
            answer = await getattr(manager, kind)(*argument)
            told = (answer.success,)
        self.counts[kind] += 1
        self.history.append(Operation(kind, argument, called, next(self._instants), told))

    def _argument(self, kind):
        chance = self.chance
        task_id = chance.choice(self.submitted[-6:] or [1])
        priority = chance.choice([1, 5, 5, 9])
        kinds = {"submit": (priority,), "drop": (task_id,), "reprioritise": (task_id, priority)}
        return kinds.get(kind, ())


async def one_history(chance, counts):
    """Run four callers at once; returns whether the history is linearizable, and the history."""
    robot, store = LineRobot(speed=chance.choice([1, 5])), FullStore()
    store.delay = chance.choice([0, 0.01, 0.5])
    manager = TaskManager(robot, store, TaskSettings(settle=chance.choice([0, 0.1])))
    recorder = Recorder(manager, robot, chance, counts)
    await manager.start()
    await asyncio.gather(*[recorder.caller(8) for _ in range(4)])
    await recorder._ask("resume")
    await asyncio.sleep(1000)  # until all tasks are done
    counts["left behind"] += len(manager.queue)
    await manager.close()
    return is_linearizable(recorder.history, counts), recorder.history


@pytest.mark.planted(
    Bug(last_come_first_served, "not linearizable"),
    Bug(moves_only_in_the_list, "not linearizable"),
    Bug(begin_while_paused, "not linearizable"),
)
async def test_queue_histories_are_linearizable(counts, seed, large, caplog):
    caplog.set_level(logging.CRITICAL)
    for number in range(10_000 if large else 100):
        fits, history = await one_history(random.Random(f"{seed} {number}"), counts)
        counts["histories"] += 1
        if not fits:
            counts["not linearizable"] += 1
            print(f"history {number}:", *sorted(history, key=lambda each: each.called), sep="\n")
            break
    counts.check("not linearizable", "left behind", happened=(*KINDS, "begin"))
