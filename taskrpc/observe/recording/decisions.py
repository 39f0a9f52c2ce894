"""The decisions of a recorded run: JSON lines about the queue, the tasks and the robot's motion."""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from taskrpc.observe.recording.mcap_file import Message, RecordingError, one_line
from taskrpc.robot.journal import RobotStart, RobotStep
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.queue.journal import QueueStart, QueueStep

DECISIONS_TOPIC = "/taskrpc/decisions"
"""The topic of the decisions: one `Decision` as JSON in each message."""


class RunStart(msgspec.Struct, frozen=True, tag_field="op", tag="run"):
    """The task server whose run is recorded."""

    node: str
    service: str
    address: str
    version: str
    speed: float
    """Robot seconds in one second."""
    services: tuple[str, ...] = ()
    """The services that it offers."""


class TaskChange(msgspec.Struct, frozen=True, tag_field="op", tag="task"):
    """A task has changed; `task` is its new value."""

    task: Task


class ProgressMade(msgspec.Struct, frozen=True, tag_field="op", tag="progress"):
    """The running task has made progress, 0.0 to 1.0."""

    task_id: int
    progress: float


class PauseChange(msgspec.Struct, frozen=True, tag_field="op", tag="pause"):
    """The queue was paused or resumed."""

    paused: bool


Decision: TypeAlias = (
    RunStart
    | QueueStart
    | QueueStep
    | RobotStart
    | RobotStep
    | TaskChange
    | ProgressMade
    | PauseChange
)

_decode = msgspec.json.Decoder(Decision).decode


def decision_of(message: Message) -> Decision:
    """Return the decision in a message of `DECISIONS_TOPIC`.

    Raises RecordingError for a message of another version, or a damaged one.
    """
    try:
        decision: Decision = _decode(message.data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        problem = f"a message on {DECISIONS_TOPIC} cannot be read: {one_line(error)}"
        raise RecordingError(problem) from None
    return decision
