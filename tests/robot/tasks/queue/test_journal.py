"""A queue with a journal decides as one without, and each step can be repeated."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import RUNNING_KEY, Task
from taskrpc.robot.tasks.queue.estimated_queue import EstimatedQueue
from taskrpc.robot.tasks.queue.journal import JournaledQueue, QueueStart, QueueStep
from taskrpc.robot.tasks.queue.task_queue import TaskQueue

HOME = Pose(0.0, 0.0, 0.0)
steps = st.lists(
    st.tuples(
        st.sampled_from(["accept", "remove", "move", "begin", "free", "pose", "end"]),
        st.integers(0, 5),
        st.integers(1, 10),
    ),
    max_size=40,
)


def plan(task, start):
    end = Pose(float(task.target), 0.0, 0.0)
    return Plan(abs(end.x - start.x) + 1.0, end)


def take(queue, steps):
    """Apply steps to a queue; returns what it decided after each."""
    known, running, decided = [], False, []
    for number, (verb, which, priority) in enumerate(steps, 1):
        task_id = known[which % len(known)] if known else 0
        result = None
        match verb:
            case "accept":
                task = Task(
                    task_id=number,
                    task_type="move",
                    target=str(which),
                    priority=priority,
                    arrival=number,
                    submitted_at=0.0,
                )
                result = queue.accept(task, float(number)).accepted_estimate
                known.append(number)
            case "remove" if task_id:
                queue.remove(task_id, "was cancelled")
                known.remove(task_id)
            case "move" if task_id:
                queue.reprioritise(task_id, priority)
            case "begin" if known and not running:
                first = next(task for task, _ in queue.queue.ordered(RUNNING_KEY))
                result, running = queue.begin(first), True
                known.remove(first.task_id)
            case "free":
                queue.set_free_at(number + which / 3, lambda: "late")
            case "pose":
                queue.set_start_pose(Pose(which / 7, 0.0, 0.0), "moved")
            case "end" if running:
                result, running = queue.end(float(number)), False
        order = [(task.task_id, end) for task, end in queue.queue.ordered(RUNNING_KEY)]
        decided.append((result, order, queue.log.since(0), queue.seconds_ahead(0.0)))
    return decided


@given(steps)
def test_journal_changes_no_decision(steps):
    plain = EstimatedQueue(TaskQueue(plan, HOME), tolerance=0.005)
    journaled = JournaledQueue(plan, HOME, tolerance=0.005, journal=lambda step: None)
    assert take(journaled, steps) == take(plain, steps)


def test_journal_begins_with_the_empty_queue():
    journal = []
    JournaledQueue(plan, HOME, tolerance=0.005, journal=journal.append)
    assert journal == [QueueStart(HOME, 0.005)]


def test_reading_estimates_often_writes_nothing():
    journal = []
    queue = JournaledQueue(plan, HOME, tolerance=math.inf, journal=journal.append)
    for number in range(100):
        queue.set_free_at(float(number), lambda: "late")
        queue.set_start_pose(HOME, "moved")
    assert len(journal) == 1
    take(queue, [("accept", 3, 5)])
    assert [step.method for step in journal[1:] if isinstance(step, QueueStep)] == [
        "set_free_at",
        "accept",
    ]
    assert journal[1].seconds == 99.0


def test_step_has_the_plans_and_the_delays_that_it_caused():
    journal = []
    queue = JournaledQueue(plan, HOME, tolerance=0.005, journal=journal.append)
    take(queue, [("accept", 3, 5), ("accept", 1, 9)])
    step = journal[-1]
    assert [made.task_id for made in step.plans] == [2, 1]
    assert [delay.cause for delay in step.delays] == ["task 2, priority 9, went ahead"]
    assert [task_id for task_id, _ in step.next] == [2, 1]
    assert step.queued == 2
