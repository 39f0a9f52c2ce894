"""The same nodes and clients for programs that block: no async, no await.

The event loop runs in a thread of its own, one a process (`loop_thread`). Calls may come from any
thread; service callbacks run in threads, so that they may block and call other services.
Start with `node`; publishers and subscriptions are in `topics`."""

from taskrpc.sync.node import Client, Node
from taskrpc.sync.topics import Publisher, Subscription, Timer

__all__ = ["Client", "Node", "Publisher", "Subscription", "Timer"]
