"""The blocking API: the same nodes and clients, for programs without async and await.

Each process has one event loop, in a thread of its own (`loop_thread`). Any thread may call;
service callbacks run in threads, so that they may block and call other services. Start with
`node`; publishers and subscriptions are in `topics`, clients of actions in `actions`."""

from taskrpc.sync.actions import ActionClient, GoalHandle
from taskrpc.sync.node import Client, Node
from taskrpc.sync.topics import Publisher, Subscription, Timer

__all__ = [
    "ActionClient",
    "Client",
    "GoalHandle",
    "Node",
    "Publisher",
    "Subscription",
    "Timer",
]
