"""The next group finds an empty queue, no tasks of the former group, and the robot at its start."""

import asyncio

import pytest

from taskrpc.course.classroom.resetting import begin_again, end_all
from taskrpc.errors import StoreError
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks.manager import TaskManager
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.store import MemoryStore
from tests.robot.tasks.conftest import Scene


@pytest.fixture
async def manager():
    manager = TaskManager(KinematicRobot(default_world()), MemoryStore())
    await manager.start()
    yield manager
    await manager.close()


@pytest.fixture
async def scene():
    scene = Scene(settle=0.0)
    await scene.manager.start()
    yield scene
    scene.store.is_full = False
    await scene.manager.close()


async def submit(manager, *targets):
    return [(await manager.submit("move", target, 5)).task_id for target in targets]


async def test_reset_cancels_all_tasks_returns_them_and_forgets_them(manager):
    await submit(manager, "warehouse", "central", "area_a")
    await asyncio.sleep(2)
    ended = await end_all(manager)
    assert [(task.task_id, task.state, task.message) for task in ended] == [
        (number, TaskState.CANCELED, "cancelled by the reset") for number in (1, 2, 3)
    ]
    assert not manager.queue
    assert await begin_again(manager) == ""
    assert [*manager.repository.tasks()] == []
    assert not manager.is_paused


async def test_robot_is_at_its_start_as_after_the_start_of_a_server(manager):
    before = manager.telemetry()
    await submit(manager, "warehouse")
    await asyncio.sleep(3)
    assert manager.telemetry().odometer > 0.5
    await end_all(manager)
    await begin_again(manager)
    assert manager.telemetry() == before


async def test_next_task_runs_after_a_reset_and_its_number_is_new(manager):
    await submit(manager, "warehouse", "central")
    await manager.pause()
    await end_all(manager)
    await begin_again(manager)
    first = await manager.submit("move", "central", 5)
    assert first.task_id == 3, "a number never means two tasks"
    await asyncio.sleep(first.estimated_time + 0.2)
    assert manager.repository.find(3).state is TaskState.SUCCEEDED


async def test_interrupted_tasks_are_dropped(manager):
    store = MemoryStore()
    first = TaskManager(KinematicRobot(default_world()), store)
    await first.start()
    await submit(first, "warehouse")
    await asyncio.sleep(1)
    stored = await store.load()
    await first.close()
    assert stored.tasks[0].state is TaskState.RUNNING
    later = MemoryStore()
    await later.apply(stored.tasks)
    second = TaskManager(KinematicRobot(default_world()), later)
    await second.start()
    assert [*second.repository.interrupted] == [1]
    (task,) = await end_all(second)
    assert task.state is TaskState.CANCELED
    await begin_again(second)
    assert (await later.load()).tasks == ()
    await second.close()


async def test_robot_without_a_reset_stays_where_it_is_and_the_reason_says_so(scene):
    await scene.submit("3")
    await scene.until(1, TaskState.RUNNING)
    await asyncio.sleep(2)
    await end_all(scene.manager)
    pose = scene.manager.pose()
    problem = await begin_again(scene.manager)
    assert problem == "the robot stays where it is: its class has no method `reset`"
    assert scene.manager.pose() == pose
    assert not scene.manager.is_paused


async def test_store_that_fails_keeps_the_tasks(scene):
    await scene.submit("3", "4")
    await end_all(scene.manager)
    scene.store.is_full = True
    with pytest.raises(StoreError):
        await begin_again(scene.manager)
    assert len([*scene.manager.repository.tasks()]) == 2


async def test_robot_that_executes_a_task_is_not_moved(manager):
    await submit(manager, "warehouse")
    await asyncio.sleep(2)
    pose = manager.pose()
    assert "the robot executes a task" in manager.reset_robot()
    assert manager.pose() == pose


async def test_task_that_arrives_during_the_reset_belongs_to_the_next_group(manager):
    await submit(manager, "warehouse", "central")
    ending = asyncio.ensure_future(end_all(manager))
    await asyncio.sleep(0)
    await submit(manager, "area_a")
    assert [task.task_id for task in await ending] == [1, 2]
    await begin_again(manager)
    assert [task.task_id for task in manager.repository.tasks()] == [3]
