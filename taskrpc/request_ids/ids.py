"""Exactly once, by counting: what a request and its store must say.

A client numbers its requests to one store and says with each the first number for which it still
waits; what is below, nobody will ask for again. Above connections and transports: a number means
the same after a reconnect, and in another server of the same store.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Protocol

import msgspec

from taskrpc.errors import ProtocolError
from taskrpc.wire.frames import Body

OPEN_PER_CLIENT = 1024
"""Requests of one client that it has not yet reported as settled."""

_MOST_BEHIND = OPEN_PER_CLIENT // 2

_SHORT = 16
"""Bytes of a message that is its own fingerprint: to hash it would cost a tenth of the rest."""

_HEAD = struct.Struct("<16sQQ")
_HEAD_SIZE = _HEAD.size
_pack, _unpack = _HEAD.pack, _HEAD.unpack_from


class Number(msgspec.Struct, frozen=True, gc=False):
    """What a request of an exactly-once service carries before its message."""

    client: bytes
    """16 bytes, drawn by the client at random."""
    sequence: int
    """From 1; rising with each request of this client to this store."""
    first_incomplete: int
    """All its requests below have their answers, or nobody waits for these any more."""


def with_number(number: Number, body: bytes) -> bytes:
    """A request's body behind its number."""
    return _pack(number.client, number.sequence, number.first_incomplete) + body


class Claim(msgspec.Struct, eq=False):
    """What a request says that it is: which of its client's requests, and what it asks for."""

    client: bytes
    sequence: int
    first_incomplete: int
    """These three as in its `Number`."""
    fingerprint: bytes
    """Tells a repeated request from another one under the same number."""
    run: Any = None
    """What runs it, as long as something does."""
    known: Any = None
    """Where the server's ledger has it, as long as it runs."""


def claims_for(service: str) -> Callable[[Body], tuple[Claim, Body]]:
    """What cuts the number off a body which came for a service; gives the claim and the message.

    It raises ProtocolError where there is no valid number.
    """
    begun = hashlib.blake2b(service.encode() + b"\0", digest_size=16)
    tag = begun.digest()

    def claim(body: Body) -> tuple[Claim, Body]:
        try:
            client, sequence, first_incomplete = _unpack(body)
        except struct.error:
            raise ProtocolError("an exactly-once request without its number") from None
        if not 0 < first_incomplete <= sequence:
            problem = "an exactly-once request whose first open number is not up to its own"
            raise ProtocolError(problem)
        message = body[_HEAD_SIZE:]
        if len(message) <= _SHORT:
            return Claim(client, sequence, first_incomplete, tag + message), message
        hashing = begun.copy()
        hashing.update(message)
        return Claim(client, sequence, first_incomplete, hashing.digest()), message

    return claim


def number_of_id(service: str, request_id: str) -> Number:
    """The number that stands for a name which a user gave to one request of a service."""
    # A command line may hold bytes that are no text.
    named = f"{service}\0{request_id}".encode("utf-8", "surrogatepass")
    digest = hashlib.sha256(named).digest()
    return Number(digest[:16], 1, 1)


class Completion(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What a store keeps of a request that is done: enough to answer it once more."""

    principal: str
    """Who the client proved to be, "" where everybody is the same."""
    client: bytes
    sequence: int
    first_incomplete: int
    fingerprint: bytes
    answer: bytes
    """The response's body; for a failure the sentence."""
    code: int
    """0 for a response, else the `Code` of the failure."""
    at: float
    """When it came, on the clock by which leases end."""


class Remembered(msgspec.Struct, frozen=True):
    """What a store has of earlier servers."""

    store_id: bytes
    """16 bytes, drawn at random when the store was made."""
    completions: tuple[Completion, ...] = ()


Client = tuple[str, bytes]
"""Principal and client id."""


class CompletionStore(Protocol):
    """Keeps completions together with the effects of the requests that they complete."""

    async def recall(self) -> Remembered:
        """Return what is remembered. Raises TaskRpcError for a store that cannot be read."""

    def complete(
        self, completion: Completion | None, effect: Any, forgotten: Sequence[Client] = ()
    ) -> Awaitable[None] | None:
        """Apply an effect, remember its completion and forget clients: all of it or nothing.

        May be `async`; a plain one has done it when it returns. A request that came without a
        number has an effect, but no completion.
        What the same client has completed below `completion.first_incomplete` is forgotten too.
        When it is done, all this survives whatever the store promises to survive. `effect` is what
        the handler returned, None where it has none.

        Raises:
            OutcomeUnknown: nobody can tell whether it was done; ask `recall`.
            TaskRpcError: nothing was changed.
        """


class Numbers:
    """What a client counts: its requests to one store.

    Args:
        client: 16 bytes, by which the store knows who counts.
        store_id: the store's name.
    """

    def __init__(self, client: bytes, store_id: bytes = b"") -> None:
        self.client = client
        self.store_id = store_id
        self.is_over = False
        """Whether to count on as another client: this one is forgotten, or too much lies behind
        its first open number."""
        self._next = 1
        self._first = 1
        self._settled: set[int] = set()
        """What is settled above the first that is not."""

    def take(self) -> int:
        """The number of the next request; `settle` it in the end."""
        sequence, _ = self.take_for(b"")
        return sequence

    def settle(self, sequence: int) -> None:
        """Nobody waits for a request's answer any more."""
        if sequence != self._first:
            if sequence > self._first:
                self._settled.add(sequence)
            return
        sequence += 1
        if settled := self._settled:
            while sequence in settled:
                settled.remove(sequence)
                sequence += 1
        self._first = sequence

    def number(self, sequence: int) -> Number:
        """What a request that is not settled carries now."""
        return Number(self.client, sequence, self._first)

    def take_for(self, body: bytes) -> tuple[int, bytes]:
        """Take the next number; returns it, and a request's body behind it."""
        sequence, first = self._next, self._first
        self._next = sequence + 1
        if sequence - first >= _MOST_BEHIND:
            self.is_over = True
        return sequence, _pack(self.client, sequence, first) + body
