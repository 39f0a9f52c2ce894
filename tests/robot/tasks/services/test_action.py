"""The action of the task server: goals are tasks, in the same queue and with the same rules."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc import GoalState
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.robot.tasks.model import TaskState
from tests.core.transport.helpers import outcome, until
from tests.robot.tasks.fakes import FullStore, LineRobot

ExecuteTask = srvgen.load("my_robot_interfaces/action/ExecuteTask")
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
WAITS = 1000


def move(target, priority=5, task_type="move"):
    return ExecuteTask.Goal(task_type=task_type, target=str(target), priority=priority)


class Lab:
    """A task server with a robot on a line, and a client of its action."""

    def __init__(self, robot, store, node, server, client, caller):
        self.robot, self.store = robot, store
        self.node, self.server, self.client, self.caller = node, server, client, caller

    def task(self, task_id):
        return self.server.manager.repository.find(task_id)


@pytest.fixture
async def lab():
    robot, store = LineRobot(), FullStore()
    async with (
        taskrpc.Node("task_server", transport="memory", listen="server") as node,
        TaskServer(node, robot, store) as server,
        taskrpc.Node("alice", transport="memory", listen="alice") as caller,
    ):
        client = caller.create_action_client(ExecuteTask, "/robot_task/execute")
        assert await client.wait_for_server(WAITS)
        yield Lab(robot, store, node, server, client, caller)
        store.is_full = False


async def test_a_goal_is_a_task_with_feedback_and_a_result(lab):
    handle = await lab.client.send_goal(move(20))
    feedback = [each async for each in handle.feedback]
    states = [each.state for each in feedback]
    assert states[0] == "QUEUED"
    assert set(states) == {"QUEUED", "RUNNING"}
    assert {each.task_id for each in feedback} == {1}
    assert feedback[0].estimated_time > 20
    progress = [each.progress for each in feedback]
    assert progress == sorted(progress)
    xs = [each.pose.x for each in feedback]
    assert xs == sorted(xs)
    assert xs[-1] > 15
    result = await handle.result()
    assert (result.success, result.state, result.task_id) == (True, "SUCCEEDED", 1)
    assert lab.task(1).state is TaskState.SUCCEEDED
    assert lab.task(1).client == "/alice"


async def test_goals_and_tasks_of_the_service_share_one_queue(lab):
    service = lab.caller.create_client(RobotTask, "/robot_task")
    first = await lab.client.send_goal(move(5))
    await until(lambda: lab.robot.log, WAITS)
    low = await lab.client.send_goal(move(10, priority=1))
    request = RobotTask.Request(task_type="move", target="15", priority=9)
    assert (await service.call(request)).task_id == 3
    assert (await low.result()).task_id == 2
    assert (await first.result()).task_id == 1
    ended = sorted((lab.task(number).ended_at, number) for number in (1, 2, 3))
    assert [number for _, number in ended] == [1, 3, 2]


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        (move(1, task_type="fly"), "Invalid task: fly"),
        (move("nowhere"), "expected a number, got 'nowhere'"),
        (move(1, priority=11), "Invalid priority: 11"),
    ],
)
async def test_a_task_that_the_service_would_refuse_is_rejected_with_its_reason(lab, goal, reason):
    with pytest.raises(taskrpc.GoalRejected, match=reason) as caught:
        await lab.client.send_goal(goal)
    assert caught.value.not_executed
    assert lab.task(1) is None


@pytest.mark.parametrize("begun", [True, False])
async def test_cancelling_the_goal_cancels_the_task(lab, begun):
    if not begun:
        await lab.client.send_goal(move(50))
    handle = await lab.client.send_goal(move(30))
    number = 1 if begun else 2
    if begun:
        await until(lambda: lab.task(1).state is TaskState.RUNNING, WAITS)
    assert await handle.cancel()
    with pytest.raises(taskrpc.GoalCanceled) as caught:
        await handle.result(WAITS)
    assert caught.value.result.state == "CANCELED"
    assert lab.task(number).state is TaskState.CANCELED
    assert lab.task(number).message == "cancelled by /alice"


async def test_cancelling_the_task_elsewhere_aborts_the_goal(lab):
    handle = await lab.client.send_goal(move(30))
    assert (await lab.server.manager.cancel(1, client="bob")).success
    with pytest.raises(taskrpc.GoalAborted) as caught:
        await handle.result(WAITS)
    result = caught.value.result
    assert (result.success, result.state) == (False, "CANCELED")
    assert result.message == "cancelled by bob"


async def test_a_failed_task_aborts_its_goal_with_the_reason(lab):
    lab.robot.fail_with = RuntimeError("no battery")
    handle = await lab.client.send_goal(move(3))
    with pytest.raises(taskrpc.GoalAborted) as caught:
        await handle.result(WAITS)
    assert caught.value.result.state == "FAILED"
    assert caught.value.result.message == lab.task(1).message


async def test_a_goal_that_cannot_be_stored_is_rejected(lab):
    lab.store.is_full = True
    with pytest.raises(taskrpc.GoalRejected) as caught:
        await lab.client.send_goal(move(3))
    assert caught.value.code is taskrpc.Code.UNAVAILABLE
    lab.store.is_full = False
    assert (await (await lab.client.send_goal(move(3))).result()).success


async def test_a_repeated_goal_is_queued_once(lab):
    handles = [await lab.client.send_goal(move(9), goal_id="9" * 32) for _ in range(3)]
    assert {(await handle.result()).task_id for handle in handles} == {1}
    assert lab.task(2) is None


async def test_goals_of_a_server_that_ends_fail_and_their_tasks_stay(lab):
    runs, waits = [await lab.client.send_goal(move(target)) for target in (30, 40)]
    await until(lambda: lab.task(1).state is TaskState.RUNNING, WAITS)
    lab.server.dismiss_watchers()
    for handle in (runs, waits):
        error = await outcome(handle.result(WAITS))
        assert isinstance(error, taskrpc.GoalAborted)
        assert error.code is taskrpc.Code.OUTCOME_UNKNOWN
    assert "task 2 was QUEUED" in str(error)
    await lab.node.drain(1.0)
    await lab.server.close()
    assert lab.task(1).state is TaskState.INTERRUPTED
    assert lab.task(2).state is TaskState.QUEUED


async def test_a_node_that_ends_interrupts_the_task_of_a_goal_and_does_not_cancel_it(lab):
    spinning = asyncio.ensure_future(lab.node.spin())
    handle = await lab.client.send_goal(move(500))
    await until(lambda: lab.task(1).state is TaskState.RUNNING, WAITS)
    spinning.cancel()  # as a signal does
    await asyncio.wait([spinning])
    error = await outcome(handle.result(WAITS))
    assert isinstance(error, taskrpc.GoalAborted)
    assert error.code is taskrpc.Code.OUTCOME_UNKNOWN
    assert lab.task(1).state is TaskState.RUNNING
    await lab.server.close()
    assert lab.task(1).state is TaskState.INTERRUPTED


async def test_feedback_arrives_also_while_a_task_waits(lab):
    await lab.client.send_goal(move(60))
    handle = await lab.client.send_goal(move(70))
    seen = []
    async for feedback in handle.feedback:
        seen.append(feedback.estimated_time)
        if len(seen) == 5:
            break
    assert handle.state is GoalState.EXECUTING
    assert seen[-1] < seen[0]


@pytest.mark.parametrize("count", [100, pytest.param(300, marks=pytest.mark.faults)])
async def test_hundreds_of_goals_wait_in_the_queue(count):
    async with (
        taskrpc.Node("both", transport="memory") as node,
        TaskServer(node, LineRobot(), MemoryStore()),
    ):
        client = node.create_action_client(ExecuteTask, "/robot_task/execute", timeout=WAITS)
        handles = await asyncio.gather(*[client.send_goal(move(n % 9)) for n in range(count)])
        results = await asyncio.gather(*[handle.result() for handle in handles])
        assert [each.task_id for each in results] == list(range(1, count + 1))


async def test_a_task_is_cancelled_if_its_client_stops_waiting_while_it_is_stored(lab, monkeypatch):
    submit = lab.server.manager.submit

    async def slowly(*arguments, **options):
        response = await submit(*arguments, **options)
        await asyncio.sleep(5)
        return response

    monkeypatch.setattr(lab.server.manager, "submit", slowly)
    with pytest.raises(taskrpc.DeadlineExceeded):
        await lab.client.send_goal(move(50), timeout=1)
    await until(lambda: lab.task(1).state is TaskState.CANCELED, WAITS)


async def test_of_two_servers_that_join_only_the_first_offers_the_action():
    async with (
        taskrpc.Node("first", transport="memory", listen="first") as first,
        TaskServer(first, LineRobot(), MemoryStore(), join=True),
        taskrpc.Node("second", transport="memory", listen="second") as second,
        TaskServer(second, LineRobot(), MemoryStore(), join=True) as joined,
        taskrpc.Node("alice", transport="memory", listen="alice") as caller,
    ):
        client = caller.create_action_client(ExecuteTask, "/robot_task/execute")
        handle = await client.send_goal(move(3))
        assert (await handle.result()).state == "SUCCEEDED"
        assert joined.manager.repository.find(1) is None
