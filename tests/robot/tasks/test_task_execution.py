"""One execution of a task: progress, pause, cancel, and how it ends."""

import asyncio

import pytest

from taskrpc.robot.protocol import RobotStopped
from taskrpc.robot.tasks.model import TaskState


async def test_progress_is_announced_and_never_falls(scene):
    (task_id,) = await scene.submit("9")
    noted = []
    while scene.state(task_id) is not TaskState.SUCCEEDED:
        noted.append(scene.manager.repository.find(task_id).progress)
        await asyncio.sleep(0.5)
    assert len(set(noted)) > 5
    assert noted == sorted(noted)


async def test_paused_task_continues_from_its_position(scene):
    await scene.submit("10")
    await asyncio.sleep(4)
    await scene.manager.pause()
    assert scene.state(1) is TaskState.PAUSED
    pose = scene.robot.pose()
    await asyncio.sleep(100)
    assert scene.robot.pose() == pose
    assert (await scene.manager.pause()).success, "a second pause does no harm"
    await scene.manager.resume()
    await scene.until(1, TaskState.SUCCEEDED)
    assert scene.states(1) == ["QUEUED", "RUNNING", "PAUSED", "RUNNING", "SUCCEEDED"]
    assert scene.robot.log == [("move", "10")]


@pytest.mark.parametrize("paused", [False, True])
async def test_a_begun_task_is_cancelled_by_halting_the_robot(scene, paused):
    await scene.submit("100", "50")
    await asyncio.sleep(10)
    if paused:
        await scene.manager.pause()
    answer = await scene.manager.cancel(1, client="/alice")
    assert (answer.success, answer.message) == (True, "Task 1 was cancelled")
    assert scene.states(1)[-2:] == ["CANCELING", "CANCELED"]
    assert scene.manager.repository.find(1).message == "cancelled by /alice"
    await scene.manager.resume()
    await scene.until(2, TaskState.SUCCEEDED)
    assert scene.robot.pose().x == 50


async def test_a_task_is_cancelled_while_its_start_is_being_stored(scene):
    scene.store.delay = 1.0
    submitted = asyncio.ensure_future(scene.submit("5"))
    await asyncio.sleep(1.5)  # queued and stored; RUNNING is on its way to the disk
    assert scene.manager.running is not None
    await submitted
    assert (await scene.manager.cancel(1)).success
    await asyncio.sleep(10)
    assert scene.state(1) is TaskState.CANCELED
    assert scene.robot.log == [], "the robot never moved"


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
        (RuntimeError("line one\nline two"), "RuntimeError: line one line two"),
        (KeyError(), "KeyError: no reason given"),
        (
            RobotStopped("the operator pressed the red button"),
            "the operator pressed the red button",
        ),
    ],
)
async def test_failing_robot_fails_one_task_and_the_worker_continues(scene, failure, message):
    await scene.submit("5", "6")
    scene.robot.fail_with = failure
    await scene.until(1, TaskState.FAILED)
    scene.robot.fail_with = None
    assert scene.manager.repository.find(1).message == message
    await scene.until(2, TaskState.SUCCEEDED)


async def test_a_robot_that_cancels_itself_fails_its_task(scene):
    await scene.submit("5", "6")
    scene.robot.fail_with = asyncio.CancelledError()
    await scene.until(1, TaskState.FAILED)
    scene.robot.fail_with = None
    assert scene.manager.repository.find(1).message == "the robot ended the task without a reason"
    await scene.until(2, TaskState.SUCCEEDED)


async def test_a_robot_that_answers_nonsense_cannot_break_the_queue(scene):
    def nonsense():
        raise OSError("no battery")

    scene.robot.remaining = scene.robot.pose = scene.robot.pause = nonsense
    await scene.submit("5", "6")
    await asyncio.sleep(1)
    answer = await scene.manager.pause()
    assert answer.message == "The queue is paused, but the robot failed: OSError: no battery"
    assert scene.state(1) is TaskState.RUNNING, "the task continues"
    del scene.robot.remaining, scene.robot.pose, scene.robot.pause
    await scene.manager.resume()
    await scene.until(2, TaskState.SUCCEEDED)


@pytest.mark.parametrize(
    ("result", "text"),
    [({"a": {1, 2}.__class__}, "\"<class 'set'>\""), ({"f": float("nan")}, "null")],
)
async def test_a_result_that_is_no_json_fails_nothing(scene, result, text):
    async def execute(task_type, target, report):
        return result

    scene.robot.execute = execute
    await scene.submit("5")
    await scene.until(1, TaskState.SUCCEEDED)
    assert text in scene.manager.repository.find(1).result


async def test_cancel_reports_a_robot_that_does_not_end_its_task(scene):
    scene.robot.ignores_cancel = True
    await scene.submit("5", "6")
    await asyncio.sleep(1)
    answer = await scene.manager.cancel(1)
    assert answer.message == "Task 1 is being cancelled"
    assert scene.state(1) is TaskState.CANCELING
    await scene.until(2, TaskState.SUCCEEDED)
    assert scene.state(1) is TaskState.SUCCEEDED, "it was done before it could be halted"


async def test_an_end_that_cannot_be_stored_is_still_shown(scene):
    await scene.submit("5", "6")
    await asyncio.sleep(1)
    scene.store.is_full = True
    await scene.until(1, TaskState.SUCCEEDED)
    await asyncio.sleep(100)
    assert scene.manager.is_paused
    assert scene.state(2) is TaskState.QUEUED
    assert (await scene.store.load()).tasks[0].state is TaskState.RUNNING


def _says_it_is_async(task_type, target, report):
    return {}


def _raises_at_once(task_type, target, report):
    raise RuntimeError("no motors")


@pytest.mark.parametrize(
    ("execute", "message"),
    [
        (_says_it_is_async, "TypeError: execute() must be `async def`"),
        (_raises_at_once, "RuntimeError: no motors"),
    ],
)
async def test_plain_execute_fails_the_task_and_not_the_server(scene, execute, message):
    good = scene.robot.execute
    scene.robot.execute = execute
    first, second = await scene.submit("1", "2")
    await scene.until(first, TaskState.FAILED)
    assert scene.manager.repository.find(first).message == message
    scene.robot.execute = good
    await scene.until(second, TaskState.SUCCEEDED)
    assert not scene.manager.is_paused
