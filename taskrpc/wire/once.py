"""Exactly once, by counting: which requests are new, run, are done, or are forgotten.

A client numbers its requests to one store and says with each the first number for which it still
waits. The ledger knows the numbers of every client; what is below that first one it may forget.
Above connections and transports: a number means the same after a reconnect, and in another server
of the same store.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Awaitable, Iterable, Sequence
from enum import Enum
from typing import Any, Protocol

import msgspec

from taskrpc.errors import ProtocolError

LEASE = 24 * 3600.0
"""Seconds for which a client is remembered after its last request."""

OPEN_PER_CLIENT = 1024
"""Requests of one client that it has not yet reported as settled."""

MEMORY = 128 * 2**20
"""Bytes that a ledger remembers. An account may have as many as are still free: one alone gets a
half, and whoever comes after ten that take what they can finds an eleventh."""

PER_CLIENT, PER_REQUEST = 500, 400
"""Bytes that are counted for a client (each `--request-id` is one), and for a request besides its
answer."""

_HEAD = struct.Struct("<16sQQ")


class Number(msgspec.Struct, frozen=True):
    """What a request of an exactly-once service carries before its message."""

    client: bytes
    """16 bytes, drawn by the client at random."""
    sequence: int
    """From 1; rising with each request of this client to this store."""
    first_incomplete: int
    """All its requests below have their answers, or nobody waits for these any more."""


def with_number(number: Number, body: bytes) -> bytes:
    """A request's body behind its number."""
    return _HEAD.pack(number.client, number.sequence, number.first_incomplete) + body


def cut_number(body: bytes) -> tuple[Number, bytes]:
    """A request's number and its body. Raises ProtocolError where there is no valid number."""
    if len(body) < _HEAD.size:
        raise ProtocolError("an exactly-once request without its number")
    number = Number(*_HEAD.unpack_from(body))
    if not 0 < number.first_incomplete <= number.sequence:
        raise ProtocolError("an exactly-once request whose first open number is not up to its own")
    return number, body[_HEAD.size :]


class Claim(msgspec.Struct, frozen=True):
    """What a request says that it is: which of its client's requests, and what it asks for."""

    number: Number
    fingerprint: bytes


def number_of_id(service: str, request_id: str) -> Number:
    """The number that stands for a name which a user gave to one request of a service."""
    # A command line may hold bytes that are no text.
    named = f"{service}\0{request_id}".encode("utf-8", "surrogatepass")
    digest = hashlib.sha256(named).digest()
    return Number(digest[:16], 1, 1)


def fingerprint(service: str, body: bytes) -> bytes:
    """What tells a repeated request from another one under the same number."""
    return hashlib.blake2b(service.encode() + b"\0" + body, digest_size=16).digest()


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
    wall: float = 0.0
    """The time of day when it was done, in seconds since 1970; 0 where nobody noted it."""


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


class Verdict(Enum):
    """What is to be done with a request."""

    NEW = "run it"
    ATTACH = "it runs: answer with what that run yields"
    DONE = "answer with what is remembered"
    STALE = "nobody can know any more whether it ran"
    REUSED = "its number belongs to another request"
    FULL = "refuse it: the client has too many open requests, or its account takes too much memory"


class _Known:
    """What is known of one client."""

    __slots__ = ("first_incomplete", "requests", "size", "used")

    def __init__(self, now: float) -> None:
        self.first_incomplete = 1
        self.used = now
        self.requests: dict[int, Completion | bytes] = {}
        """By their numbers: the completion of what is done, the fingerprint of what runs."""
        self.size = PER_CLIENT
        """Bytes."""

    def decide(self, number: Number, fingerprint: bytes, most_open: int) -> Verdict:
        found = self.requests.get(number.sequence)
        if found is None:
            if len(self.requests) >= most_open:
                return Verdict.FULL
            self.put(number.sequence, fingerprint)
            return Verdict.NEW
        verdict, belongs = Verdict.ATTACH, found
        if isinstance(found, Completion):
            verdict, belongs = Verdict.DONE, found.fingerprint
        return verdict if belongs == fingerprint else Verdict.REUSED

    def settle(self, first_incomplete: int) -> None:
        """Forget what is done below a number; what runs there stays until it is done."""
        settled = range(self.first_incomplete, first_incomplete)
        self.first_incomplete = first_incomplete
        # Not `len`, which takes no more than half of the numbers that there are.
        few = settled if settled.stop - settled.start < len(self.requests) else list(self.requests)
        for number in few:
            if number in settled and isinstance(self.requests.get(number), Completion):
                self.drop(number)

    def put(self, sequence: int, request: Completion | bytes) -> None:
        self.drop(sequence)
        self.requests[sequence] = request
        self.size += _size(request)

    def drop(self, sequence: int) -> None:
        request = self.requests.pop(sequence, None)
        if request is not None:
            self.size -= _size(request)

    @property
    def is_idle(self) -> bool:
        return all(isinstance(each, Completion) for each in self.requests.values())


def _size(request: Completion | bytes) -> int:
    return PER_REQUEST + (len(request.answer) if isinstance(request, Completion) else 0)


class Ledger:
    """The numbers of all clients of one store.

    Times are seconds on a clock that does not leap: by it leases end.
    """

    def __init__(
        self,
        completions: Iterable[Completion] = (),
        *,
        lease: float = LEASE,
        memory: int = MEMORY,
        open_per_client: int = OPEN_PER_CLIENT,
    ) -> None:
        self._lease = lease
        self._memory = memory
        self._most_open = open_per_client
        self.size = 0
        """Bytes that are taken."""
        self._sizes: dict[str, int] = {}  # by principal
        # The least recently used first: whose lease ends next.
        self._clients: dict[Client, _Known] = {}
        for completion in sorted(completions, key=lambda each: each.at):
            client = (completion.principal, completion.client)
            if known := self._clients.pop(client, None):
                known.used = completion.at
                self._clients[client] = known
            self.completed(completion)

    def __len__(self) -> int:
        return len(self._clients)

    def decide(self, principal: str, number: Number, fingerprint: bytes, now: float) -> Verdict:
        """What to do with a request; after NEW it counts as running."""
        client = (principal, number.client)
        known, before = self._clients.get(client), 0
        if known is None:
            if number.first_incomplete > 1:
                return Verdict.STALE
            known = _Known(now)
        elif number.sequence < known.first_incomplete:
            return Verdict.STALE
        else:
            self._settle(principal, known, number.first_incomplete)
            before = known.size
        # No share is set apart for each: nobody knows how many accounts will come.
        has_room = self._memory - self.size > self._sizes.get(principal, 0)
        verdict = known.decide(number, fingerprint, self._most_open if has_room else 0)
        if before or verdict is Verdict.NEW:
            self._charge(principal, known.size - before)
            known.used = now
            self._clients.pop(client, None)
            self._clients[client] = known
        return verdict

    def runs(self, principal: str, claim: Claim, now: float) -> None:
        """A request runs that an earlier ledger decided to run."""
        known = self._known((principal, claim.number.client), now)
        if claim.number.sequence not in known.requests:
            known.put(claim.number.sequence, claim.fingerprint)
            self._charge(principal, PER_REQUEST)

    def answer(self, principal: str, number: Number) -> Completion:
        """What a request that is DONE was answered."""
        found = self._clients[principal, number.client].requests[number.sequence]
        assert isinstance(found, Completion), "only what is done has an answer"
        return found

    def completed(self, completion: Completion) -> None:
        """A request is done, and its completion stored."""
        known = self._known((completion.principal, completion.client), completion.at)
        self._settle(completion.principal, known, completion.first_incomplete)
        before = known.size
        if completion.sequence >= known.first_incomplete:
            known.put(completion.sequence, completion)
        else:
            known.drop(completion.sequence)
        self._charge(completion.principal, known.size - before)

    def abandoned(self, principal: str, number: Number) -> None:
        """A request did not run after all: sent again, it is new."""
        client = (principal, number.client)
        known = self._clients.get(client)
        if known is not None:
            before = known.size
            known.drop(number.sequence)
            self._charge(principal, known.size - before)
            if known.first_incomplete == 1 and not known.requests:
                self._forget(client)  # nothing is known of it

    def expire(self, now: float) -> list[Client]:
        """Forget the clients whose lease has ended, and return them."""
        ended: list[Client] = []
        for client, known in self._clients.items():
            if known.used + self._lease > now:
                break
            if known.is_idle:
                ended.append(client)
        for client in ended:
            self._forget(client)
        return ended

    def _known(self, client: Client, now: float) -> _Known:
        known = self._clients.get(client)
        if known is None:
            known = self._clients[client] = _Known(now)
            self._charge(client[0], PER_CLIENT)
        return known

    def _settle(self, principal: str, known: _Known, first_incomplete: int) -> None:
        if first_incomplete > known.first_incomplete:
            before = known.size
            known.settle(first_incomplete)
            self._charge(principal, known.size - before)

    def _forget(self, client: Client) -> None:
        self._charge(client[0], -self._clients.pop(client).size)

    def _charge(self, principal: str, more: int) -> None:
        self.size += more
        size = self._sizes[principal] = self._sizes.get(principal, 0) + more
        if not size:
            del self._sizes[principal]


class Numbers:
    """What a client counts: its requests to one store."""

    def __init__(self, client: bytes) -> None:
        self.client = client
        self._next = 1
        self._open: dict[int, None] = {}  # rising

    def take(self) -> int:
        """The number of the next request; `settle` it in the end."""
        sequence = self._next
        self._next += 1
        self._open[sequence] = None
        return sequence

    def settle(self, sequence: int) -> None:
        """Nobody waits for a request's answer any more."""
        self._open.pop(sequence, None)

    @property
    def is_wide(self) -> bool:
        """Whether too much lies behind the first open number: count on as another client."""
        return self._next - next(iter(self._open), self._next) > OPEN_PER_CLIENT // 2

    def number(self, sequence: int) -> Number:
        """What a request carries now."""
        return Number(self.client, sequence, next(iter(self._open), sequence))
