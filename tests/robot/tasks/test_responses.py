from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.responses import (
    Resumed,
    TaskResponse,
    commanded,
    queue_full,
    queue_text,
    refused,
    share_full,
    stopped_note,
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


def test_response_to_a_stop_names_the_tasks_that_it_cancelled():
    canceled, running = task(TaskState.CANCELED), task(TaskState.RUNNING)
    assert stopped_note([canceled]) == (
        "; task 7 was cancelled (taskrpc task requeue 7 runs it again)"
    )
    assert stopped_note([running]) == "; task 7 is being cancelled"
    assert stopped_note([task(TaskState.SUCCEEDED), task(TaskState.INTERRUPTED)]) == ""
    more = "; 2 more are listed by taskrpc task list --all"
    assert stopped_note([running] * 5) == "; task 7 is being cancelled" * 3 + more


def test_response_to_a_command_says_why_the_robot_failed():
    assert commanded("The queue is paused", "") == TaskResponse(True, "The queue is paused")
    failed = commanded("The queue is paused", "the robot failed")
    assert failed == TaskResponse(False, "The queue is paused, but the robot failed")


def test_state_of_a_queue_is_one_sentence():
    assert queue_text(0, paused=False, interrupted=0) == "no tasks in the queue"
    assert queue_text(1, "1 robot", paused=True, interrupted=2) == (
        "1 task in the queue, 1 robot, the queue is paused,"
        " 2 interrupted tasks wait for a decision (taskrpc task list --all)"
    )


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
