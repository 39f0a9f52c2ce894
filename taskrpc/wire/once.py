"""Exactly once, by counting: which requests are new, run, are done, or are forgotten.

A client numbers its requests to one store and says with each the first number for which it still
waits. The ledger knows the numbers of every client; what is below that first one it may forget.
Above connections and transports: a number means the same after a reconnect, and in another server
of the same store.
"""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from collections.abc import Awaitable, Iterable, Sequence
from enum import Enum
from typing import Any, Protocol

import msgspec

from taskrpc.errors import ProtocolError

LEASE = 24 * 3600.0
"""Seconds for which a client is remembered after its last request."""

OPEN_PER_CLIENT = 1024
"""Requests of one client that it has not yet reported as settled."""

CLIENTS = 100_000
"""Clients that a ledger remembers; each `--request-id` is one."""

ONE_OF = 10
"""One account may have this part of them, so that it cannot keep the others out."""

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
    """Seconds on the store's clock: it goes on while a server has the store, and never leaps."""


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
    FULL = "refuse it: the client has too many open requests, or there are too many clients"


class _Known:
    """What is known of one client."""

    __slots__ = ("first_incomplete", "requests", "used")

    def __init__(self, now: float) -> None:
        self.first_incomplete = 1
        self.used = now
        self.requests: dict[int, Completion | bytes] = {}
        """By their numbers: the completion of what is done, the fingerprint of what runs."""

    def decide(self, number: Number, fingerprint: bytes, most_open: int) -> Verdict:
        if number.sequence < self.first_incomplete:
            return Verdict.STALE
        if number.first_incomplete > self.first_incomplete:
            self.settle(number.first_incomplete)
        found = self.requests.get(number.sequence)
        if found is None:
            if len(self.requests) >= most_open:
                return Verdict.FULL
            self.requests[number.sequence] = fingerprint
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
                del self.requests[number]

    @property
    def is_idle(self) -> bool:
        return all(isinstance(each, Completion) for each in self.requests.values())


class Ledger:
    """The numbers of all clients of one store. Times are seconds on the store's clock."""

    def __init__(
        self,
        completions: Iterable[Completion] = (),
        *,
        lease: float = LEASE,
        clients: int = CLIENTS,
        open_per_client: int = OPEN_PER_CLIENT,
    ) -> None:
        self._lease = lease
        self._most_clients = clients
        self._most_of_one = max(1, clients // ONE_OF)
        self._most_open = open_per_client
        # The least recently used first: whose lease ends next.
        self._clients: dict[Client, _Known] = {}
        self._counts: Counter[str] = Counter()
        """How many of them each principal has."""
        for completion in sorted(completions, key=lambda each: each.at):
            client = (completion.principal, completion.client)
            known = self._known(client, completion.at)
            known.used = completion.at
            del self._clients[client]
            self._clients[client] = known
            self.completed(completion)

    def __len__(self) -> int:
        return len(self._clients)

    def decide(self, principal: str, number: Number, fingerprint: bytes, now: float) -> Verdict:
        """What to do with a request; after NEW it counts as running."""
        client = (principal, number.client)
        known = self._clients.get(client)
        if known is None:
            if number.first_incomplete > 1:
                return Verdict.STALE
            if self._is_full(principal):
                return Verdict.FULL
            known = self._known(client, now)
        verdict = known.decide(number, fingerprint, self._most_open)
        if verdict is not Verdict.STALE:
            known.used = now
            del self._clients[client]
            self._clients[client] = known
        return verdict

    def runs(self, principal: str, claim: Claim, now: float) -> None:
        """A request runs that an earlier ledger decided to run."""
        number = claim.number
        known = self._known((principal, number.client), now)
        known.requests.setdefault(number.sequence, claim.fingerprint)

    def answer(self, principal: str, number: Number) -> Completion:
        """What a request that is DONE was answered."""
        found = self._clients[principal, number.client].requests[number.sequence]
        assert isinstance(found, Completion), "only what is done has an answer"
        return found

    def completed(self, completion: Completion) -> None:
        """A request is done, and its completion stored."""
        client = (completion.principal, completion.client)
        known = self._known(client, completion.at)
        if completion.first_incomplete > known.first_incomplete:
            known.settle(completion.first_incomplete)
        if completion.sequence >= known.first_incomplete:
            known.requests[completion.sequence] = completion
        else:
            known.requests.pop(completion.sequence, None)

    def abandoned(self, principal: str, number: Number) -> None:
        """A request did not run after all: sent again, it is new."""
        client = (principal, number.client)
        known = self._clients.get(client)
        if known is not None:
            known.requests.pop(number.sequence, None)
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

    def _is_full(self, principal: str) -> bool:
        if len(self._clients) >= self._most_clients:
            return True
        # Without accounts everybody is the same.
        return bool(principal) and self._counts[principal] >= self._most_of_one

    def _known(self, client: Client, now: float) -> _Known:
        known = self._clients.get(client)
        if known is None:
            known = self._clients[client] = _Known(now)
            self._counts[client[0]] += 1
        return known

    def _forget(self, client: Client) -> None:
        del self._clients[client]
        self._counts[client[0]] -= 1
        if not self._counts[client[0]]:
            del self._counts[client[0]]


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
