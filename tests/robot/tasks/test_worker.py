"""The robot executes one task after another, despite faults of robot, disk and operator."""

import asyncio

import pytest

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.tasks.model import TaskState
from tests.robot.tasks.conftest import Scene


async def test_a_task_is_queued_runs_and_succeeds(scene):
    (task_id,) = await scene.submit("3")
    await scene.until(task_id, TaskState.SUCCEEDED)
    assert scene.states(task_id) == ["QUEUED", "RUNNING", "SUCCEEDED"]
    task = scene.manager.repository.find(task_id)
    assert (task.result, task.progress) == ('{"x":3.0}', 1.0)
    assert task.started_at <= task.ended_at


async def test_an_idle_robot_waits_for_company_and_then_takes_the_first():
    scene = Scene(settle=2.0)
    await scene.watch()
    await scene.submit("1", priority=3)
    await asyncio.sleep(1.9)
    await scene.submit("2", priority=9)
    await asyncio.sleep(0.05)
    assert scene.robot.log == []
    await scene.until(1, TaskState.SUCCEEDED)
    assert scene.robot.log == [("move", "2"), ("move", "1")]
    await asyncio.sleep(1)
    began = asyncio.get_running_loop().time()
    (third,) = await scene.submit("1")
    await scene.until(third, TaskState.RUNNING)
    assert asyncio.get_running_loop().time() - began == pytest.approx(2.0), "idle once more"
    await scene.manager.close()


async def test_a_running_task_is_not_interrupted_by_priority(scene):
    await scene.submit("5", priority=1)
    await asyncio.sleep(1)
    await scene.submit("6", priority=10)
    await scene.until(1, TaskState.SUCCEEDED)
    assert scene.robot.log == [("move", "5")]


@pytest.mark.parametrize("order", ["pause", "stop", "cancel"])
async def test_halting_succeeds_although_the_disk_refuses_it(scene, order):
    await scene.submit("10", "20")
    await asyncio.sleep(4)
    scene.store.is_full = True
    what = scene.manager.cancel(1) if order == "cancel" else getattr(scene.manager, order)()
    answer = await what
    assert answer.success
    expected = {
        "pause": "The queue is paused, but this could not be stored: the disk is full",
        "stop": "The robot is stopped and the queue is paused; task 1 was cancelled (taskrpc task"
        " requeue 1 runs it again), but this could not be stored: the disk is full",
        "cancel": "Task 1 is being cancelled, but this could not be stored: the disk is full",
    }
    assert answer.message == expected[order]
    pose = scene.robot.pose()
    await asyncio.sleep(100)
    assert scene.robot.pose() == pose
    assert scene.robot.log == [("move", "10")]


async def test_a_paused_queue_accepts_and_begins_nothing(scene):
    await scene.manager.pause()
    await scene.submit("1", "2")
    await asyncio.sleep(100)
    assert scene.robot.log == []
    assert [scene.state(number) for number in (1, 2)] == [TaskState.QUEUED] * 2
    await scene.manager.resume()
    await scene.until(2, TaskState.SUCCEEDED)
    assert scene.robot.log == [("move", "1"), ("move", "2")]


async def test_a_pause_in_the_midst_of_settling_loses_no_task_and_no_time():
    scene = Scene(settle=2.0)
    await scene.watch()
    await scene.submit("1")
    await asyncio.sleep(1.5)
    await scene.manager.pause()
    await asyncio.sleep(10)
    await scene.manager.resume()
    resumed = asyncio.get_running_loop().time()
    await scene.until(1, TaskState.RUNNING)
    assert asyncio.get_running_loop().time() - resumed == pytest.approx(0.5)
    await scene.manager.close()


async def test_a_queued_task_is_cancelled_without_the_robot(scene):
    await scene.submit("5", "6")
    await scene.manager.cancel(2)
    await scene.until(1, TaskState.SUCCEEDED)
    await asyncio.sleep(100)
    assert scene.states(2) == ["QUEUED", "CANCELED"]
    assert scene.robot.log == [("move", "5")]


async def test_stop_halts_the_robot_cancels_its_task_and_pauses_the_queue(scene):
    await scene.submit("100", "50")
    await asyncio.sleep(10)
    answer = await scene.manager.stop()
    assert answer.message == (
        "The robot is stopped and the queue is paused; "
        "task 1 was cancelled (taskrpc task requeue 1 runs it again)"
    )
    pose = scene.robot.pose()
    await asyncio.sleep(100)
    assert (scene.robot.pose(), scene.manager.is_paused) == (pose, True)
    assert scene.states(1) == ["QUEUED", "RUNNING", "CANCELED"]
    assert (await scene.manager.stop()).success, "a second stop does no harm"
    await scene.manager.resume()
    await scene.until(2, TaskState.SUCCEEDED)


async def test_the_robot_does_not_move_before_its_start_is_stored(scene):
    scene.store.delay = 1.0
    await scene.submit("5")
    await asyncio.sleep(0.9)
    assert scene.robot.log == []
    await asyncio.sleep(0.2)
    assert scene.robot.log == [("move", "5")]
    assert (await scene.store.load()).tasks[0].state is TaskState.RUNNING


async def test_a_full_disk_pauses_the_queue_and_loses_nothing(scene, caplog):
    await scene.manager.pause()
    await scene.submit("5", "6")
    estimate = scene.manager.repository.find(2).accepted_estimate
    scene.store.is_full = True
    with pytest.raises(StoreError):
        await scene.manager.resume()
    scene.manager._worker._resumed.set()
    await asyncio.sleep(1)
    assert scene.manager.is_paused
    assert "the queue is paused: the disk is full" in caplog.text
    assert scene.robot.log == []
    with pytest.raises(StoreError):
        await scene.submit("7")
    assert len(scene.manager.queue) == 2
    assert scene.manager.estimate(2) == pytest.approx(estimate)
    scene.store.is_full = False
    await scene.manager.resume()
    await scene.until(2, TaskState.SUCCEEDED)


@pytest.mark.parametrize("verb", ["cancel", "drop", "reprioritise"])
async def test_task_stays_queued_when_its_cancel_is_not_stored(scene, verb):
    await scene.manager.pause()
    await scene.submit("5", "6", "7")
    promised = [scene.manager.estimate(number) for number in (1, 2, 3)]
    scene.store.is_full, scene.store.delay = True, 3.0
    more = (9,) if verb == "reprioritise" else ()
    with pytest.raises(StoreError):
        await getattr(scene.manager, verb)(2, *more)
    assert [task.task_id for task, _ in scene.manager.queue.ordered()] == [1, 2, 3]
    assert scene.state(2) is TaskState.QUEUED
    estimates = [scene.manager.estimate(number) for number in (1, 2, 3)]
    assert estimates == [pytest.approx(each) for each in promised]
    scene.store.is_full = False
    await scene.manager.resume()
    await scene.until(3, TaskState.SUCCEEDED)
    assert [target for _, target in scene.robot.log] == ["5", "6", "7"]


async def test_an_unknown_outcome_starts_nothing_and_pauses_the_queue(scene, caplog):
    await scene.manager.pause()
    await scene.submit("5")
    scene.store.is_lost = True
    with pytest.raises(OutcomeUnknown):
        await scene.submit("6")
    assert [task.task_id for task, _ in scene.manager.queue.ordered()] == [1]
    scene.manager._worker._resumed.set()
    await asyncio.sleep(10)
    assert scene.robot.log == []
    assert "the queue is paused: the effect on the disk is unknown" in caplog.text
    assert scene.state(1) is TaskState.QUEUED


async def test_the_running_task_is_interrupted_when_the_server_ends(scene):
    await scene.submit("5", "6")
    await asyncio.sleep(1)
    await scene.manager.close()
    tasks = (await scene.store.load()).tasks
    assert [task.state for task in tasks] == [TaskState.INTERRUPTED, TaskState.QUEUED]
    assert tasks[0].message == "the server ended while it ran"
    assert scene.robot.remaining() == 0.0


async def test_a_robot_that_does_not_let_go_cannot_keep_the_server_from_ending(scene):
    async def forever(task_type, target, report):
        while True:
            try:
                await asyncio.sleep(3600)
            except asyncio.CancelledError:
                if asyncio.get_running_loop().time() > 50:
                    raise

    scene.robot.execute = forever
    await scene.submit("5")
    await asyncio.sleep(1)
    began = asyncio.get_running_loop().time()
    await scene.manager.close()
    assert asyncio.get_running_loop().time() - began < 2.0
    assert (await scene.store.load()).tasks[0].state is TaskState.INTERRUPTED
    await asyncio.sleep(100)


async def test_an_idle_server_ends_at_once(scene):
    began = asyncio.get_running_loop().time()
    await scene.manager.close()
    assert asyncio.get_running_loop().time() == began


def kept(manager, task_id, accepted_at, ended_at):
    """What a task was promised plus its changes, less the time that it really took."""
    task = manager.repository.find(task_id)
    promised = task.accepted_estimate + sum(change.seconds for change in task.changes)
    return promised - (ended_at - accepted_at)


def causes(manager, task_id):
    return [change.cause for change in manager.changes(manager.repository.find(task_id))]


async def test_estimates_hold_after_a_begin_that_could_not_be_stored():
    scene = Scene(settle=1.0)
    await scene.watch()
    loop, ended = asyncio.get_running_loop(), {}
    await scene.submit("3", "9")
    accepted_at = loop.time()
    before = [scene.manager.estimate(task_id) for task_id in (1, 2)]
    scene.store.is_full = True
    await asyncio.sleep(2)
    assert scene.manager.is_paused
    assert scene.robot.log == []
    scene.manager.update_estimates()
    # The second that it settled is over; the queue stands still for as long as it is paused.
    after = [scene.manager.estimate(task_id) for task_id in (1, 2)]
    assert after == pytest.approx([seconds - 1.0 for seconds in before])
    scene.store.is_full = False
    await scene.manager.resume()
    for task_id in (1, 2):
        await scene.until(task_id, TaskState.SUCCEEDED)
        ended[task_id] = loop.time()
    for task_id in (1, 2):
        assert kept(scene.manager, task_id, accepted_at, ended[task_id]) == pytest.approx(
            0, abs=0.01
        )
    await scene.manager.close()


async def test_cancelled_run_is_the_cause_of_later_changes(scene):
    await scene.submit("10", "12", "1")
    await asyncio.sleep(4)
    await scene.manager.cancel(1)
    assert causes(scene.manager, 3) == ["task 1 was cancelled"]


@pytest.mark.parametrize(("slowness", "text"), [(2.0, "longer"), (0.5, "less time")])
async def test_slow_execution_is_named_as_cause(scene, slowness, text):
    await scene.submit("10", "12")
    await asyncio.sleep(2)
    scene.robot.slowness = slowness
    await scene.until(1, TaskState.SUCCEEDED)
    assert causes(scene.manager, 2) == [f"task 1 took {text} than planned"]


async def test_delay_before_a_pause_is_not_the_pause(scene):
    await scene.submit("10", "12")
    await asyncio.sleep(2)
    scene.robot.slowness = 2.0
    await asyncio.sleep(2)
    await scene.manager.pause()
    await asyncio.sleep(30)
    await scene.manager.resume()
    found = scene.manager.changes(scene.manager.repository.find(2))
    assert [change.cause for change in found] == [
        "task 1 took longer than planned",
        "the queue was paused",
    ]
    assert found[1].seconds == pytest.approx(30, abs=0.6)


async def test_task_that_could_not_be_stored_while_the_worker_waited_pauses_nothing(scene):
    scene.store.delay, scene.store.is_full = 1.0, True
    with pytest.raises(StoreError):
        await scene.submit("3")
    scene.store.delay, scene.store.is_full = 0.0, False
    await asyncio.sleep(1)
    assert not scene.manager.is_paused
    (task_id,) = await scene.submit("3")
    await scene.until(task_id, TaskState.SUCCEEDED)


async def test_resuming_tells_the_robot_and_wakes_watchers(scene):
    told = []
    scene.robot.resume = lambda: told.append("resume")
    await scene.manager.pause()
    revision = scene.manager.change_feed.revision
    watching = asyncio.ensure_future(scene.manager.change_feed.wait_for_change(revision, 1000))
    await asyncio.sleep(1)
    assert not watching.done()
    answer = await scene.manager.resume()
    assert (answer.success, answer.message) == (True, "The queue is resumed")
    assert told == ["resume"]
    began = asyncio.get_running_loop().time()
    await watching
    assert asyncio.get_running_loop().time() - began < 1


async def test_stopped_task_names_the_client_that_stopped_the_robot(scene):
    await scene.submit("10")
    await asyncio.sleep(4)
    await scene.manager.stop(client="ann")
    assert scene.manager.repository.find(1).message == "the robot was stopped by ann"


async def test_server_that_was_never_started_ends_at_once():
    await Scene(settle=0.0).manager.close()
