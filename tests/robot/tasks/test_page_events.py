"""The JSON of the live page's events."""

from __future__ import annotations

import json

import msgspec
import pytest

from taskrpc.robot import default_world
from taskrpc.robot.protocol import Pose
from taskrpc.robot.tasks.managed import RobotStatus
from taskrpc.robot.tasks.model import BEFORE_RUNNING_KEY, Task, TaskState
from taskrpc.robot.tasks.page_events import (
    MAX_RANGES,
    client_label,
    concerns,
    map_json,
    result_json,
    robot_json,
    scan_json,
    task_json,
)
from taskrpc.robot.tasks.queue.estimate_log import DelayEvent

TASK = Task(
    task_id=3,
    task_type="scan",
    target="dock",
    priority=5,
    arrival=3,
    submitted_at=7.0,
    ended_at=9.0,
)
SCAN = {
    "pose": {"x": 1.0, "y": 2.0, "theta": 0.5},
    "angle_min": -3.0,
    "angle_increment": 0.1,
    "range_max": 9.0,
    "ranges": [1.0, None],
}


def with_result(result):
    return msgspec.structs.replace(TASK, result=json.dumps(result))


def test_task_has_the_agreed_fields():
    assert list(task_json(TASK, 1.0)) == [
        *("task_id", "task_type", "target", "priority", "state", "client", "robot"),
        "estimated_time",
        *("accepted_estimate", "progress", "message", "submitted", "started", "ended"),
    ]


def test_map_has_walls_and_places():
    world = default_world()
    shown = msgspec.json.decode(msgspec.json.encode(map_json(world)))
    assert shown["size"] == list(world.size)
    assert shown["places"]["warehouse"] == list(world.places["warehouse"])
    assert len(shown["boxes"]) == len(world.obstacles)
    assert all(len(box) == 4 for box in shown["boxes"])


def test_scan_is_read_from_the_result():
    scan = scan_json(with_result(SCAN))
    assert (scan["task_id"], scan["t"], scan["x"], scan["ranges"]) == (3, 9.0, 1.0, [1.0, None])


@pytest.mark.parametrize(
    "result",
    [
        {"pose": SCAN["pose"]},
        {**SCAN, "ranges": "none"},
        {**SCAN, "ranges": [1.0] * (MAX_RANGES + 1)},
        {**SCAN, "pose": {"x": 1.0}},
    ],
)
def test_other_result_is_no_scan(result):
    assert scan_json(with_result(result)) is None


def test_result_stays_the_text_of_the_robot():
    assert msgspec.json.encode(result_json(with_result({"a": 1.5}))) == b'{"a": 1.5}'
    assert result_json(TASK) is None


@pytest.mark.parametrize(
    ("delay", "seconds", "expected"),
    [
        (DelayEvent(1, (-9, 1), 3.0, "a task went ahead"), 3.0, True),
        (DelayEvent(1, (-2, 1), 3.0, "behind it"), 3.0, False),
        (DelayEvent(1, (-2, 1), 3.0, "its own", only_task=3), 3.0, True),
        (DelayEvent(1, (-9, 1), 3.0, "of another", only_task=4), 3.0, False),
        (DelayEvent(1, BEFORE_RUNNING_KEY, 0.2, "the robot was slow"), 0.2, False),
        (DelayEvent(1, BEFORE_RUNNING_KEY, 2.0, "a pause"), 2.0, True),
    ],
)
def test_delay_concerns_the_tasks_behind_its_place(delay, seconds, expected):
    assert concerns(delay, TASK, seconds) is expected


def test_running_task_is_before_the_queue():
    running = msgspec.structs.replace(TASK, state=TaskState.RUNNING)
    assert not concerns(DelayEvent(1, (-9, 1), 3.0, "a task went ahead"), running, 3.0)


@pytest.mark.parametrize(
    ("node", "label"), [("/_taskrpc_cli_815", "cli 815"), ("/ada", "/ada"), ("", "")]
)
def test_client_of_a_command_has_its_process_id_as_label(node: str, label: str) -> None:
    assert client_label(node) == label
    task = msgspec.structs.replace(TASK, client=node)
    assert task_json(task, 0.0)["client"] == label


def test_robot_of_another_map_has_no_place_on_this_one():
    pose = Pose(1.234, 2.0, 0.0)
    here = robot_json(RobotStatus("r1", "idle", pose, is_own=True), None)
    assert here == {
        "name": "r1", "state": "idle", "x": 1.23, "y": 2.0, "task_id": 0, "what": "", "own": True
    }  # fmt: skip
    other = robot_json(RobotStatus("r2", "idle", pose, is_on_map=False), None)
    assert (other["x"], other["y"]) == (None, None)
