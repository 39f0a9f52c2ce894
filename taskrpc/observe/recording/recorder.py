"""The recorder: subscribes to topics, and to the events of services, and writes their messages."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import msgspec

import srvgen
from srvgen.classes.loader import search
from taskrpc.message_types import MsgT
from taskrpc.observe.recording.mcap_file import RecordingWriter
from taskrpc.observe.recording.schemas import EVENT, schema_text
from taskrpc.qos import QoS, qos_for_all
from taskrpc.spi import SUFFIX, RegistryEntry, TopicEndpoint, names, time_of_day_ns

log = logging.getLogger("taskrpc.recording")

_DEPTH = 1000
"""Messages of one topic that may wait for the recorder."""


class SubscribingNode(Protocol):
    """The part of a node that the recorder needs."""

    def create_subscription(
        self, msg_type: type[MsgT], topic: str, callback: Callable[[MsgT], object], qos: QoS | int
    ) -> Any:
        """Call a function with each message of a topic."""


class Selection(msgspec.Struct, frozen=True, kw_only=True):
    """Which topics and services to record; names are absolute."""

    topics: Sequence[str] = ()
    services: Sequence[str] = ()
    all_topics: bool = False
    all_services: bool = False
    pattern: str = ""
    """A regular expression: also record the topics whose name it matches."""
    without: str = ""
    """A regular expression: never record the topics and services whose name it matches."""
    hidden: bool = False
    """Whether `all_topics` includes hidden topics."""

    @property
    def is_empty(self) -> bool:
        """Whether it selects nothing."""
        named = [*self.topics, *self.services, self.pattern]
        return not (self.all_topics or self.all_services or any(named))

    def wants(self, topic: str) -> bool:
        """Return whether to record a topic; a service is recorded as its event topic."""
        service = topic.removesuffix(SUFFIX) if topic.endswith(SUFFIX) else ""
        if self.without and re.search(self.without, service or topic):
            return False
        if service:
            return self.all_services or service in self.services or topic in self.topics
        if topic in self.topics or (self.pattern and re.search(self.pattern, topic)):
            return True
        return self.all_topics and (self.hidden or not names.is_hidden(topic))


class Recorder:
    """Records the selected topics; `update` finds those that appear later.

    Args:
        node: a started node, which makes the subscriptions.
        writer: the file; the caller closes it.
        selection: what to record.
        failed: called with the error if the file cannot be written; then nothing more is recorded.
        clock: the time of day, in nanoseconds since 1970.
    """

    def __init__(
        self,
        node: SubscribingNode,
        writer: RecordingWriter,
        selection: Selection,
        failed: Callable[[Exception], object],
        clock: Callable[[], int] = time_of_day_ns,
    ) -> None:
        self._node = node
        self._writer = writer
        self._selection = selection
        self._failed = failed
        self._clock = clock
        self._subscriptions: dict[str, Any] = {}
        self._refused: set[str] = set()
        """Topics whose type is not known here; each is reported once."""
        self._is_open = True

    @property
    def topics(self) -> list[str]:
        """The topics that are being recorded."""
        return sorted(self._subscriptions)

    @property
    def lost(self) -> int:
        """Messages that were published and did not reach the file."""
        return sum(each.lost + each.dropped for each in self._subscriptions.values())

    def update(self, entries: Iterable[RegistryEntry]) -> list[str]:
        """Subscribe to the selected topics of these processes; returns the new ones."""
        publishers: dict[str, list[TopicEndpoint]] = {}
        for entry in entries:
            for each in entry.publishers:
                if each.name not in self._subscriptions and self._selection.wants(each.name):
                    publishers.setdefault(each.name, []).append(each)
        return [name for name, found in publishers.items() if self._subscribe(name, found)]

    def close(self) -> None:
        """End the subscriptions."""
        self._is_open = False
        for each in self._subscriptions.values():
            each.destroy()

    def _subscribe(self, topic: str, publishers: Sequence[TopicEndpoint]) -> bool:
        first = publishers[0]
        try:
            cls = message_class(first.type_name)
            schema = schema_text(first.type_name, search())
        except srvgen.DefinitionError as error:
            if topic not in self._refused:
                self._refused.add(topic)
                log.warning("%s is not recorded: %s", topic, " ".join(str(error).split()))
            return False
        qos = qos_for_all(publishers, _DEPTH)
        offered = msgspec.structs.replace(qos, depth=max(1, min(first.depth, _DEPTH)))
        number = self._writer.add_topic(
            topic, first.type_name, schema, type_hash=first.type_hash, qos=offered
        )
        self._subscriptions[topic] = self._node.create_subscription(
            cls, topic, lambda message: self._write(number, message), qos
        )
        return True

    def _write(self, number: int, message: Any) -> None:
        if not self._is_open:
            return
        try:
            self._writer.write(number, srvgen.to_cdr(message), self._clock())
        except Exception as error:
            self._is_open = False
            self._failed(error)


def message_class(type_name: str) -> Any:
    """Return the class of a message, or of the events of a service (`package/srv/Name_Event`).

    Raises DefinitionError if this machine has no definition of it.
    """
    if type_name.endswith(EVENT) and "/srv/" in type_name:
        service: Any = srvgen.load(type_name.removesuffix(EVENT))
        return service.Event
    return srvgen.load(type_name)
