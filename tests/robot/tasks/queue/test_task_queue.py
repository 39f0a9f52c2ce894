"""The queue agrees with a sorted list about order and times after every operation."""

import asyncio
import gc
import itertools
import tracemalloc

import hypothesis.strategies as st
import msgspec
import pytest
from hypothesis import settings
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.queue.task_queue import TaskQueue
from tests.properties import examples

HOME = Pose(0.0, 0.0, 0.0)


def journey(task, start):
    """Plan a drive along x to the target; the heading at its end depends on the start."""
    x = float(task.target)
    theta = start.theta if x == start.x else (1.0 if x > start.x else -1.0)
    turn = abs(theta - start.theta)
    return Plan(abs(x - start.x) + turn + 1.0, Pose(x, 0.0, theta))


def make(number, priority=5, target="1"):
    return Task(
        task_id=number,
        task_type="move",
        target=target,
        priority=priority,
        arrival=number,
        submitted_at=0.0,
    )


def first(queue):
    """Return the task that `get` returns, without an event loop."""
    assert len(queue) > 0
    with pytest.raises(StopIteration) as returned:
        queue.get().send(None)
    return returned.value.value


def drain(queue):
    ids = []
    while len(queue):
        task = first(queue)
        queue.begin(task)
        ids.append(task.task_id)
    return ids


def model_walk(tasks, base):
    """Compute the schedule with a sorted list."""
    rows, seconds, pose = [], 0.0, base
    for task in sorted(tasks, key=lambda task: (-task.priority, task.arrival)):
        plan = journey(task, pose)
        seconds, pose = seconds + plan.seconds, plan.end
        rows.append((task, pytest.approx(seconds)))
    return rows


class QueueAgainstSortedList(RuleBasedStateMachine):
    """Random puts, gets, removals and moves, checked after each step."""

    waiting = Bundle("waiting")

    def __init__(self):
        super().__init__()
        self.queue = TaskQueue(journey, HOME)
        self.model = {}
        self.base = HOME
        self.numbers = itertools.count(1)

    @rule(target=waiting, priority=st.integers(1, 10), x=st.integers(0, 3))
    def put(self, priority, x):
        task = make(next(self.numbers), priority, str(x))
        expected = self.queue.seconds_with(task)
        self.shifted(lambda: self.queue.put(task))
        assert self.queue.seconds_through(task) == pytest.approx(expected)
        self.model[task.task_id] = task
        return task.task_id

    @rule(task_id=consumes(waiting))
    def remove(self, task_id):
        if task_id not in self.model:
            with pytest.raises(KeyError):
                self.queue.remove(task_id)
            return
        del self.model[task_id]
        self.shifted(lambda: self.queue.remove(task_id))

    @rule(task_id=waiting, priority=st.integers(1, 10))
    def rerank(self, task_id, priority):
        if task_id in self.model:
            self.queue.reprioritise(task_id, priority)
            task = msgspec.structs.replace(self.model[task_id], priority=priority)
            self.model[task_id] = task

    @rule(keep=st.booleans())
    def get(self, keep):
        if not self.model:
            return
        task = first(self.queue)
        assert task == min(self.model.values(), key=lambda task: task.order_key)
        if not keep:
            self.queue.put_back(task)
            return
        plan = journey(task, self.base)
        assert self.queue.begin(task) == plan
        self.base = plan.end
        del self.model[task.task_id]

    @rule(x=st.integers(0, 3), theta=st.sampled_from([-1.0, 0.0, 1.0]))
    def rebase(self, x, theta):
        self.base = Pose(float(x), 0.0, theta)
        self.shifted(lambda: self.queue.set_start_pose(self.base))

    def shifted(self, change):
        """Check that the shifts of a change are the new times of the tasks behind."""
        before = {task.task_id: seconds for task, seconds in self.queue.ordered()}
        shifts = change()
        for task, seconds in self.queue.ordered():
            if task.task_id in before:
                said = sum(shift.seconds for shift in shifts if shift.after < task.order_key)
                assert seconds - before[task.task_id] == pytest.approx(said, abs=1e-9)

    @invariant()
    def order_and_times_agree(self):
        assert len(self.queue) == len(self.model)
        assert list(self.queue.ordered()) == model_walk(self.model.values(), self.base)
        for task, seconds in self.queue.ordered():
            assert self.queue.seconds_through(task) == pytest.approx(seconds)
            assert task.task_id in self.queue
            assert self.queue.find(task.task_id) == task


TestQueueAgainstSortedList = QueueAgainstSortedList.TestCase
TestQueueAgainstSortedList.settings = settings(max_examples=examples(60), stateful_step_count=30)


async def test_equals_run_in_the_order_of_their_arrival():
    queue = TaskQueue(journey, HOME)
    for number, priority in enumerate([5, 9, 5, 1, 9, 5], start=1):
        queue.put(make(number, priority))
    assert drain(queue) == [2, 5, 1, 3, 6, 4]


async def test_get_waits_for_the_first_task():
    queue = TaskQueue(journey, HOME)
    getter = asyncio.ensure_future(queue.get())
    await asyncio.sleep(1)
    assert not getter.done()
    queue.put(make(1))
    assert (await getter).task_id == 1


async def test_get_skips_cancelled_tasks_and_returns_moved_tasks_once():
    queue = TaskQueue(journey, HOME)
    for number in range(1, 5):
        queue.put(make(number))
    queue.remove(1)
    queue.reprioritise(4, 10)
    queue.reprioritise(4, 2)
    assert drain(queue) == [2, 3, 4]
    getter = asyncio.ensure_future(queue.get())
    await asyncio.sleep(1)
    assert not getter.done(), "get returned a tombstone"
    getter.cancel()


async def test_a_task_put_back_stands_before_its_equals_again():
    queue = TaskQueue(journey, HOME)
    for number in range(1, 4):
        queue.put(make(number))
    task = await queue.get()
    queue.put(make(4))
    queue.put_back(task)
    assert drain(queue) == [1, 2, 3, 4]


async def test_a_page_begins_behind_any_key_also_of_a_task_that_has_gone():
    queue = TaskQueue(journey, HOME)
    tasks = [make(number, priority=1 + number % 3) for number in range(1, 31)]
    for task in tasks:
        queue.put(task)
    rows = list(queue.ordered())
    for place, (task, _) in enumerate(rows):
        assert list(queue.ordered(after=task.order_key)) == rows[place + 1 :]
    gone, _ = rows[12]
    queue.remove(gone.task_id)
    behind = [task.task_id for task, _ in queue.ordered(after=gone.order_key)]
    assert behind == [task.task_id for task, _ in rows[13:]]


async def test_queued_task_cannot_be_queued_again():
    queue = TaskQueue(journey, HOME)
    queue.put(make(1))
    with pytest.raises(ValueError, match="task 1 is queued already"):
        queue.put(make(1, priority=9))


async def test_cancelled_tasks_leave_nothing_behind():
    queue = TaskQueue(journey, HOME)
    queue.put(make(1, priority=1))
    for number in range(2, 5_000):
        queue.put(make(number))
        queue.remove(number)
    assert queue._heap.qsize() <= 2


def test_amended_task_is_listed_as_it_is_now():
    queue = TaskQueue(journey, HOME)
    queue.put(make(1))
    amended = msgspec.structs.replace(make(1), message="amended")
    queue.replace(amended)
    assert [task for task, _ in queue.ordered()] == [amended]
    assert queue.find(1) == first(queue) == amended


def test_task_that_was_handed_out_can_be_removed():
    queue = TaskQueue(journey, HOME)
    queue.put(make(1))
    assert first(queue).task_id == 1
    queue.remove(1)
    assert len(queue) == 0
    with pytest.raises(KeyError):
        queue.remove(1)


def test_tasks_that_ran_leave_nothing_behind_in_the_queue():
    queue = TaskQueue(journey, HOME)

    def run(numbers):
        for number in numbers:
            queue.put(make(number))
            queue.begin(first(queue))

    run(range(1, 1_000))
    tracemalloc.start()
    try:
        run(range(1_000, 3_000))
        gc.collect()
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 200_000, "a hundred bytes a task"


def test_waiting_tasks_are_counted_by_account_and_machine():
    queue = TaskQueue(journey, HOME)
    callers = [("ann", "a"), ("ann", "b"), ("bob", "a"), ("ann", "a")]
    for number, (client, machine) in enumerate(callers, 1):
        queue.put(msgspec.structs.replace(make(number), client=client, machine=machine))
    counts = [queue.count_waiting(*who) for who in (("ann", "a"), ("ann", "b"), ("bob", "b"))]
    assert counts == [2, 1, 0]
