"""The JSON of the live page's events: of a running server, and of a recording."""

from __future__ import annotations

from typing import Any

import msgspec

from taskrpc.robot.tasks.managed import RobotStatus
from taskrpc.robot.tasks.model import BEFORE_RUNNING_KEY, RUNNING_KEY, Task, TaskState
from taskrpc.robot.tasks.queue.estimate_log import DelayEvent
from taskrpc.robot.world import World

PROTOCOL = 1
"""The version of the events; a page of another version reloads itself."""
MAX_QUEUE, MAX_ENDED, MAX_MOVES, MAX_RANGES, MAX_NODES, MAX_ROBOTS = 50, 30, 20, 4096, 100, 50
"""The most entries of each list."""
MIN_MOVE = 0.1
"""Seconds; smaller changes of an estimate are not shown."""
_COMMAND = "/_taskrpc_cli_"  # the node of a command, without its process id
_MIN_COMMON_MOVE = 0.5  # the same for a change that all tasks have, such as a pause


class _Scan(msgspec.Struct):
    """The result of a scan, as `Robot.execute` returns it."""

    pose: dict[str, float]
    angle_min: float
    angle_increment: float
    range_max: float
    ranges: list[float | None]


def client_label(node: str) -> str:
    """Return a client as the page names it: a command such as `taskrpc-call` by its process id.

    Such a command has a hidden node. In a narrow column, only the id tells two of them apart.
    """
    return f"cli {node[len(_COMMAND) :]}" if node.startswith(_COMMAND) else node


def task_json(task: Task, estimated_time: float, robot: str = "") -> dict[str, Any]:
    """Return a task as the events contain it; `robot` of a fleet is planned to execute it."""
    return {
        "task_id": task.task_id,
        "task_type": task.task_type,
        "target": task.target,
        "priority": task.priority,
        "state": task.state.value,
        "client": client_label(task.client),
        "robot": task.robot or robot,
        "estimated_time": round(estimated_time, 3),
        "accepted_estimate": round(task.accepted_estimate, 3),
        "progress": round(task.progress, 4),
        "message": task.message,
        "submitted": task.submitted_at,
        "started": task.started_at,
        "ended": task.ended_at,
    }


def robot_json(robot: RobotStatus, task: Task | None) -> dict[str, Any]:
    """Return a robot of a fleet, with the task that it executes."""
    pose = robot.pose if robot.is_on_map else None
    return {
        "name": robot.name,
        "state": robot.state,
        "x": None if pose is None else round(pose.x, 2),
        "y": None if pose is None else round(pose.y, 2),
        "task_id": robot.task_id,
        "what": "" if task is None else f"{task.task_type} {task.target}",
        "own": robot.is_own,
    }


def result_json(task: Task) -> msgspec.Raw | None:
    """Return the result of a task, None if it has none."""
    return msgspec.Raw(task.result.encode()) if task.result else None


def map_json(world: World) -> dict[str, Any]:
    """Return a map."""
    return {
        "size": world.size,
        "radius": world.robot_radius,
        "dock": world.dock,
        "boxes": [box.corners() for box in world.obstacles],
        "places": dict(world.places),
    }


def scan_json(task: Task) -> dict[str, Any] | None:
    """Return the scan in a task's result; None for other results, and for those of other robots."""
    if '"ranges"' not in task.result:
        return None
    try:
        scan = msgspec.json.decode(task.result, type=_Scan)
        x, y, theta = (scan.pose[name] for name in ("x", "y", "theta"))
    except (msgspec.MsgspecError, KeyError):
        return None  # a robot of the user's own may return anything
    if len(scan.ranges) > MAX_RANGES:
        return None
    return {
        "task_id": task.task_id,
        "t": task.ended_at,
        "x": x,
        "y": y,
        "theta": theta,
        "angle_min": scan.angle_min,
        "angle_increment": scan.angle_increment,
        "range_max": scan.range_max,
        "ranges": scan.ranges,
    }


def concerns(delay: DelayEvent, task: Task, seconds: float) -> bool:
    """Return whether a task ends later or earlier by a delay, so that a user should see it."""
    if delay.only_task:
        return delay.only_task == task.task_id
    if delay.after == BEFORE_RUNNING_KEY and abs(seconds) < _MIN_COMMON_MOVE:
        return False
    key = task.order_key if task.state is TaskState.QUEUED else RUNNING_KEY
    return delay.after < key
