"""Responses of the task manager, and how a new server resumes the tasks of an earlier one."""

import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.request_ids.ids import Completion
from taskrpc.errors import StoreError
from taskrpc.robot.protocol import TargetError
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.robot.tasks.responses import Resumed
from taskrpc.robot.tasks.services.pages import page
from taskrpc.testing import VirtualTimeLoop
from tests.properties import examples
from tests.robot.tasks.fakes import LineRobot


@pytest.fixture
async def manager():
    manager = TaskManager(LineRobot(), MemoryStore(), TaskSettings(queue_limit=20))
    await manager.start()
    yield manager
    await manager.close()


async def submit(manager, *rows):
    return [await manager.submit("move", target, priority) for target, priority in rows]


async def idle(manager):
    async with asyncio.timeout(10_000):
        while manager.queue or manager.running:
            await asyncio.sleep(1)


async def test_an_accepted_task_is_answered_with_its_number_and_time(manager):
    first, second = await submit(manager, ("3", 5), ("3", 5))
    assert (first.success, first.message, first.task_id) == (True, "Task queued: move", 1)
    # settle 0.1, turn 1, drive 3, work 1; the second only works
    assert first.estimated_time == pytest.approx(5.1)
    assert (second.task_id, second.estimated_time) == (2, pytest.approx(6.1))


async def test_preview_is_the_response_that_the_next_task_gets(manager):
    for target, priority in [("3", 5), ("5", 9), ("1", 5), ("4", 1), ("2", 10)]:
        expected = manager.preview("move", target, priority)
        response = await manager.submit("move", target, priority)
        assert expected.estimated_time == pytest.approx(response.estimated_time)
        assert (expected.success, expected.message) == (True, "Task would be queued: move")
    assert len(list(manager.repository.tasks())) == 5


async def test_preview_of_a_task_that_would_be_refused_has_the_refusal(manager):
    await manager.pause()
    assert (
        manager.preview("move", "1", 5).message
        == "Task would be queued: move (the queue is paused)"
    )
    for task in ("fly", "1", 5), ("move", "mars", 5), ("move", "1", 11):
        assert manager.preview(*task) == await manager.submit(*task)


async def test_settling_is_counted_in_the_robots_seconds():
    manager = TaskManager(LineRobot(speed=10.0), MemoryStore(), TaskSettings(settle=0.5))
    await manager.start()
    assert (await manager.submit("move", "0", 5)).estimated_time == pytest.approx(5.0 + 1.0)
    await manager.close()


@pytest.mark.parametrize(
    ("task_type", "target", "priority", "message"),
    [
        ("fly", "1", 5, "Invalid task: fly (expected move, scan or report)"),
        ("", "1", 5, "Invalid task:  (expected move, scan or report)"),
        ("move", "mars", 5, "Invalid target: expected a number, got 'mars'"),
        ("move", "1", 11, "Invalid priority: 11 (expected 1 to 10, 10 runs first)"),
        ("move", "1", 0, "Invalid priority: 0 (expected 1 to 10, 10 runs first)"),
        ("a\x1b[2J\nb", "1", 5, "Invalid task: a?[2J?b (expected move, scan or report)"),
        ("x" * 99, "1", 5, f"Invalid task: {'x' * 59}… (expected move, scan or report)"),
    ],
)
async def test_refusal_names_the_allowed_values_and_uses_no_id(
    manager, task_type, target, priority, message
):
    refused = await manager.submit(task_type, target, priority)
    assert (refused.success, refused.message) == (False, message)
    assert (refused.task_id, refused.estimated_time) == (-1, 0.0)
    assert [answer.task_id for answer in await submit(manager, ("1", 5))] == [1]


async def test_a_full_queue_refuses_and_takes_more_when_there_is_room(manager):
    await manager.pause()
    answers = await submit(manager, *[("1", 5)] * 21)
    assert [answer.success for answer in answers] == [True] * 20 + [False]
    assert answers[-1].message == "Queue full (waiting: 20, limit: 20)"
    await manager.cancel(7)
    assert [answer.task_id for answer in await submit(manager, ("1", 5))] == [21]


async def test_cancelling_answers_for_every_state(manager):
    await submit(manager, ("1", 5))
    await idle(manager)
    await manager.pause()
    await submit(manager, ("1", 5))
    messages = [(await manager.cancel(number)).message for number in (2, 2, 1, 99)]
    assert messages == [
        "Task 2 was cancelled",
        "Task 2 is cancelled already",
        "Task 1 is SUCCEEDED: cannot be cancelled any more",
        "There is no task 99",
    ]


def decided(manager, task_id):
    return [(each.client, each.action) for each in manager.repository.find(task_id).decisions]


async def test_each_task_has_the_decisions_of_clients_about_it(manager):
    await manager.pause()
    await submit(manager, ("1", 5), ("5", 5), ("9", 5))
    await manager.reprioritise(1, 9, client="ann")
    await manager.reprioritise(1, 9, client="ben")  # it has this priority already
    await manager.cancel(2, client="ben")
    await manager.requeue(2, client="ann")
    await manager.drop(3, client="cem")
    assert decided(manager, 1) == [("ann", "moved to priority 9")]
    assert decided(manager, 2) == [("ben", "cancelled"), ("ann", "queued again")]
    assert decided(manager, 3) == [("cem", "dropped")]


async def test_task_that_runs_keeps_its_decisions_and_gets_that_which_halts_it(manager):
    await manager.pause()
    await submit(manager, ("5", 5), ("9", 5))
    await manager.reprioritise(1, 9, client="ann")
    await manager.resume()
    await asyncio.sleep(2)
    assert manager.running.task_id == 1
    await manager.stop(client="dan")
    await manager.cancel(1, client="eve")  # too late
    assert decided(manager, 1) == [("ann", "moved to priority 9"), ("dan", "stopped")]
    await manager.resume()
    await asyncio.sleep(2)
    await manager.cancel(2, client="eve")
    assert decided(manager, 2) == [("eve", "cancelled")]
    await idle(manager)
    assert [task.decisions for task in (await manager.repository._store.load()).tasks] == [
        manager.repository.find(number).decisions for number in (1, 2)
    ]


async def test_reprioritising_moves_among_the_new_equals_by_age(manager):
    await manager.pause()
    await submit(manager, ("1", 5), ("2", 5), ("3", 8), ("4", 8))
    answer = await manager.reprioritise(2, 8)
    assert [row.task.task_id for row in page(manager, "").rows] == [2, 3, 4, 1]
    assert answer.message == "Task 2 has priority 8"
    assert answer.estimated_time == manager.estimate(2)
    refused = [(await manager.reprioritise(*pair)).message for pair in [(2, 0), (99, 5)]]
    assert refused == [
        "Invalid priority: 0 (expected 1 to 10, 10 runs first)",
        "There is no task 99",
    ]


async def test_a_cancelled_task_runs_again_under_its_number_behind_its_equals(manager):
    await manager.pause()
    await submit(manager, ("1", 5), ("2", 5), ("3", 5))
    await manager.cancel(1)
    answer = await manager.requeue(1)
    assert answer.message == "Task queued: move (the queue is paused)"
    assert answer.task_id == 1
    assert answer.estimated_time == pytest.approx(manager.estimate(1))
    assert [row.task.task_id for row in page(manager, "").rows] == [2, 3, 1]
    assert (await manager.requeue(1)).message == "Task 1 is queued already"
    await manager.resume()
    await idle(manager)
    assert (await manager.requeue(1)).message == (
        "Task 1 is SUCCEEDED: only an interrupted, failed or cancelled task can be queued again"
    )


@pytest.fixture(params=["memory", "sqlite"])
async def store(request, tmp_path):
    store = MemoryStore() if request.param == "memory" else SqliteStore(tmp_path / "tasks.db")
    yield store
    await store.close()


async def test_new_server_keeps_the_order_and_reports_interrupted_tasks(store):
    old = TaskManager(LineRobot(), store)
    await old.start()
    await submit(old, ("50", 5), ("1", 3), ("2", 9), ("3", 3))
    await asyncio.sleep(5)
    assert old.running.task_id == 1
    await old.reprioritise(4, 4)
    await old.close()
    robot = LineRobot()
    new = TaskManager(robot, store)
    resumed = await new.start()
    assert resumed == Resumed(queued=2, interrupted=(1,))
    assert str(resumed) == (
        "resumed 2 queued tasks; task 1 was interrupted"
        " (decide with taskrpc task resume 1, requeue 1 or drop 1)"
    )
    assert [row.task.task_id for row in page(new, "").rows] == [4, 2]
    await new.drop(1)
    await idle(new)
    assert [target for _, target in robot.log] == ["3", "1"], "and nothing runs twice"
    assert (await new.submit("move", "1", 5)).task_id == 5
    await new.close()


async def test_interrupted_task_resumes_before_or_requeues_behind_its_later_equals(store):
    old = TaskManager(LineRobot(), store)
    await old.start()
    await submit(old, ("50", 5), ("1", 5), ("2", 5))
    await asyncio.sleep(5)
    await old.pause()
    await old.close()
    new = TaskManager(LineRobot(), store)
    await new.start()
    assert (await new.requeue(2, resume=True)).message == "Task 2 is queued already"
    answer = await new.requeue(1, resume=True)
    assert answer.success
    assert answer.estimated_time == pytest.approx(new.estimate(1))
    assert [row.task.task_id for row in page(new, "").rows] == [1, 2, 3]
    await new.cancel(1)
    assert (await new.requeue(1, resume=True)).message == (
        "Task 1 is CANCELED: only an interrupted task can be resumed;"
        " taskrpc task requeue 1 runs it again"
    )
    await new.close()


@pytest.mark.parametrize("order", ["pause", "stop"])
async def test_a_queue_that_was_halted_stands_still_after_a_restart(store, order):
    old = TaskManager(LineRobot(), store)
    await old.start()
    await getattr(old, order)()
    await submit(old, ("1", 5))
    await old.close()
    robot = LineRobot()
    new = TaskManager(robot, store)
    assert await new.start() == Resumed(1, (), paused=True)
    await asyncio.sleep(60)
    assert robot.log == []
    await new.resume()
    await idle(new)
    assert [target for _, target in robot.log] == ["1"]
    await new.close()
    again = TaskManager(LineRobot(), store)
    assert not (await again.start()).paused
    await again.close()


@pytest.mark.parametrize("begun", [TaskState.RUNNING, TaskState.PAUSED, TaskState.CANCELING])
async def test_task_that_ran_when_the_server_was_killed_is_interrupted(begun):
    store = MemoryStore()
    old = TaskManager(LineRobot(), store)
    await old.start()
    await submit(old, ("50", 5))
    await asyncio.sleep(5)
    if begun is TaskState.PAUSED:
        await old.pause()
    elif begun is TaskState.CANCELING:
        old.repository._tasks[1] = old.repository.find(1).moved_to(begun)
        await store.apply([old.repository.find(1)])
    assert (await store.load()).tasks[0].state is begun
    new = TaskManager(LineRobot(), store)  # the old one is simply gone
    assert await new.start() == Resumed(0, (1,), paused=begun is TaskState.PAUSED)
    assert (await store.load()).tasks[0].state is TaskState.INTERRUPTED
    assert (await new.requeue(1)).success
    await new.resume()
    await idle(new)
    assert new.repository.find(1).state is TaskState.SUCCEEDED
    await new.close()
    await old.close()


async def test_accepted_estimate_survives_a_restart_that_is_named_as_cause():
    wall = 1000.0
    store = MemoryStore()
    old = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: wall))
    await old.start()
    await old.pause()
    await submit(old, ("50", 5), ("1", 5))
    promised = old.repository.find(2).accepted_estimate
    await old.close()
    wall += 60.0
    new = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: wall))
    await new.start()
    task = new.repository.find(2)
    assert task.accepted_estimate == promised
    (change,) = new.changes(task)
    assert change.cause == "the server was restarted"
    assert promised + change.seconds == pytest.approx(60.0 + new.estimate(2))
    await new.close()


async def test_resumed_tasks_do_not_delay_one_another():
    """Only the restart changes the estimates, for every order of the priorities."""
    wall = 1000.0
    store = MemoryStore()
    old = TaskManager(LineRobot(speed=4.0), store, TaskSettings(wall_clock=lambda: wall))
    await old.start()
    await old.pause()
    await submit(old, ("1", 3), ("20", 9), ("7", 3), ("40", 5))
    promised = {number: old.repository.find(number).accepted_estimate for number in range(1, 5)}
    await old.close()
    wall += 60.0
    robot = LineRobot(speed=4.0)
    new = TaskManager(robot, store, TaskSettings(wall_clock=lambda: wall))
    await new.start()
    for number in range(1, 5):
        task = new.repository.find(number)
        assert task.accepted_estimate == promised[number]
        (change,) = new.changes(task)
        assert change.cause == "the server was restarted"
        # 60 s on the wall are 240 s on the robot's clock.
        assert promised[number] + change.seconds == pytest.approx(240.0 + new.estimate(number))
    await new.resume()
    await idle(new)
    assert [target for _, target in robot.log] == ["20", "40", "1", "7"]
    assert {task.task_id: task.accepted_estimate for task in new.repository.ended()} == promised
    await new.close()


@pytest.mark.parametrize(
    ("resumed", "text"),
    [
        (Resumed(0, ()), "no earlier tasks wait"),
        (
            Resumed(2, (), paused=True),
            "resumed 2 queued tasks; the queue is still paused (taskrpc task resume continues it)",
        ),
        (Resumed(1, ()), "resumed 1 queued task"),
        (
            Resumed(0, (1, 2, 3, 4, 5)),
            "resumed no queued tasks"
            + "".join(
                f"; task {n} was interrupted"
                f" (decide with taskrpc task resume {n}, requeue {n} or drop {n})"
                for n in (1, 2, 3)
            )
            + "; 2 more were interrupted (taskrpc task list --all)",
        ),
    ],
)
def test_resumed_tasks_are_described_in_one_sentence(resumed, text):
    assert str(resumed) == text


async def test_a_robot_without_a_sensible_speed_is_refused():
    with pytest.raises(ValueError, match="expected a robot with a positive speed, got 0"):
        TaskManager(LineRobot(speed=0), MemoryStore())


async def test_submits_at_once_are_served_in_the_order_of_their_arrival(manager):
    answers = await asyncio.gather(*(manager.submit("move", "1", 5) for _ in range(10)))
    assert [answer.task_id for answer in answers] == list(range(1, 11))
    times = [answer.estimated_time for answer in answers]
    assert times == sorted(times)
    assert [row.task.task_id for row in page(manager, "").rows] == list(range(1, 11))


def completed(answer):
    return Completion("ann", b"c" * 16, 1, 1, b"f" * 16, answer.message.encode(), 0, 1.5)


async def test_a_requests_completion_is_stored_with_its_task_and_not_without_one(store):
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    await manager.pause()
    await manager.submit("move", "mars", 5, completing=completed)
    assert (await store.load()).completions == ()
    answer = await manager.submit("move", "1", 5, completing=completed)
    (found,) = (await store.load()).completions
    assert found == completed(answer)
    assert len((await store.load()).tasks) == 1
    await manager.submit("move", "1", 5, completing=lambda answer: None)
    assert len((await store.load()).completions) == 1
    await manager.close()


class Refusing(MemoryStore):
    """A slow disk that refuses the changes with these numbers."""

    def __init__(self, *refused):
        super().__init__()
        self.refused, self.count = refused, 0

    async def apply(self, *arguments, **options):
        self.count += 1
        number = self.count
        await asyncio.sleep(1)
        if number in self.refused:
            raise StoreError("the disk is full")
        await super().apply(*arguments, **options)


async def test_unstored_task_does_not_reappear_when_it_is_moved_meanwhile():
    store = Refusing(1)
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    submitted = asyncio.ensure_future(manager.submit("move", "3", 5))
    await asyncio.sleep(0.5)
    moved = await manager.reprioritise(1, 9)
    with pytest.raises(StoreError):
        await submitted
    assert not moved.success
    assert not (await store.load()).tasks
    await manager.close()


def at_once(*arguments, **options):
    """A store that fails before there is anything to wait for."""
    raise StoreError("the disk is gone")


async def in_the_end(*arguments, **options):
    """A store that fails as no store should."""
    await asyncio.sleep(0.01)
    raise KeyError("a table")


@pytest.mark.parametrize(("apply", "error"), [(at_once, StoreError), (in_the_end, KeyError)])
async def test_queue_stays_as_stored_after_any_store_error(apply, error):
    store = MemoryStore()
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    await manager.pause()
    await submit(manager, ("3", 5), ("2", 5))
    store.apply = apply
    for change in (
        manager.submit("move", "1", 5),
        manager.cancel(1),
        manager.drop(2),
        manager.reprioritise(2, 9),
    ):
        with pytest.raises(error):
            await change
    assert [(task.task_id, task.priority) for task, _ in manager.queue.ordered()] == [
        (1, 5),
        (2, 5),
    ]
    del store.apply
    await manager.close()


async def test_interrupted_task_stays_interrupted_when_requeue_and_drop_are_not_stored():
    store = MemoryStore()
    first = TaskManager(LineRobot(), store, TaskSettings(settle=0))
    await first.start()
    await submit(first, ("3", 5))
    await asyncio.sleep(1)
    await first.close()
    refusing = Refusing(1, 2)
    await MemoryStore.apply(refusing, (await store.load()).tasks)
    robot = LineRobot()
    manager = TaskManager(robot, refusing, TaskSettings(settle=0))
    await manager.start()
    requeued = asyncio.ensure_future(manager.requeue(1))
    await asyncio.sleep(0.5)
    dropped = asyncio.ensure_future(manager.drop(1))
    results = await asyncio.gather(requeued, dropped, return_exceptions=True)
    assert [type(each) for each in results] == [StoreError, StoreError]
    await manager.resume()
    await asyncio.sleep(20)
    assert (len(manager.queue), robot.log) == (0, [])
    await manager.close()


@pytest.mark.parametrize(("order", "state"), [("requeue", "CANCELED"), ("cancel", "QUEUED")])
async def test_change_of_a_cancelled_caller_is_undone_when_not_stored(order, state):
    robot, store = LineRobot(), Refusing(3 if order == "requeue" else 2)
    manager = TaskManager(robot, store, TaskSettings(settle=0))
    await manager.start()
    await manager.pause()
    await submit(manager, ("3", 5))
    if order == "requeue":
        await manager.cancel(1)
    asked = asyncio.ensure_future(getattr(manager, order)(1))
    await asyncio.sleep(0.5)
    asked.cancel()
    await asyncio.sleep(1)
    assert manager.repository.find(1).state.value == state
    assert (1 in manager.queue) == (state == "QUEUED")
    await manager.resume()
    await asyncio.sleep(20)
    assert len(robot.log) == (state == "QUEUED")
    await manager.close()


async def test_manager_describes_its_queue(manager):
    assert str(manager) == "no tasks in the queue"
    await submit(manager, ("50", 5), ("1", 5))
    await asyncio.sleep(5)
    assert str(manager) == "1 task in the queue, task 1 is running"
    await submit(manager, ("2", 5))
    await manager.pause()
    assert str(manager) == "2 tasks in the queue, task 1 is running, the queue is paused"


@pytest.mark.parametrize("error", [TargetError, RuntimeError])
async def test_long_refusal_of_a_robot_is_cut_at_400_characters(manager, monkeypatch, error):
    def refuse(self, task_type, target, start):
        raise error("x" * 1000)

    monkeypatch.setattr(LineRobot, "plan", refuse)
    refused = await manager.submit("move", "1", 5)
    assert refused.message.endswith("x" * 300)
    assert len(refused.message.partition(": ")[2]) == 400


async def test_closed_manager_says_so():
    manager = TaskManager(LineRobot(), MemoryStore())
    await manager.start()
    assert not manager.is_closed
    await manager.close()
    assert manager.is_closed


async def test_instant_restart_changes_no_estimate():
    store = MemoryStore()
    old = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: 1000.0))
    await old.start()
    await old.pause()
    await submit(old, ("50", 5))
    await old.close()
    new = TaskManager(LineRobot(), store, TaskSettings(wall_clock=lambda: 1000.0))
    await new.start()
    assert not new.changes(new.repository.find(1))
    await new.close()


async def test_only_a_stored_task_is_logged_as_queued(caplog):
    caplog.set_level("INFO", "taskrpc.tasks")
    store = Refusing(1)
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    with pytest.raises(StoreError):
        await manager.submit("move", "3", 5)
    assert "queued" not in caplog.text
    await manager.submit("move", "3", 4)
    assert "Task 2 queued: move to 3 (priority: 4)" in caplog.text
    await manager.close()


def run_virtually(work):
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(work)


async def orders_of(priorities, changes):
    """Submit and move tasks; returns each order that the task server shows or follows."""
    store, robot = MemoryStore(), LineRobot()
    old = TaskManager(LineRobot(), store)
    await old.start()
    await old.pause()
    await submit(old, *((str(number), each) for number, each in enumerate(priorities)))
    for number, priority in changes:
        await old.reprioritise(1 + number % len(priorities), priority)
    tasks = sorted((old.repository.find(1 + each) for each in range(len(priorities))), key=place)
    estimates = {task.task_id: old.estimate(task.task_id) for task in tasks}
    orders = {
        "expected": [task.task_id for task in tasks],
        "queue": [task.task_id for task, _ in old.queue.ordered()],
        "pages": [row.task.task_id for row in page(old, "").rows],
        "estimates": sorted(estimates, key=estimates.get),
    }
    await old.close()
    manager = TaskManager(robot, store)
    await manager.start()
    await manager.resume()
    await idle(manager)
    orders["execution after a restart"] = [1 + int(target) for _, target in robot.log]
    await manager.close()
    return orders


def place(task):
    return -task.priority, task.task_id


@settings(max_examples=examples(40))
@given(
    priorities=st.lists(st.integers(1, 10), min_size=1, max_size=12),
    changes=st.lists(st.tuples(st.integers(0, 11), st.integers(1, 10)), max_size=6),
)
def test_queue_pages_estimates_and_execution_share_one_order(priorities, changes):
    orders = run_virtually(orders_of(priorities, changes))
    expected = orders.pop("expected")
    assert orders == dict.fromkeys(orders, expected)
