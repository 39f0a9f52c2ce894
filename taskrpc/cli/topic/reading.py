"""How commands read topics: subscribe by the type that a topic has, and take each message."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import NotFound, UsageError, hinted
from taskrpc.cli.shared.remote import Remote, remote_of
from taskrpc.cli.topic.pub import message_class
from taskrpc.cli.topic.qos_options import qos_to_subscribe
from taskrpc.cli.topic.topic_graph import Topic, topics
from taskrpc.errors import InvalidRequest
from taskrpc.execution.callbacks import DaemonThreads

if TYPE_CHECKING:
    import argparse

    from taskrpc.node import Node
    from taskrpc.topic import Subscription

_LOOK = 0.1


class Feed:
    """Hands each message to an action, until that says that it is done, or fails."""

    def __init__(self, action: Callable[[Any], object]) -> None:
        self._action = action
        self._threads = DaemonThreads(1, "taskrpc output")
        self._loop = asyncio.get_running_loop()
        self._done = asyncio.Event()
        self._over = False
        self._problem: BaseException | None = None

    async def take(self, message: Any) -> None:
        """Hand a message over, on a thread: to print waits where the reader is slow."""
        await self._loop.run_in_executor(self._threads, self.take_at_once, message)

    def take_at_once(self, message: Any) -> None:
        """Hand a message over."""
        if self._over:
            return
        try:
            self._action(message)
        except Exception as error:  # the reader of our output has gone, for example
            self._problem = error
            self.stop()

    def stop(self) -> None:
        """Want no more messages; from any thread."""
        self._over = True
        self._loop.call_soon_threadsafe(self._done.set)

    async def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end; False where the time is over first. Raises what the action raised."""
        try:
            async with asyncio.timeout(timeout):
                await self._done.wait()
        except TimeoutError:
            return False
        if self._problem is not None:
            raise self._problem
        return True


def condition(text: str | None) -> Callable[[Any], bool]:
    """What `--filter` says of a message: a Python expression in which it is called `m`.

    Raises UsageError for what is no expression; what is returned raises InvalidRequest.
    """
    if text is None:
        return lambda message: True
    try:
        code = compile(text, "--filter", "eval")
    except (SyntaxError, ValueError) as error:
        problem = f"--filter: expected a Python expression about m, the message; {error}"
        raise UsageError(problem) from None

    def holds(message: Any) -> bool:
        try:
            return bool(eval(code, {"m": message}))
        except Exception as error:
            raise InvalidRequest("", f"--filter: {type(error).__name__}: {error}") from None

    return holds


async def subscribed(
    options: argparse.Namespace,
    node: Node,
    name: str,
    callback: Callable[[Any], object],
    *,
    wait: bool,
) -> Subscription[Any]:
    """Subscribe to a topic by the type that was given, or that it has."""
    topic = quoting.expanded(name, kind="topic name")
    given = getattr(options, "message_type", "")
    remote = remote_of(options)
    found = await _found(remote, node, topic)
    if not found.types and not given:
        print(f"WARNING: topic [{topic}] does not appear to be published yet", flush=True)
        if not wait:
            problem = NotFound("Could not determine the type for the passed topic")
            raise hinted(problem, f"write the type: taskrpc topic echo {topic} std_msgs/msg/String")
        while not found.types:
            await asyncio.sleep(_LOOK)
            found = await _found(remote, node, topic)
    if not given and len(found.types) > 1:
        several = f"Cannot echo topic '{topic}', as it contains more than one type"
        raise NotFound(f"{several}: [{', '.join(found.types)}]")
    cls = message_class(given or found.types[0])
    qos = qos_to_subscribe(options, [each for each, _ in found.publishers])
    return node.create_subscription(cls, topic, callback, qos)


async def _found(remote: Remote, node: Node, topic: str) -> Topic:
    entries = await graph.entries_of(remote, node)
    return topics(entries, hidden=True).get(topic, Topic())
