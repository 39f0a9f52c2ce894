"""The robot's tasks: a durable priority queue, its worker, and the services in front of them."""

from taskrpc.tasks.answers import Answer, Resumed
from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.model import EstimateChange, State, Task
from taskrpc.tasks.records.sqlite_store import SqliteStore
from taskrpc.tasks.records.store import MemoryStore, Stored, TaskStore
from taskrpc.tasks.server import TaskServer

__all__ = [
    "Answer",
    "EstimateChange",
    "MemoryStore",
    "Resumed",
    "SqliteStore",
    "State",
    "Stored",
    "Task",
    "TaskManager",
    "TaskServer",
    "TaskStore",
]
