"""A task changes its state only as the table allows."""

import itertools

import msgspec
import pytest

from taskrpc.robot.tasks.model import BEGUN, DECISIONS, TRANSITIONS, Task, TaskState


def make(**changes):
    fields = {
        "task_id": 1,
        "task_type": "move",
        "target": "dock",
        "priority": 5,
        "arrival": 1,
        "submitted_at": 10.0,
    }
    return Task(**(fields | changes))


def test_task_keeps_the_newest_decisions_and_a_repeated_one_once():
    task = make()
    for number in range(DECISIONS + 3):
        task = task.decided(float(number), "ann", f"moved to priority {number}")
    assert [each.at for each in task.decisions] == [float(each) for each in range(3, DECISIONS + 3)]
    again = task.decided(99.0, "ann", f"moved to priority {DECISIONS + 2}")
    assert again.with_decisions(*task.decisions) == task
    assert again.decided(100.0, "ben", "cancelled").decisions[-1].client == "ben"


@pytest.mark.parametrize(("old", "new"), list(itertools.product(TaskState, TaskState)))
def test_a_move_that_the_table_does_not_name_is_refused(old, new):
    task = make(state=old)
    if new in TRANSITIONS[old]:
        assert task.moved_to(new).state is new
    else:
        with pytest.raises(ValueError, match=f"task 1 is {old.value} and cannot become"):
            task.moved_to(new)


def test_every_state_can_be_reached_and_every_state_but_success_can_be_left():
    assert set().union(*TRANSITIONS.values()) == set(TaskState)
    assert {state for state, moves in TRANSITIONS.items() if not moves} == {TaskState.SUCCEEDED}


def test_each_state_is_queued_begun_or_ended():
    for state in TaskState:
        assert [state is TaskState.QUEUED, state in BEGUN, state.is_ended].count(True) == 1


def test_higher_priority_runs_first_then_earlier_arrival():
    tasks = [make(priority=p, arrival=a) for p, a in [(5, 2), (9, 3), (5, 1), (1, 0)]]
    in_order = sorted(tasks, key=lambda task: task.order_key)
    assert [(task.priority, task.arrival) for task in in_order] == [(9, 3), (5, 1), (5, 2), (1, 0)]


def test_requeued_task_forgets_its_first_execution():
    failed = make().started(11.0).ended(TaskState.FAILED, 12.0, message="wheel lost")
    assert (failed.started_at, failed.ended_at, failed.message) == (11.0, 12.0, "wheel lost")
    assert failed.requeued(20.0, arrival=9) == make(submitted_at=20.0, arrival=9)


def test_success_sets_full_progress_and_cancel_keeps_progress():
    running = msgspec.structs.replace(make().started(11.0), progress=0.4)
    assert running.ended(TaskState.SUCCEEDED, 12.0, result="{}").progress == 1.0
    assert running.ended(TaskState.CANCELED, 12.0).progress == 0.4


def test_a_task_survives_its_way_through_json():
    task = make(state=TaskState.PAUSED, started_at=1.5, client="ü")
    assert msgspec.json.decode(msgspec.json.encode(task), type=Task) == task
