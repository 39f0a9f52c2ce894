"""The robot's tasks: a durable priority queue, its worker, and the services that offer them.

Start reading with `manager`, which has every operation on tasks. `server` offers it to the network,
with `services`.
`rules` decides what a request does to a task; a fleet has the same rules.
`queue` holds the order and the estimates, `records` what survives a restart. Nothing here knows
how a robot moves.
"""

from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.model import EstimateChange, Task, TaskState
from taskrpc.robot.tasks.records.history import History
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import MemoryStore, Stored, TaskStore
from taskrpc.robot.tasks.responses import Resumed, TaskResponse
from taskrpc.robot.tasks.server import TaskServer

__all__ = [
    "EstimateChange",
    "History",
    "MemoryStore",
    "Resumed",
    "SqliteStore",
    "Stored",
    "Task",
    "TaskManager",
    "TaskResponse",
    "TaskServer",
    "TaskSettings",
    "TaskState",
    "TaskStore",
]
