"""Request ids of exactly-once services, and the records that their stores keep.

A client numbers its requests to one store. With each request it reports the first sequence number
for which it still waits; it repeats no request below that. An id belongs to the client and the
store, not to a connection: it stays valid after a reconnect, and for another server of the same
store.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Protocol, TypeAlias

import msgspec

from taskrpc.core.wire.frames import Body
from taskrpc.errors import ProtocolError

OPEN_PER_CLIENT = 1024
"""Requests of one client that it has not yet reported as settled."""

_LONGEST_GAP = OPEN_PER_CLIENT // 2
"""The largest gap between a client's first open request and its next one. After that the client
takes a new client id. Otherwise one slow request would keep all later ones in the store."""

_SHORT = 16
"""A message of at most so many bytes is its own fingerprint, because hashing it is too slow."""

_HEAD = struct.Struct("<16sQQ")
_HEAD_SIZE = _HEAD.size
_pack, _unpack = _HEAD.pack, _HEAD.unpack_from


class RequestId(msgspec.Struct, frozen=True, gc=False):
    """The id that a request of an exactly-once service carries before its message."""

    client: bytes
    """16 bytes, drawn by the client at random."""
    sequence: int
    """From 1, rising with each request of this client to this store."""
    first_incomplete: int
    """The client waits for no response below this sequence number."""


def with_request_id(request_id: RequestId, body: bytes) -> bytes:
    """Put a request id before a request's body."""
    return _pack(request_id.client, request_id.sequence, request_id.first_incomplete) + body


IdentifiedMessage: TypeAlias = tuple[bytes, int, int, bytes, Body]
"""A request of an exactly-once service: the first four fields of its `ReceivedId`, and its message.

A plain tuple, because most requests need no `ReceivedId`."""


class ReceivedId(msgspec.Struct, eq=False):
    """A request id as the server received it, with a fingerprint of the request."""

    client: bytes
    sequence: int
    first_incomplete: int
    """These three as in `RequestId`."""
    fingerprint: bytes
    """Tells a repeated request from another request with the same id."""
    execution: Any = None
    """The `exactly_once.Execution` of the request while it runs, else None."""
    is_looked_up: bool = False
    """Whether the server has looked for it in a store that it shares with other servers."""

    def completion(self, principal: str, body: bytes, code: int, at: float) -> Completion:
        """Return the record that completes the request, with a response or a failure."""
        client, sequence, first = self.client, self.sequence, self.first_incomplete
        return Completion(principal, client, sequence, first, self.fingerprint, body, code, at)


def id_splitter(service: str) -> Callable[[Body], IdentifiedMessage]:
    """Return a function that splits a body of this service into the request id and the message.

    It raises ProtocolError for a body without a valid request id.
    """
    seeded = hashlib.blake2b(service.encode() + b"\0", digest_size=16)
    tag = seeded.digest()

    def split(body: Body) -> IdentifiedMessage:
        try:
            client, sequence, first_incomplete = _unpack(body)
        except struct.error:
            raise ProtocolError("an exactly-once request without its request id") from None
        if not 0 < first_incomplete <= sequence:
            raise ProtocolError(
                "an exactly-once request with a wrong request id: expected"
                f" 0 < first open number <= sequence number, got {first_incomplete} and {sequence}"
            )
        message = body[_HEAD_SIZE:]
        if len(message) <= _SHORT:
            return client, sequence, first_incomplete, tag + message, message
        hashing = seeded.copy()
        hashing.update(message)
        return client, sequence, first_incomplete, hashing.digest(), message

    return split


def named_request_id(service: str, name: str) -> RequestId:
    """Return the id of a request that a user named, such as by `--request-id`."""
    # A command line may hold bytes that are not text.
    named = f"{service}\0{name}".encode("utf-8", "surrogatepass")
    digest = hashlib.sha256(named).digest()
    return RequestId(digest[:16], 1, 1)


class Completion(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The stored record of a completed request, from which a repeated request is answered.

    Stores encode it as an array: the order of the fields is the file format.
    """

    principal: str
    """The account that the client authenticated as, "" where there are no accounts."""
    client: bytes
    sequence: int
    first_incomplete: int
    """These three as in `RequestId`."""
    fingerprint: bytes
    response: bytes
    """The encoded response; for a failure the error message."""
    code: int
    """0 for a response, else the `Code` of the failure."""
    at: float
    """When the request arrived, in seconds on the store's `LeaseClock`."""


class StoredCompletions(msgspec.Struct, frozen=True):
    """The completions that a store holds from earlier servers."""

    store_id: bytes
    """16 bytes, drawn at random when the store was made."""
    completions: tuple[Completion, ...] = ()


ClientKey: TypeAlias = tuple[str, bytes]
"""A client as stores know it: its principal and its client id."""


class CompletionStore(Protocol):
    """Keeps completions together with the effects of the requests that they complete."""

    async def recall(self) -> StoredCompletions:
        """Return what the store holds. Raises TaskRpcError for a store that cannot be read."""

    def complete(
        self, completion: Completion | None, effect: Any, forgotten: Sequence[ClientKey] = ()
    ) -> Awaitable[None] | None:
        """Apply an effect, keep its completion and forget clients: all of it or nothing.

        May be `async`; a plain function must be done when it returns. A request without a request
        id has an effect, but no completion. `effect` is the handler's `Effect.effect`, None if the
        handler returned no `Effect`.

        The store also forgets the completions of the same client below
        `completion.first_incomplete`. Afterwards all this is as durable as the store promises.

        Raises:
            OutcomeUnknown: the change may have been made; `recall` shows whether it was.
            TaskRpcError: nothing was changed.
        """


class SharedCompletionStore(CompletionStore, Protocol):
    """A completion store that several servers share at the same time.

    A request that this server does not know may have run at another server. So the server looks
    each request up before it decides. Another server may still be completing the request: therefore
    a handler that stores a completion itself must refuse to store a second one.
    """

    async def look_up(self, client: ClientKey) -> Sequence[Completion]:
        """Return the completions of a client. Raises TaskRpcError."""


class RequestCounter:
    """The sequence numbers of one client id for one store.

    Args:
        client: the client id, 16 bytes.
        store_id: the store's id.
    """

    def __init__(self, client: bytes, store_id: bytes = b"") -> None:
        self.client = client
        self.store_id = store_id
        self.is_retired = False
        """Whether the next request needs a counter with a new client id: the server forgot this
        one, or the gap behind its first open request is too long."""
        self._next = 1
        self.first = 1
        """The first sequence number that is not settled."""
        self.settled: set[int] = set()
        """Settled sequence numbers above `first`."""

    def take(self) -> int:
        """Return the next sequence number; call `settle` with it in the end."""
        sequence, _ = self.take_for(b"")
        return sequence

    def settle(self, sequence: int) -> None:
        """Report that the caller no longer waits for the response to a request."""
        if sequence != self.first:
            if sequence > self.first:
                self.settled.add(sequence)
            return
        sequence += 1
        if settled := self.settled:
            while sequence in settled:
                settled.remove(sequence)
                sequence += 1
        self.first = sequence

    def request_id(self, sequence: int) -> RequestId:
        """Return the id that an unsettled request carries if it is sent now."""
        return RequestId(self.client, sequence, self.first)

    def take_for(self, body: bytes) -> tuple[int, bytes]:
        """Take the next sequence number; return it, and the body with its request id in front."""
        sequence, first = self._next, self.first
        self._next = sequence + 1
        if sequence - first >= _LONGEST_GAP:
            self.is_retired = True
        return sequence, _pack(self.client, sequence, first) + body


class RequestCounters:
    """One process's request counters, by store.

    `draw_client_id` returns 16 random bytes.
    """

    def __init__(self, draw_client_id: Callable[[], bytes]) -> None:
        self._draw_client_id = draw_client_id
        self._counters: dict[bytes, RequestCounter] = {}

    def counter(self, store_id: bytes) -> RequestCounter:
        """Return the counter for the next request to a store."""
        known = self._counters.get(store_id)
        if known is None or known.is_retired:
            known = self._counters[store_id] = RequestCounter(self._draw_client_id(), store_id)
        return known
