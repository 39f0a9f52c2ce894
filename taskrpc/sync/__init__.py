"""The blocking API: the same nodes and clients, for programs without async and await.

Each process has one event loop, in a thread of its own (`loop_thread`). Any thread may call;
service callbacks run in threads, so that they may block and call other services. Start with
`node`; publishers and subscriptions are in `topics`."""

from taskrpc.sync.node import Client, Node
from taskrpc.sync.topics import Publisher, Subscription, Timer

__all__ = ["Client", "Node", "Publisher", "Subscription", "Timer"]
