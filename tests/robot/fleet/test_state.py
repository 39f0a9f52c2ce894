import msgspec
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.request_ids.ids import Completion
from taskrpc.robot.fleet.model import Meta
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.history import History
from tests.robot.fleet.fakes import robot, state_of, task


def ids(tasks):
    return [each.task_id for each in tasks]


def picture(state):
    """All that a state says about its tasks and robots."""
    return (
        state.meta,
        dict(state.tasks),
        dict(state.robots),
        ids(state.queued()),
        sorted(state.begun),
        sorted(state.interrupted),
        sorted(ids(state.ended())),
    )


def test_queue_is_in_the_order_of_execution():
    state = state_of(task(1, priority=1), task(2, priority=9), task(3, priority=9))
    assert ids(state.queued()) == [2, 3, 1]
    assert [state.position(each) for each in state.queued()] == [0, 1, 2]
    assert ids(state.queued(after=(-9, 2))) == [3, 1]
    assert state.queued_at(2).task_id == 1
    assert state.queued_at(3) is None


def test_task_is_in_the_list_of_its_state():
    state = state_of(task(1))
    running = task(1).started(5.0)
    state.put_task(running)
    assert (len(state), list(state.begun)) == (0, [1])
    state.put_task(running.ended(TaskState.INTERRUPTED, 6.0))
    assert (list(state.begun), list(state.interrupted)) == ([], [1])


def test_oldest_ended_tasks_are_forgotten():
    state = FleetState(history=History(count=2))
    for number in range(1, 5):
        state.put_task(task(number).ended(TaskState.CANCELED, float(number)))
    assert ids(state.ended()) == [4, 3]
    assert state.changes.tasks[1] is None


def test_undo_goes_back_to_a_mark_and_keeps_what_was_before():
    state = state_of(task(1))
    state.put_task(task(2))
    mark = state.mark()
    state.put_task(msgspec.structs.replace(task(2), priority=9))
    state.put_robot(robot("a"))
    state.undo(mark)
    assert state.changes.tasks == {2: task(2)}
    assert state.changes.robots == {}
    state.undo()
    assert ids(state.queued()) == [1]
    assert state.changes.is_empty


def test_completion_that_is_undone_is_not_written():
    state = FleetState()
    state.put_task(task(1))
    mark = state.mark()
    state.complete(Completion("", b"c" * 16, 1, 1, b"", b"", 0, 1.0))
    state.undo(mark)
    assert state.changes.completions == []


def test_rows_of_the_database_replace_the_copy():
    state = state_of(task(1), robot("a"))
    ended = task(1).ended(TaskState.CANCELED, 2.0)
    changed = state.replace(Meta(revision=7), [ended, task(2)], [robot("b")])
    assert changed == [1, 2]
    assert (state.meta.revision, ids(state.queued()), sorted(state.robots)) == (7, [2], ["a", "b"])
    assert state.replace(Meta(revision=8), [task(2)], []) == []


def test_plan_version_grows_unless_a_task_is_added_behind_all_others():
    state = state_of(task(1), robot("a"))
    before = state.plan_version
    state.put_task(task(2))
    state.put_task(msgspec.structs.replace(task(2), accepted_estimate=3.0))
    assert state.plan_version == before
    for change in (
        lambda: state.put_task(task(3, priority=9)),
        lambda: state.put_task(task(1).started(1.0)),
        lambda: state.put_robot(robot("a", 5)),
    ):
        before = state.plan_version
        change()
        assert state.plan_version > before


@st.composite
def steps(draw):
    number = draw(st.integers(1, 5))
    made = task(number, priority=draw(st.integers(1, 3)), arrival=draw(st.integers(1, 5)))
    kind = draw(st.sampled_from(["queue", "run", "end", "interrupt", "forget", "robot", "meta"]))
    return kind, made


def carry_out(state, kind, made):
    if kind == "queue":
        state.put_task(made)
    elif kind == "run":
        state.put_task(made.started(1.0))
    elif kind == "end":
        state.put_task(made.ended(TaskState.CANCELED, 1.0))
    elif kind == "interrupt":
        state.put_task(made.started(1.0).ended(TaskState.INTERRUPTED, 2.0))
    elif kind == "forget" and made.task_id in state.tasks:
        state.forget_task(made.task_id)
    elif kind == "robot":
        state.put_robot(robot(f"r{made.task_id}", made.priority))
    elif kind == "meta":
        state.set_meta(paused=not state.meta.paused)


@given(before=st.lists(steps()), after=st.lists(steps()), more=st.lists(steps()))
def test_undone_transaction_leaves_no_trace(before, after, more):
    state = FleetState(history=History(count=3))
    for step in before:
        carry_out(state, *step)
    state.take_changes()
    first = picture(state)
    for step in after:
        carry_out(state, *step)
    mark, second = state.mark(), picture(state)
    for step in more:
        carry_out(state, *step)
    state.undo(mark)
    assert picture(state) == second
    state.undo()
    assert picture(state) == first
    assert [each.task_id for each in state.queued()] == [
        each.task_id
        for each in sorted(state.queued(), key=lambda each: (each.order_key, each.task_id))
    ]


def test_plan_of_forgotten_tasks_is_invalid():
    state = state_of(task(1), robot("a"))
    before = state.plan_version
    state.forget_all()
    assert state.plan_version > before
    assert not state.tasks
