"""ROS 2 services without ROS: typed services from .srv files, over asyncio.

Start with `taskrpc.Node` in `node.py`; `docs/explanation/architecture.md` shows what lives where.
This module only exports the public names. It imports a name when a program first uses it, so that
a command loads only what it needs.
"""

from __future__ import annotations

from srvgen import excepthook

excepthook.show_in_one_message()  # also for imports that a file of the program makes impossible

TYPE_CHECKING = False  # importing typing would cost `taskrpc --help` more than all its own files
if TYPE_CHECKING:
    from taskrpc import errors as errors
    from taskrpc import logs as logs
    from taskrpc import sync as sync
    from taskrpc import testing as testing
    from taskrpc.actions.client import ActionClient
    from taskrpc.actions.goal_handle import GoalHandle
    from taskrpc.actions.server import ActionServer
    from taskrpc.actions.server_goal import ServerGoal
    from taskrpc.actions.states import GoalState
    from taskrpc.client import Client
    from taskrpc.core.callinfo import CallInfo, current_call
    from taskrpc.core.exactly_once import Effect
    from taskrpc.core.exactly_once.stores import MemoryCompletions, SqliteCompletions
    from taskrpc.core.observer import NodeStatus, Observer, Observers
    from taskrpc.core.security.roles import Account, Accounts, Role
    from taskrpc.core.security.tls import Tls
    from taskrpc.deferred import DeferredCall
    from taskrpc.errors import (
        AuthenticationFailed,
        CannotListen,
        Code,
        ConnectionLost,
        DeadlineExceeded,
        GoalAborted,
        GoalCanceled,
        GoalFailed,
        GoalRejected,
        HandlerError,
        HandlerFailed,
        InvalidName,
        InvalidRequest,
        NameInUse,
        OutcomeUnknown,
        PermissionDenied,
        ProtocolError,
        RequestIdReused,
        ServerBusy,
        ServiceUnavailable,
        SessionExpired,
        StoreError,
        TaskRpcError,
        TypeMismatch,
        WouldDeadlock,
    )
    from taskrpc.message_types import Action, Msg, Srv
    from taskrpc.node import Node
    from taskrpc.observe import metrics as metrics
    from taskrpc.observe.metrics import Metrics
    from taskrpc.program import run
    from taskrpc.qos import QoS
    from taskrpc.retry import RetryPolicy
    from taskrpc.robot import (
        KinematicRobot,
        Plan,
        Pose,
        Robot,
        TargetError,
        World,
        default_world,
        read_map,
    )
    from taskrpc.robot.tasks import MemoryStore, SqliteStore, TaskServer
    from taskrpc.service import Service
    from taskrpc.timer import Timer
    from taskrpc.topic import Publisher, Subscription

_HOMES = {
    "actions.client": "ActionClient",
    "actions.goal_handle": "GoalHandle",
    "actions.server": "ActionServer",
    "actions.server_goal": "ServerGoal",
    "actions.states": "GoalState",
    "core.security.roles": "Account Accounts Role",
    "core.callinfo": "CallInfo current_call",
    "client": "Client",
    "core.exactly_once": "Effect",
    "deferred": "DeferredCall",
    "errors": (
        "AuthenticationFailed CannotListen Code ConnectionLost DeadlineExceeded GoalAborted"
        " GoalCanceled GoalFailed GoalRejected HandlerError HandlerFailed InvalidName"
        " InvalidRequest NameInUse OutcomeUnknown PermissionDenied ProtocolError RequestIdReused"
        " ServerBusy ServiceUnavailable SessionExpired StoreError TaskRpcError TypeMismatch"
        " WouldDeadlock"
    ),
    "message_types": "Action Msg Srv",
    "observe.metrics": "Metrics",
    "node": "Node",
    "program": "run",
    "core.observer": "NodeStatus Observer Observers",
    "qos": "QoS",
    "retry": "RetryPolicy",
    "robot": "KinematicRobot Plan Pose Robot TargetError World default_world read_map",
    "service": "Service",
    "core.exactly_once.stores": "MemoryCompletions SqliteCompletions",
    "robot.tasks": "MemoryStore SqliteStore TaskServer",
    "timer": "Timer",
    "topic": "Publisher Subscription",
    "core.security.tls": "Tls",
}
_HOME_OF = {name: home for home, exported in _HOMES.items() for name in exported.split()}

_MODULES = ("errors", "logs", "sync", "testing")

__all__ = [
    "Account",
    "Accounts",
    "Action",
    "ActionClient",
    "ActionServer",
    "AuthenticationFailed",
    "CallInfo",
    "CannotListen",
    "Client",
    "Code",
    "ConnectionLost",
    "DeadlineExceeded",
    "DeferredCall",
    "Effect",
    "GoalAborted",
    "GoalCanceled",
    "GoalFailed",
    "GoalHandle",
    "GoalRejected",
    "GoalState",
    "HandlerError",
    "HandlerFailed",
    "InvalidName",
    "InvalidRequest",
    "KinematicRobot",
    "MemoryCompletions",
    "MemoryStore",
    "Metrics",
    "Msg",
    "NameInUse",
    "Node",
    "NodeStatus",
    "Observer",
    "Observers",
    "OutcomeUnknown",
    "PermissionDenied",
    "Plan",
    "Pose",
    "ProtocolError",
    "Publisher",
    "QoS",
    "RequestIdReused",
    "RetryPolicy",
    "Robot",
    "Role",
    "ServerBusy",
    "ServerGoal",
    "Service",
    "ServiceUnavailable",
    "SessionExpired",
    "SqliteCompletions",
    "SqliteStore",
    "Srv",
    "StoreError",
    "Subscription",
    "TargetError",
    "TaskRpcError",
    "TaskServer",
    "Timer",
    "Tls",
    "TypeMismatch",
    "World",
    "WouldDeadlock",
    "current_call",
    "default_world",
    "read_map",
    "run",
]


if not TYPE_CHECKING:  # or type checkers would accept every missing name as Any

    def __getattr__(name):
        from importlib import import_module  # a command handles Ctrl-C before it imports this

        home = _HOME_OF.get(name)
        if name in _MODULES:
            return import_module(f"taskrpc.{name}")
        if home is None:
            raise AttributeError(f"module 'taskrpc' has no attribute {name!r}")
        value = getattr(import_module(f"taskrpc.{home}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
