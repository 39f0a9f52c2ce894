"""The calls of a recording: each request with its response, from the events of services.

`taskrpc-server --record` also writes a line about each call's end to `CALLS_TOPIC`: the name of the
client, the error, the duration. Other recordings have only the events.
"""

from __future__ import annotations

from typing import Any

import msgspec

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.observe.recording.mcap_file import JSON, Message, Topic
from taskrpc.observe.recording.player import playable_class
from taskrpc.observe.recording.schemas import is_event
from taskrpc.spi import SUFFIX

CALLS_TOPIC = "/taskrpc/calls"
"""The topic with a `CallEnd` for each call, as JSON."""
ServiceEventInfo: Any = srvgen.load("service_msgs/msg/ServiceEventInfo")
_INFO_BYTES = 44
"""The CDR header and the info, with which each event begins; lists in it may be long."""
_OK = "OK"
_MOST_TEXT = 80
"""Characters of a request's or response's text."""


class CallEnd(msgspec.Struct, omit_defaults=True):
    """The end of a call, as the server saw it."""

    number: int
    """Counts the calls of the server; the sequence number of the call's events."""
    service: str
    client: str
    began: float
    """Seconds since 1970."""
    ms: float | None
    """Milliseconds from the arrival of the request to the response; None: it has not ended."""
    code: str = _OK
    """The name of the error code; `OK` for a response."""
    account: str = ""
    deadline_ms: float | None = None
    """Milliseconds that the caller gave; None: no deadline."""
    task_id: int | None = None
    """The task that the call was about."""


class RecordedCall(msgspec.Struct):
    """One call of a service."""

    service: str
    number: int
    begin: float
    """Seconds since 1970."""
    client: str = ""
    """The client's name; `client 1` if the recording does not say it."""
    account: str = ""
    ms: float | None = None
    """None if the recording has no end of the call."""
    code: str = ""
    """The name of the error code; "" without an error."""
    deadline_ms: float | None = None
    task_id: int | None = None
    request: str = ""
    """Its fields as `name=value`, cut."""
    response: str = ""

    @property
    def state(self) -> str:
        """`open`, `ok` or `error`."""
        return "error" if self.code else "open" if self.ms is None else "ok"


class CallReader:
    """Collects the calls from the messages of a recording, in the order of their start.

    Args:
        texts: whether to keep the fields of requests and responses.
    """

    def __init__(self, *, texts: bool = True) -> None:
        self.calls: list[RecordedCall] = []
        self._texts = texts
        self._open: dict[tuple[str, int, bytes], RecordedCall] = {}
        self._of_server: dict[tuple[str, int], tuple[RecordedCall, bytes]] = {}
        """The same calls without the client's gid, for the lines about their ends."""
        self._names: dict[str, str] = {}
        """Each name once: a class makes a hundred thousand calls of a few services."""
        self._clients: dict[bytes, str] = {}
        self._classes: dict[Topic, Any] = {}

    def take(self, message: Message) -> RecordedCall | None:
        """Take any message of the recording; returns the call that it concerns."""
        topic = message.topic
        if topic.name == CALLS_TOPIC and topic.encoding == JSON:
            try:
                return self._take_end(msgspec.json.decode(message.data, type=CallEnd))
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                return None  # a damaged message
        if is_event(topic.type_name):
            return self._take_event(message)
        return None

    def _take_end(self, end: CallEnd) -> RecordedCall:
        found = self._of_server.pop((end.service, end.number), None)
        if found is None:
            call = RecordedCall(self._name(end.service), end.number, end.began)
            self.calls.append(call)
        else:  # no later message belongs to this call
            call, gid = found
            self._open.pop((end.service, end.number, gid), None)
        call.client, call.account = self._name(end.client), self._name(end.account)
        call.ms = end.ms
        call.begin, call.deadline_ms, call.task_id = end.began, end.deadline_ms, end.task_id
        call.code = "" if end.code == _OK else self._name(end.code)
        return call

    def _take_event(self, message: Message) -> RecordedCall | None:
        event = self._decoded(message)
        if event is None:
            return None
        info = event.info if self._texts else event
        service = message.topic.name.removesuffix(SUFFIX)
        gid, time = bytes(info.client_gid), info.stamp.sec + info.stamp.nanosec / 1e9
        key = service, info.sequence_number, gid
        call = self._open.get(key)
        if call is None:
            client = self._clients.setdefault(gid, f"client {len(self._clients) + 1}")
            call = RecordedCall(self._name(service), info.sequence_number, time, client)
            self.calls.append(call)
            self._open[key] = call
            self._of_server[service, info.sequence_number] = call, gid
        if info.event_type in (info.REQUEST_SENT, info.REQUEST_RECEIVED):
            if self._texts:
                call.request = call.request or _text(event.request)
        else:
            if self._texts:
                call.response = call.response or _text(event.response)
            call.ms = (time - call.begin) * 1e3
        return call

    def _name(self, text: str) -> str:
        return self._names.setdefault(text, text)

    def _decoded(self, message: Message) -> Any:
        """Return the event, or without texts only its info; None if it cannot be read."""
        if not self._texts:
            try:
                return srvgen.from_cdr(ServiceEventInfo, message.data[:_INFO_BYTES])
            except srvgen.CdrError:
                return None
        if message.topic not in self._classes:
            try:
                self._classes[message.topic] = playable_class(message.topic)
            except (srvgen.DefinitionError, TaskRpcError):
                self._classes[message.topic] = None
        cls = self._classes[message.topic]
        try:
            return None if cls is None else srvgen.from_cdr(cls, message.data)
        except srvgen.CdrError:
            return None


def is_about_calls(topic: Topic) -> bool:
    """Return whether a topic has events or ends of calls."""
    return topic.name == CALLS_TOPIC or is_event(topic.type_name)


def _text(messages: Any) -> str:
    """Return the fields of the only message of an event; "" for an event without contents."""
    if not messages:
        return ""
    fields = srvgen.to_builtins(messages[0])
    text = " ".join(f"{name}={_shown(value)}" for name, value in fields.items())
    return text if len(text) <= _MOST_TEXT else text[: _MOST_TEXT - 1] + "…"


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list) and value:
        return f"[{len(value)} values]"
    return str(value)
