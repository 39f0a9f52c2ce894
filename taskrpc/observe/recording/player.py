"""The player: publishes the messages of a recording again, at the times between them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.observe.recording.mcap_file import CDR, Message, Topic, one_line
from taskrpc.observe.recording.recorder import message_class
from taskrpc.observe.recording.schemas import class_from, is_event
from taskrpc.observe.recording.sqlite_file import AnyRecording
from taskrpc.spi import SUFFIX
from taskrpc.topic import Publisher

_REQUEST_STEPS = (0, 1)
"""The event types of a request in ServiceEventInfo: sent, received."""


class PlaySettings(msgspec.Struct, frozen=True, kw_only=True):
    """How to play a recording."""

    rate: float = 1.0
    """Recorded seconds in one second."""
    start_offset: float = 0.0
    """Recorded seconds to leave out at the beginning."""
    duration: float | None = None
    """Recorded seconds to play at most."""
    topics: Sequence[str] = ()
    """Absolute names of the topics and services to play; empty for all."""
    exclude: Sequence[str] = ()
    """Absolute names of topics and services that are not played."""
    publish_requests: bool = False
    """Whether to call the recorded services again, instead of publishing their events."""
    delay: float = 0.0
    """Seconds to wait before the first message, so that subscriptions find the publishers."""


class Player:
    """Publishes a recording; `play` may be called several times.

    Args:
        node: a started node, which makes the publishers.
        recording: the file.
        settings: which part to play, and how fast.
    """

    def __init__(self, node: Node, recording: AnyRecording, settings: PlaySettings) -> None:
        self._node = node
        self._recording = recording
        self._settings = settings
        self.published = 0
        """Messages published, and requests sent, so far."""
        self.skipped: dict[str, str] = {}
        """Topics that cannot be played, each with the reason."""
        self._actions: dict[Topic, Callable[[bytes], object] | None] = {}
        self._calls: set[asyncio.Future[Any]] = set()

    async def play(self) -> None:
        """Play the recording once; the publishers stay."""
        loop, settings = asyncio.get_running_loop(), self._settings
        first = began = None
        for message in self._messages():
            if first is None:
                first = message.time
            # Times may go back a little: such a message is late, and is played at once.
            offset = max(0.0, (message.time - first) / 1e9) - settings.start_offset
            if offset < 0:
                continue
            if settings.duration is not None and offset > settings.duration:
                break
            action = self._action(message.topic)
            if began is None:
                await asyncio.sleep(settings.delay)
                began = loop.time()
            due = began + offset / settings.rate
            # Also yields if the message is late: the loop must send what was published.
            await asyncio.sleep(max(0.0, due - loop.time()))
            if action is not None:
                self._do(message, action)
        if self._calls:
            await asyncio.wait(self._calls)

    def _messages(self) -> Iterator[Message]:
        return self._recording.messages(keep=self._is_wanted)

    def _is_wanted(self, topic: Topic) -> bool:
        known = {topic.name, topic.name.removesuffix(SUFFIX)}
        if known & set(self._settings.exclude):
            return False
        return not self._settings.topics or bool(known & set(self._settings.topics))

    def _do(self, message: Message, action: Callable[[bytes], object]) -> None:
        try:
            action(message.data)
        except (srvgen.CdrError, TaskRpcError) as error:
            self.skipped.setdefault(message.topic.name, one_line(error))

    def _action(self, topic: Topic) -> Callable[[bytes], object] | None:
        if topic not in self._actions:
            self._actions[topic] = self._make_action(topic)
        return self._actions[topic]

    def _make_action(self, topic: Topic) -> Callable[[bytes], object] | None:
        if topic.encoding != CDR:
            return None  # the task server's decisions: `taskrpc view` shows them
        try:
            cls = playable_class(topic)
        except (srvgen.DefinitionError, TaskRpcError) as error:
            self.skipped[topic.name] = one_line(error)
            return None
        if self._settings.publish_requests and is_event(topic.type_name):
            return self._caller(topic, cls)
        try:
            publisher = self._node.create_publisher(cls, topic.name, topic.qos)
        except TaskRpcError as error:
            self.skipped[topic.name] = one_line(error)
            return None
        return lambda data: self._publish(publisher, cls, data)

    def _publish(self, publisher: Publisher[Any], cls: Any, data: bytes) -> None:
        publisher.publish(srvgen.from_cdr(cls, data))
        self.published += 1

    def _caller(self, topic: Topic, cls: Any) -> Callable[[bytes], object]:
        service: Any = srvgen.load(cls._TYPE.removesuffix("_Event"))
        client = self._node.create_client(service, topic.name.removesuffix(SUFFIX))
        seen: set[tuple[bytes, int]] = set()

        def call(data: bytes) -> None:
            event = srvgen.from_cdr(cls, data)
            key = bytes(event.info.client_gid), event.info.sequence_number
            is_request = event.info.event_type in _REQUEST_STEPS
            if not is_request or not event.request or key in seen:
                return
            seen.add(key)  # the client and the server may both report the request
            request = srvgen.from_cdr(service.Request, srvgen.to_cdr(event.request[0]))
            future = client.call_async(request)
            self._calls.add(future)
            future.add_done_callback(self._ended)
            self.published += 1

        return call

    def _ended(self, call: asyncio.Future[Any]) -> None:
        self._calls.discard(call)
        if not call.cancelled() and (error := call.exception()) is not None:
            self.skipped.setdefault("a request", one_line(error))


def playable_class(topic: Topic) -> Any:
    """Return the class of a recorded topic: the local one if it has the recorded definition.

    Raises DefinitionError if neither the file nor this machine defines the type.
    """
    try:
        local = message_class(topic.type_name)
    except srvgen.DefinitionError:
        local = None
    if topic.schema_encoding != "ros2msg" or not topic.schema:
        if local is None:
            problem = f"the file has no definition of {topic.type_name} that can be read here"
            raise srvgen.DefinitionError(problem)
        return local
    recorded = class_from(topic.type_name, topic.schema)
    return local if local is not None and local._HASH == recorded._HASH else recorded
