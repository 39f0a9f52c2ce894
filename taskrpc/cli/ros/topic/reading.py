"""Reads topics for commands: subscribes with the topic's type, and handles each message."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from taskrpc.cli.ros.topic.pub import message_class
from taskrpc.cli.ros.topic.qos_options import qos_to_subscribe
from taskrpc.cli.ros.topic.topic_graph import Topic, topics
from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.command import NotFound, UsageError, hinted
from taskrpc.cli.shared.remote import Remote, remote_of
from taskrpc.errors import InvalidRequest
from taskrpc.spi import DaemonThreads

if TYPE_CHECKING:
    import argparse

    from taskrpc.node import Node
    from taskrpc.topic import Subscription

_POLL = 0.1  # seconds between two looks for a topic


class Feed:
    """Passes each message to an action until `stop` is called or the action fails."""

    def __init__(self, action: Callable[[Any], object]) -> None:
        self._action = action
        self._threads = DaemonThreads(1, "taskrpc output")
        self._loop = asyncio.get_running_loop()
        self._done = asyncio.Event()
        self._is_stopped = False
        self._error: BaseException | None = None
        """The error of the action; `wait` raises it."""

    async def take(self, message: Any) -> None:
        """Run the action in a thread: printing blocks if the reader of the output is slow."""
        await self._loop.run_in_executor(self._threads, self.take_at_once, message)

    def take_at_once(self, message: Any) -> None:
        """Run the action in this thread."""
        if self._is_stopped:
            return
        try:
            self._action(message)
        except Exception as error:  # for example, the reader of the output has closed it
            self._error = error
            self.stop()

    def stop(self) -> None:
        """Ignore further messages and end `wait`; callable from any thread."""
        self._is_stopped = True
        self._loop.call_soon_threadsafe(self._done.set)

    async def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end; returns False after `timeout` seconds. Raises the action's error."""
        try:
            async with asyncio.timeout(timeout):
                await self._done.wait()
        except TimeoutError:
            return False
        if self._error is not None:
            raise self._error
        return True


def condition(text: str | None) -> Callable[[Any], bool]:
    """Return the condition of `--filter`: a Python expression in which `m` is the message.

    Raises UsageError for an invalid expression. The condition raises InvalidRequest if it fails.
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
    """Subscribe to a topic with the type on the command line, or with the topic's own type.

    With `wait`, wait until the topic has a type; otherwise raise NotFound if it has none.
    """
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
            await asyncio.sleep(_POLL)
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
