from taskrpc.tasks.model import Task, TaskState
from taskrpc.tasks.responses import (
    Resumed,
    queue_full,
    refused,
    requeue_refusal,
    share_full,
    task_queued,
    unknown_type,
)


def task(state=TaskState.QUEUED):
    return Task(
        task_id=7,
        task_type="scan",
        target="1",
        priority=5,
        arrival=7,
        submitted_at=0.0,
        state=state,
    )


def test_response_to_a_submission_says_what_the_task_waits_for():
    assert task_queued(task(), 3.0, paused=False).message == "Task queued: scan"
    assert (
        task_queued(task(), 3.0, paused=True).message == "Task queued: scan (the queue is paused)"
    )
    both = task_queued(task(), 3.0, paused=True, note="waits for r2")
    assert both.message == "Task queued: scan (waits for r2; the queue is paused)"
    assert (both.task_id, both.estimated_time) == (7, 3.0)


def test_task_is_queued_again_only_after_its_end():
    assert requeue_refusal(task(TaskState.FAILED), 7, resume=False) is None
    assert requeue_refusal(task(TaskState.INTERRUPTED), 7, resume=True) is None
    running = requeue_refusal(task(TaskState.RUNNING), 7, resume=False)
    assert running.message.startswith("Task 7 is RUNNING: only an interrupted, failed or")
    failed = requeue_refusal(task(TaskState.FAILED), 7, resume=True)
    assert failed.message.endswith("taskrpc task requeue 7 runs it again")
    assert requeue_refusal(None, 8, resume=False) == refused(None, 8, "")


def test_refusals_say_what_was_expected_and_received():
    assert refused(None, 8, "").message == "There is no task 8"
    assert unknown_type("fly\n", ["move", "scan", "x"]) == (
        "Invalid task: fly? (expected move, scan or x)"
    )
    assert queue_full(10, 10) == "Queue full (waiting: 10, limit: 10)"
    assert share_full("ann", "10.0.0.7", 3, 3) == (
        "Share full: ann at 10.0.0.7 (waiting: 3, limit for one account: 3)"
    )


def test_server_that_starts_names_what_waits_for_a_decision():
    text = str(Resumed(2, (3,), paused=True))
    assert text.startswith("resumed 2 queued tasks; task 3 was interrupted (decide with ")
    assert text.endswith("the queue is still paused (taskrpc task resume continues it)")
