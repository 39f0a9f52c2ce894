"""The operations of rosbridge v2 as text and as structs; fragments; throttled topics.

It decides what a message means and when a throttled message is due, and sends nothing itself.
`session` carries the operations out.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from typing import Annotated, Any, Generic, Literal, TypeAlias, TypeVar

import msgspec
from msgspec import Meta

MAX_MESSAGE = 10_000_000
"""Most bytes of one message, as in rosbridge_suite; a longer one gets an error status."""

_MAX_FRAGMENTED = 8
"""Most messages of one client of which fragments are missing; a further one drops the oldest."""
_MAX_FRAGMENTS = 10_000
"""Most fragments of one message."""
_FRAGMENT_TIMEOUT = 60.0
"""Seconds after its first fragment until an incomplete message is dropped."""
_LEAST_FRAGMENT = 64
"""Fewest characters in a sent fragment: each fragment also has the fields `op`, `id` and so on."""
_MAX_QUEUE = 1_000
"""Most messages that a throttled subscription keeps."""

_Name = Annotated[str, Meta(max_length=512)]
Id: TypeAlias = (
    Annotated[str, Meta(max_length=1024)] | Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)] | None
)
"""The client's name for an interaction; responses and statuses repeat it."""
_Number = float | int | None

Level = Literal["none", "error", "warning", "info"]
_LEVELS: tuple[Level, ...] = ("none", "error", "warning", "info")


class BadOperation(Exception):
    """A message that is no valid operation; the text is for the client."""

    def __init__(self, problem: str, id: Id = None) -> None:
        super().__init__(problem)
        self.id = id


class Operation(msgspec.Struct, tag_field="op", kw_only=True):
    """An operation that a client sends; each subclass is one `op`."""

    id: Id = None


class Advertise(Operation, tag="advertise"):
    """The client is going to publish on a topic."""

    topic: _Name
    type: _Name
    latch: bool | None = False
    """Whether later subscriptions get the last message too."""
    queue_size: _Number = None


class Unadvertise(Operation, tag="unadvertise"):
    """The client does not publish on a topic any more."""

    topic: _Name


class Publish(Operation, tag="publish"):
    """One message for a topic."""

    topic: _Name
    msg: Any = None


class Subscribe(Operation, tag="subscribe"):
    """The client wants the messages of a topic."""

    topic: _Name
    type: _Name | None = None
    throttle_rate: _Number = None
    """Milliseconds between two messages."""
    queue_length: _Number = None
    """Most messages that wait; with 0, messages that come too early are dropped."""
    fragment_size: _Number = None
    """Characters above which a message is sent in fragments."""
    compression: _Name | None = None


class Unsubscribe(Operation, tag="unsubscribe"):
    """The client does not want the messages of a topic any more."""

    topic: _Name


class CallService(Operation, tag="call_service"):
    """A call; the response is `service_response` with the same id."""

    service: _Name
    args: Any = None
    timeout: _Number = None
    """Seconds; 0 or less for no deadline."""
    fragment_size: _Number = None


class AdvertiseService(Operation, tag="advertise_service"):
    """The client offers a service; it gets `call_service` for each call."""

    type: _Name
    service: _Name


class UnadvertiseService(Operation, tag="unadvertise_service"):
    """The client does not offer a service any more."""

    service: _Name


class ServiceResponse(Operation, tag="service_response"):
    """The client's response to a call of its service."""

    service: _Name = ""
    values: Any = None
    result: bool = True


class SendActionGoal(Operation, tag="send_action_goal"):
    """A goal for an action; the end of the goal is `action_result` with the same id."""

    action: _Name
    action_type: _Name
    args: Any = None
    feedback: bool | None = False
    """Whether the client wants `action_feedback`."""
    fragment_size: _Number = None


class CancelActionGoal(Operation, tag="cancel_action_goal"):
    """The client cancels the goal that it has sent with the same id."""

    action: _Name


class AdvertiseAction(Operation, tag="advertise_action"):
    """The client offers an action; it gets `send_action_goal` for each goal."""

    action: _Name
    type: _Name


class UnadvertiseAction(Operation, tag="unadvertise_action"):
    """The client does not offer an action any more."""

    action: _Name


class ActionFeedback(Operation, tag="action_feedback"):
    """Feedback of a goal that the client executes."""

    action: _Name = ""
    values: Any = None


class ActionResult(Operation, tag="action_result"):
    """The end of a goal that the client executes; the status is a final one of `GoalStatus`."""

    action: _Name = ""
    values: Any = None
    status: int = 4
    result: bool = True


class SetLevel(Operation, tag="set_level"):
    """The least severe statuses that the client wants."""

    level: Level


class Fragment(Operation, tag="fragment"):
    """A part of a message."""

    data: str
    num: int
    total: int


_OPERATIONS: dict[str, type[Operation]] = {
    str(cls.__struct_config__.tag): cls for cls in Operation.__subclasses__()
}
_UNSUPPORTED = {
    "auth": "not supported; send the HTTP header Authorization with the request for the WebSocket",
    "png": "not supported; send the operation as JSON",
}
"""Operations of rosbridge_suite that do not exist here."""
_Any = (
    Advertise
    | Unadvertise
    | Publish
    | Subscribe
    | Unsubscribe
    | CallService
    | AdvertiseService
    | UnadvertiseService
    | ServiceResponse
    | SendActionGoal
    | CancelActionGoal
    | AdvertiseAction
    | UnadvertiseAction
    | ActionFeedback
    | ActionResult
    | SetLevel
    | Fragment
)
_decoder = msgspec.json.Decoder(_Any)
_MISTAKES = (msgspec.MsgspecError, ValueError, RecursionError, OverflowError)


def parse(text: str | bytes) -> Operation:
    """Return the operation in a client's message. Raises BadOperation."""
    if len(text) > MAX_MESSAGE:
        raise BadOperation(f"expected at most {MAX_MESSAGE} bytes, got {len(text)}")
    try:
        operation: Operation = _decoder.decode(text)
    except _MISTAKES:
        return _converted(_lenient(text))
    return operation


def _lenient(text: str | bytes) -> Any:
    """Read JSON, also with NaN and Infinity, which clients in Python write."""
    try:
        return msgspec.json.decode(text)
    except _MISTAKES as error:
        problem = "it is nested too deeply" if isinstance(error, RecursionError) else error
    try:
        value = json.loads(text)
        msgspec.json.encode(value)  # refuses text that cannot be sent on
    except _MISTAKES:
        raise BadOperation(f"expected an operation in JSON: {problem}") from None
    return value


def _converted(value: Any) -> Operation:
    if not isinstance(value, dict):
        raise BadOperation(f"expected a JSON object with the field op, got {_kind(value)}")
    known, name = _id_of(value), value.get("op")
    if isinstance(name, str) and name in _UNSUPPORTED:
        raise BadOperation(f"{name}: {_UNSUPPORTED[name]}", known)
    if not isinstance(name, str) or name not in _OPERATIONS:
        got = "none" if name is None else repr(name)[:80]
        raise BadOperation(f"unknown op {got}; there are {', '.join(_OPERATIONS)}", known)
    try:
        operation: Operation = msgspec.convert(value, _Any)
    except _MISTAKES as error:
        raise BadOperation(f"{name}: {error}", known) from None
    return operation


def _id_of(value: dict[str, Any]) -> Id:
    try:
        found: Id = msgspec.convert(value.get("id"), Id)
    except _MISTAKES:
        return None
    return found


def _kind(value: object) -> str:
    names = {list: "a list", str: "a string", bool: "a boolean", type(None): "null"}
    return names.get(type(value), "a number")


def encode(operation: Mapping[str, Any]) -> str:
    """Return an operation as JSON text."""
    return msgspec.json.encode(operation).decode()


def status(level: Level, text: str, id: Id = None) -> dict[str, Any]:
    """Return a status operation."""
    known = {} if id is None else {"id": id}
    return {"op": "status", "level": level, "msg": text, **known}


def is_wanted(level: Level, wanted: Level) -> bool:
    """Whether a client that set the level `wanted` gets statuses of this level."""
    return _LEVELS.index(level) <= _LEVELS.index(wanted)


def count_of(number: _Number, otherwise: int, most: int) -> int:
    """Return a number from a client as a count from 0 to `most`; `otherwise` for null."""
    if number is None or math.isnan(number):
        return otherwise
    return int(min(max(number, 0), most))


def split(text: str, size: int, name: str) -> list[str]:
    """Return the messages that carry this text: itself, or fragments of at most `size` characters.

    `name` is the id of the fragments; 0 as `size` means no limit.
    """
    if not size or len(text) <= size:
        return [text]
    size = max(size, _LEAST_FRAGMENT, -(-len(text) // _MAX_FRAGMENTS))
    parts = [text[start : start + size] for start in range(0, len(text), size)]
    total = len(parts)
    return [
        encode({"op": "fragment", "id": name, "data": part, "num": number, "total": total})
        for number, part in enumerate(parts)
    ]


class Fragments:
    """Joins the fragments of one client's messages; the number of incomplete ones is limited."""

    def __init__(self) -> None:
        self._incomplete: dict[Id, _Incomplete] = {}
        """In order of arrival."""

    def add(self, fragment: Fragment, now: float) -> str | None:
        """Take a fragment; return the text of its message once all fragments have arrived.

        Raises BadOperation; then the whole message is dropped.
        """
        for name, each in list(self._incomplete.items()):
            if now - each.since > _FRAGMENT_TIMEOUT:
                del self._incomplete[name]
        if fragment.id is None:
            raise BadOperation("fragment: expected an id, got none")
        found = self._incomplete.pop(fragment.id, None)
        message = _Incomplete(fragment.total, now) if found is None else found
        message.add(fragment)
        if message.is_complete:
            return message.text()
        while sum(each.size for each in self._incomplete.values()) + message.size > MAX_MESSAGE:
            self._incomplete.pop(next(iter(self._incomplete)))
        if len(self._incomplete) >= _MAX_FRAGMENTED:
            self._incomplete.pop(next(iter(self._incomplete)))
        self._incomplete[fragment.id] = message
        return None


class _Incomplete:
    """A message of which fragments are missing."""

    def __init__(self, total: int, since: float) -> None:
        self.since = since
        self.size = 0
        """Characters so far."""
        self._total = total
        self._parts: dict[int, str] = {}

    @property
    def is_complete(self) -> bool:
        return len(self._parts) == self._total

    def add(self, fragment: Fragment) -> None:
        problem = ""
        if fragment.total != self._total or not 0 < self._total <= _MAX_FRAGMENTS:
            problem = f"expected a total from 1 to {_MAX_FRAGMENTS}, the same in each fragment"
        elif not 0 <= fragment.num < self._total:
            problem = f"expected a num from 0 to {self._total - 1}, got {fragment.num}"
        if problem:
            raise BadOperation(f"fragment: {problem}", fragment.id)
        self.size += len(fragment.data) - len(self._parts.get(fragment.num, ""))
        if self.size > MAX_MESSAGE:
            problem = f"expected a message of at most {MAX_MESSAGE} characters"
            raise BadOperation(f"fragment: {problem}", fragment.id)
        self._parts[fragment.num] = fragment.data

    def text(self) -> str:
        return "".join(self._parts[number] for number in range(self._total))


_Item = TypeVar("_Item")


class Throttle(Generic[_Item]):
    """Spaces the messages of one subscription; `rate` is in seconds.

    Messages that come too early wait, at most `length` of them, the oldest are dropped; with the
    length 0 they are dropped at once.
    """

    def __init__(self, rate: float, length: int) -> None:
        self._rate = rate
        self._waiting: deque[_Item] = deque(maxlen=min(length, _MAX_QUEUE))
        self._next = float("-inf")
        """The instant from which the next message may be sent."""

    @property
    def due(self) -> float | None:
        """The instant at which a waiting message may be sent; None if none waits."""
        return self._next if self._waiting else None

    def offer(self, item: _Item, now: float) -> bool:
        """Return whether to send the message now; otherwise it waits or is dropped."""
        if self._waiting or now < self._next:
            self._waiting.append(item)
            return False
        self._next = now + self._rate
        return True

    def take(self, now: float) -> _Item | None:
        """Return the message that is due, None if none is."""
        if not self._waiting or now < self._next:
            return None
        self._next = now + self._rate
        return self._waiting.popleft()
