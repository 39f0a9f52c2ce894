import msgspec
import pytest

from taskrpc.robot.tasks import rules
from taskrpc.robot.tasks.model import ClientDecision, Task, TaskState
from taskrpc.robot.tasks.responses import TaskResponse

ENDED = [state for state in TaskState if state.is_ended]
BEGUN = [state for state in TaskState if state not in (TaskState.QUEUED, *ENDED)]


def task(state=TaskState.QUEUED, **fields):
    known = {"task_type": "scan", "target": "1", "priority": 5, "arrival": 3, "submitted_at": 0.0}
    return Task(task_id=7, state=state, **(known | fields))


class Queue:
    """So many tasks, all of one account at one machine."""

    def __init__(self, waiting, account="", machine=""):
        self._waiting = waiting
        self._submitter = account, machine

    def __len__(self):
        return self._waiting

    def count_waiting(self, account, machine):
        return self._waiting if (account, machine) == self._submitter else 0


def refusal(*, unable="", priority=5, queue=None, limit=3, **share):
    return rules.refusal(unable, priority, queue or Queue(2), limit, **share)


# Refusals


@pytest.mark.parametrize(
    ("request_", "problem"),
    [
        ({}, ""),
        ({"priority": 1}, ""),
        ({"priority": 10}, ""),
        ({"unable": "no robot", "priority": 0}, "no robot"),
        ({"priority": 0, "limit": 2}, "Invalid priority: 0"),
        ({"priority": 11}, "Invalid priority: 11"),
        ({"limit": 2}, "Queue full (waiting: 2, limit: 2)"),
        ({"limit": 1}, "Queue full (waiting: 2, limit: 1)"),
    ],
)
def test_task_is_refused_for_the_first_of_several_reasons(request_, problem):
    found = refusal(**request_)
    assert found.startswith(problem)
    assert bool(found) == bool(problem)


def test_account_has_its_share_on_each_machine():
    full = {"queue": Queue(2, "ann", "10.0.0.7"), "share": 2, "account": "ann"}
    text = "Share full: ann at 10.0.0.7 (waiting: 2, limit for one account: 2)"
    assert refusal(**full, machine="10.0.0.7") == text
    assert refusal(**full, machine="10.0.0.8") == ""
    assert refusal(**(full | {"share": 3}), machine="10.0.0.7") == ""
    assert refusal(**(full | {"share": None}), machine="10.0.0.7") == ""


def test_share_of_a_caller_without_an_account_is_not_limited():
    assert refusal(queue=Queue(2), share=1) == ""


# Cancel and drop


@pytest.mark.parametrize(("rule", "verb"), [(rules.cancel, "cancelled"), (rules.drop, "dropped")])
def test_queued_task_is_cancelled_with_the_client_as_reason(rule, verb):
    decision = rule(task(), 7, 9.0, "ann")
    assert decision.message == "Task 7 was cancelled"
    ended = decision.task
    assert (ended.state, ended.ended_at) == (TaskState.CANCELED, 9.0)
    assert ended.message == f"{verb} by ann"
    assert ended.decisions == (ClientDecision(9.0, "ann", verb),)


@pytest.mark.parametrize("state", BEGUN)
def test_robot_must_halt_when_its_task_is_cancelled(state):
    before = task(state, message="the first reason")
    decision = rules.cancel(before, 7, 9.0, "ann")
    assert isinstance(decision, rules.Halt)
    first = state is TaskState.CANCELING
    message = "the first reason" if first else "cancelled by ann"
    after = msgspec.structs.replace(before, state=TaskState.CANCELING, message=message)
    assert decision.task == (after if first else after.decided(9.0, "ann", "cancelled"))


@pytest.mark.parametrize("state", BEGUN)
def test_task_that_has_begun_is_not_dropped(state):
    decision = rules.drop(task(state), 7, 9.0, "ann")
    rule = "only a queued or interrupted task can be dropped"
    assert decision == TaskResponse(False, f"Task 7 is {state.value}: {rule}")


@pytest.mark.parametrize("state", ENDED)
def test_ended_task_is_not_cancelled_again(state):
    decision = rules.cancel(task(state), 7, 9.0, "ann")
    if state is TaskState.CANCELED:
        assert decision == TaskResponse(True, "Task 7 is cancelled already", 7)
    else:
        text = f"Task 7 is {state.value}: cannot be cancelled any more"
        assert decision == TaskResponse(False, text)


@pytest.mark.parametrize("state", ENDED)
def test_of_the_ended_tasks_only_an_interrupted_one_is_dropped(state):
    decision = rules.drop(task(state, ended_at=1.0), 7, 9.0, "")
    if state is TaskState.INTERRUPTED:
        assert decision.message == "Task 7 was dropped"
        assert (decision.task.state, decision.task.ended_at) == (TaskState.CANCELED, 9.0)
        assert decision.task.message == "dropped"
    else:
        dropped = TaskResponse(True, "Task 7 is dropped already", 7)
        rule = "only a queued or interrupted task can be dropped"
        refused = TaskResponse(False, f"Task 7 is {state.value}: {rule}")
        assert decision == (dropped if state is TaskState.CANCELED else refused)


@pytest.mark.parametrize(
    ("state", "is_over", "success", "message"),
    [
        (TaskState.CANCELED, True, True, "Task 7 was cancelled"),
        (TaskState.CANCELING, False, True, "Task 7 is being cancelled"),
        (TaskState.QUEUED, False, True, "Task 7 is being cancelled"),
        (TaskState.SUCCEEDED, True, False, "Task 7 is SUCCEEDED: cannot be cancelled any more"),
        (TaskState.QUEUED, True, False, "Task 7 is QUEUED: cannot be cancelled any more"),
    ],
)
def test_response_to_a_cancel_says_whether_the_robot_has_halted(state, is_over, success, message):
    response = rules.halted(task(state), is_over=is_over)
    assert response == TaskResponse(success, message, 7 if success else -1)


# Reprioritise


def test_queued_task_gets_another_priority_and_keeps_its_arrival():
    decision = rules.reprioritise(task(), 7, 9, 4.0, "ann")
    moved = task(priority=9).decided(4.0, "ann", "moved to priority 9")
    assert decision == rules.Change(moved, "Task 7 has priority 9")


@pytest.mark.parametrize("state", [*BEGUN, *ENDED])
def test_only_a_queued_task_is_moved(state):
    text = f"Task 7 is {state.value}: only a queued task can be moved"
    assert rules.reprioritise(task(state), 7, 9, 4.0, "ann") == TaskResponse(False, text)


@pytest.mark.parametrize("priority", [0, 11])
def test_wrong_priority_is_refused_before_the_task_is_looked_at(priority):
    response = rules.reprioritise(None, 7, priority, 4.0, "ann")
    assert response.success is False
    assert response.message.startswith(f"Invalid priority: {priority}")


# Requeue


def requeue(state, *, resume=False, problem=""):
    def refusal(refused):
        assert refused == task(state)
        return problem

    return rules.requeue(task(state), 7, 4.0, "ann", resume=resume, refusal=refusal)


@pytest.mark.parametrize("resume", [False, True])
def test_queued_task_is_not_queued_again(resume):
    already = TaskResponse(True, "Task 7 is queued already", 7)
    assert requeue(TaskState.QUEUED, resume=resume, problem="Queue full") == already


@pytest.mark.parametrize("state", [TaskState.FAILED, TaskState.CANCELED, TaskState.INTERRUPTED])
def test_ended_task_is_queued_again_unless_it_is_refused(state):
    decided = task(state).decided(4.0, "ann", "queued again")
    assert requeue(state) == rules.Enqueue(decided, keeps_arrival=False)
    assert requeue(state, problem="Queue full") == TaskResponse(False, "Queue full")


def test_only_an_interrupted_task_gets_its_old_place():
    decided = task(TaskState.INTERRUPTED).decided(4.0, "ann", "resumed")
    assert requeue(decided.state, resume=True) == rules.Enqueue(decided, keeps_arrival=True)
    for state in (TaskState.FAILED, TaskState.CANCELED):
        refused = requeue(state, resume=True)
        assert refused.message == (
            f"Task 7 is {state.value}: only an interrupted task can be resumed;"
            " taskrpc task requeue 7 runs it again"
        )


@pytest.mark.parametrize("state", [*BEGUN, TaskState.SUCCEEDED])
@pytest.mark.parametrize("resume", [False, True])
def test_task_that_runs_or_has_succeeded_is_not_queued_again(state, resume):
    rule = "only an interrupted, failed or cancelled task can be queued again"
    assert requeue(state, resume=resume) == TaskResponse(False, f"Task 7 is {state.value}: {rule}")


def test_unknown_task_is_refused_by_each_rule():
    assert {
        rules.cancel(None, 8, 0.0, "ann"),
        rules.drop(None, 8, 0.0, "ann"),
        rules.reprioritise(None, 8, 5, 0.0, "ann"),
        rules.requeue(None, 8, 0.0, "ann", resume=True, refusal=lambda _: ""),
    } == {TaskResponse(False, "There is no task 8")}
