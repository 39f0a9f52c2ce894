"""The task server's topics publish changes to subscribers, and cost nothing without them."""

import asyncio
import math

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.robot import KinematicRobot, Pose, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.robot.tasks.services.topics import MOST_TASKS

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
TaskEvents = srvgen.load("taskrpc_interfaces/msg/TaskEvents")
PoseStamped = srvgen.load("geometry_msgs/msg/PoseStamped")
LATEST = QoS(100, durability="transient_local")


@pytest.fixture
async def server():
    robot = KinematicRobot(default_world(), start=Pose(1.0, 1.0, math.pi / 2))
    async with (
        taskrpc.Node("task_server", transport="memory", token="server") as node,
        TaskServer(node, robot, MemoryStore()) as server,
    ):
        yield server


@pytest.fixture
async def node(server):
    async with taskrpc.Node("watcher", transport="memory", token="watcher") as node:
        yield node


async def submit(node, *tasks):
    client = node.create_client(RobotTask, "/robot_task")
    for task_type, target, priority in tasks:
        request = RobotTask.Request(task_type=task_type, target=target, priority=priority)
        assert (await client.call(request)).success
    client.destroy()


async def test_events_contain_each_change_of_a_task_until_its_end(server, node):
    events = []
    node.create_subscription(TaskEvents, "/robot_task/events", events.append, LATEST)
    await asyncio.sleep(0.1)
    (first,) = events
    assert (first.complete, first.paused, first.queued, first.running) == (True, False, 0, 0)
    await submit(node, ("report", "central", 5))
    await asyncio.sleep(30)
    states = [task.state for event in events for task in event.tasks]
    assert states[0] == "QUEUED"
    assert states[-1] == "SUCCEEDED"
    assert "RUNNING" in states
    assert {event.running for event in events} == {0, 1}
    revisions = [event.revision for event in events]
    assert revisions == sorted(set(revisions))


async def test_a_latecomer_learns_how_the_queue_stands(server, node):
    await submit(node, ("move", "warehouse", 5), ("move", "station_1", 5))
    await asyncio.sleep(1)
    for _ in range(2):  # the second one is given the last message, beside the first one
        events = []
        node.create_subscription(TaskEvents, "/robot_task/events", events.append, LATEST)
        await asyncio.sleep(0.05)
        assert (events[0].queued, events[0].running) == (1, 1)


async def test_latched_message_is_dropped_without_subscribers(server, node):
    events = []
    first = node.create_subscription(TaskEvents, "/robot_task/events", print, LATEST)
    await asyncio.sleep(0.1)
    first.destroy()
    await asyncio.sleep(0.1)
    await submit(node, ("move", "warehouse", 5))
    await asyncio.sleep(1)
    node.create_subscription(TaskEvents, "/robot_task/events", events.append, LATEST)
    await asyncio.sleep(0.05)
    assert events[0].running == 1


async def test_too_many_changes_at_once_ask_the_watcher_for_a_new_list(server, node):
    events = []
    node.create_subscription(TaskEvents, "/robot_task/events", events.append, LATEST)
    await asyncio.sleep(0.1)
    await asyncio.gather(
        *(server.manager.submit("report", "central", 5) for _ in range(MOST_TASKS + 5))
    )
    await asyncio.sleep(0.1)
    assert [event.complete for event in events[:2]] == [True, False]
    assert not events[1].tasks
    assert events[1].queued >= MOST_TASKS


async def test_the_pose_comes_ten_times_a_second_while_the_robot_moves(server, node):
    poses = []
    node.create_subscription(PoseStamped, "/robot_task/pose", poses.append, LATEST)
    await asyncio.sleep(5)
    (at_start,) = poses
    assert at_start.header.frame_id == "map"
    assert (at_start.pose.position.x, at_start.pose.position.y) == (1.0, 1.0)
    assert at_start.pose.orientation.z == pytest.approx(math.sin(math.pi / 4))
    assert at_start.pose.orientation.w == pytest.approx(math.cos(math.pi / 4))
    await submit(node, ("move", "warehouse", 5))
    await asyncio.sleep(2.15)
    assert 18 <= len(poses) <= 22
    await asyncio.sleep(100)
    count, end = len(poses), server.manager.pose()
    assert (poses[-1].pose.position.x, poses[-1].pose.position.y) == (end.x, end.y)
    await asyncio.sleep(100)
    assert len(poses) == count


async def test_topics_cost_nothing_without_subscribers(server, node):
    subscription = node.create_subscription(PoseStamped, "/robot_task/pose", print, LATEST)
    await asyncio.sleep(0.5)
    subscription.destroy()
    await asyncio.sleep(0.5)
    own = {task for task in asyncio.all_tasks() if "_publish" in repr(task.get_coro())}
    assert not own
    events = server._topics._topics[0]._publisher
    await submit(node, ("report", "central", 5))
    await asyncio.sleep(10)
    assert events.sent == 0
