"""The ledger of a store: which of its clients' requests are new, running, done or forgotten."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from taskrpc.core.request_ids.ids import OPEN_PER_CLIENT, ClientKey, Completion, ReceivedId

CLIENT_LEASE = 24 * 3600.0
"""Seconds for which a client is remembered after its last request. Only the time in which a server
of the store runs counts."""

REPEATED_FOR = CLIENT_LEASE / 2
"""Seconds for which a client repeats a request that may have run. Later the server may have
forgotten the request, and would run it again."""

MEMORY = 128 * 2**20
"""Bytes that a ledger remembers. An account may use as many bytes as are still free: a single one
gets half of them, and after ten such accounts there is still room for an eleventh."""

PER_CLIENT, PER_REQUEST = 500, 400
"""Bytes that are counted for a client (each `--request-id` is one), and for a request besides its
response."""

_REORDER_AFTER = 60.0
"""Seconds between two moves of an active client to the end of the order in which leases end: a move
for each request would cost as much as the decision."""


class Verdict(Enum):
    """What the server must do with a request."""

    NEW = "run it"
    ATTACH = "it runs already: answer with the response of that execution"
    DONE = "answer with the stored response"
    STALE = "refuse it: the store cannot tell any more whether it ran"
    REUSED = "refuse it: its id belongs to another request"
    FULL = "refuse it: the client has too many open requests, or its account takes too much memory"


# Python 3.11 needs as long to look up a member in the Enum class as to look up a client.
_NEW, _STALE, _FULL = Verdict.NEW, Verdict.STALE, Verdict.FULL


class ClientRecord:
    """One client in the ledger."""

    __slots__ = ("first_incomplete", "placed", "requests", "used")

    def __init__(self, now: float) -> None:
        self.first_incomplete = 1
        """The client waits for no response below this sequence number."""
        self.used = now
        """When the last request arrived."""
        self.placed = now
        """When the record was last moved behind all others."""
        self.requests: dict[int, Completion | ReceivedId] = {}
        """By sequence number: the completion of a request that is done, the received id of one that
        runs."""

    def settle(self, first_incomplete: int) -> int:
        """Forget the completions below a sequence number; return their size in bytes.

        Requests below it that still run stay until they are done.
        """
        known, begin, size = self.requests, self.first_incomplete, 0
        self.first_incomplete = first_incomplete
        gap = first_incomplete - begin
        numbers: Iterable[int] = range(begin, first_incomplete)
        if gap > 1 and gap > len(known):  # nearly always 1; a client may also name any number
            numbers = [number for number in known if number < first_incomplete]
        for number in numbers:
            if number in known and (found := known[number]).__class__ is Completion:
                del known[number]
                size += PER_REQUEST + len(found.response)
        return size

    def enter(self, completion: Completion) -> int:
        """Enter a completion; return by how many bytes the record has grown."""
        sequence, first = completion.sequence, completion.first_incomplete
        requests, begin = self.requests, self.first_incomplete
        if (
            first - begin == 1
            and sequence not in requests
            and (settled := requests.get(begin)).__class__ is Completion
        ):
            # The usual case: a plain request, and its client has settled one.
            del requests[begin]
            self.first_incomplete = first
            requests[sequence] = completion
            return len(completion.response) - len(settled.response)
        more = -self.settle(first) if first > begin else 0
        if sequence < self.first_incomplete:
            return more - _size(requests.pop(sequence, None))
        known = requests.get(sequence)
        requests[sequence] = completion
        if known.__class__ is ReceivedId:  # the completion takes its place
            return more + len(completion.response)
        return more + _size(completion) - _size(known)

    @property
    def size(self) -> int:
        """Bytes."""
        return PER_CLIENT + sum(_size(each) for each in self.requests.values())

    @property
    def is_idle(self) -> bool:
        """Whether none of the client's requests runs."""
        return all(isinstance(each, Completion) for each in self.requests.values())


def _size(request: Completion | ReceivedId | None) -> int:
    if request is None:
        return 0
    return PER_REQUEST + (len(request.response) if isinstance(request, Completion) else 0)


def _verdict_on_repetition(known: Completion | ReceivedId, received: ReceivedId) -> Verdict:
    """Decide about a request whose sequence number is known."""
    verdict = Verdict.DONE if isinstance(known, Completion) else Verdict.ATTACH
    return verdict if known.fingerprint == received.fingerprint else Verdict.REUSED


class Ledger:
    """The requests of all clients of one store.

    Times are seconds on the store's `LeaseClock`, which does not jump.
    """

    def __init__(
        self,
        completions: Iterable[Completion] = (),
        *,
        lease: float = CLIENT_LEASE,
        memory: int = MEMORY,
        open_per_client: int = OPEN_PER_CLIENT,
    ) -> None:
        self._lease = lease
        self._memory = memory
        self._half_memory = memory // 2
        self._open_per_client = open_per_client
        self.size = 0
        """Bytes in use."""
        self._sizes: dict[str, int] = {}
        """Bytes in use, by principal."""
        self._clients: dict[ClientKey, ClientRecord] = {}
        """In the order in which leases end, accurate to `_REORDER_AFTER`."""
        for completion in sorted(completions, key=lambda each: each.at):
            client = (completion.principal, completion.client)
            if record := self._clients.get(client):
                record.used = completion.at
                self._place_last(client, record)
            self.completed(completion)

    def __len__(self) -> int:
        return len(self._clients)

    def decide(self, principal: str, received: ReceivedId, now: float) -> Verdict:
        """Decide what to do with a request; after NEW it counts as running."""
        client = (principal, received.client)
        record = self._clients.get(client)
        if record is None:
            return self._decide_first(client, received, now)
        sequence, first, begin = (
            received.sequence,
            received.first_incomplete,
            record.first_incomplete,
        )
        if sequence < begin:
            return _STALE
        requests, sizes, more = record.requests, self._sizes, 0
        if first > begin:
            more = -record.settle(first)
        record.used = now
        if now - record.placed > _REORDER_AFTER:
            self._place_last(client, record)
        # The sizes are written once: most requests settle one and add one.
        size = self.size + more
        size_of_principal = sizes[principal] + more
        verdict = _NEW
        if sequence in requests:
            verdict = _verdict_on_repetition(requests[sequence], received)
        # No share is reserved for an account: the number of accounts is not known.
        elif len(requests) >= self._open_per_client or self._memory - size <= size_of_principal:
            verdict = _FULL
        else:
            requests[sequence] = received
            size += PER_REQUEST
            size_of_principal += PER_REQUEST
        self.size = size
        sizes[principal] = size_of_principal
        return verdict

    def admit(
        self, principal: str, client: bytes, sequence: int, first_incomplete: int, now: float
    ) -> ClientRecord | None:
        """Return the record of the client if `decide` would certainly say NEW; else None.

        Nothing counts as running then. Before the caller lets other requests be decided, it must
        pass the completion to `ClientRecord.enter` and `grown`, or call `add_running`.
        """
        record = self._clients.get((principal, client))
        if (
            record is None
            or first_incomplete < record.first_incomplete
            or sequence in (requests := record.requests)
            or len(requests) >= self._open_per_client
            or self.size >= self._half_memory  # else every account may use more
            or now - record.placed > _REORDER_AFTER
        ):
            return None
        record.used = now
        return record

    def _decide_first(self, client: ClientKey, received: ReceivedId, now: float) -> Verdict:
        """Decide about a request of a client that is not known."""
        principal, _ = client
        if received.first_incomplete > 1:
            return _STALE
        has_room = self._memory - self.size > self._sizes.get(principal, 0)
        if not self._open_per_client or not has_room:
            return _FULL
        self.add_running(principal, received, now)
        return _NEW

    def add_running(self, principal: str, received: ReceivedId, now: float) -> None:
        """Add a running request; this ledger or an earlier one has decided NEW for it."""
        record = self._record((principal, received.client), now)
        if received.first_incomplete > record.first_incomplete:
            self._add_size(principal, -record.settle(received.first_incomplete))
        if received.sequence not in record.requests:
            record.requests[received.sequence] = received
            self._add_size(principal, PER_REQUEST)

    def completion(self, principal: str, received: ReceivedId) -> Completion:
        """Return the completion of the request; the verdict must be DONE."""
        found = self._clients[principal, received.client].requests[received.sequence]
        assert isinstance(found, Completion), "only a request that is done has a completion"
        return found

    def running(self, principal: str, received: ReceivedId) -> ReceivedId:
        """Return the received id of the running request; the verdict must be ATTACH."""
        found = self._clients[principal, received.client].requests[received.sequence]
        assert isinstance(found, ReceivedId), "only a running request can be attached to"
        return found

    def all_running(self) -> list[tuple[str, ReceivedId]]:
        """Return the received ids of all requests that run, with their principals."""
        return [
            (principal, each)
            for (principal, _), record in self._clients.items()
            for each in record.requests.values()
            if isinstance(each, ReceivedId)
        ]

    def completed(self, completion: Completion) -> None:
        """Enter a stored completion."""
        client = principal, _ = completion.principal, completion.client
        record = self._clients.get(client) or self._record(client, completion.at)
        if more := record.enter(completion):
            self.size += more
            self._sizes[principal] += more

    def grown(self, completion: Completion, record: ClientRecord, more: int) -> None:
        """Count the bytes by which a record of `admit` has grown through this completion."""
        client = principal, _ = completion.principal, completion.client
        if self._clients.get(client) is record:
            self.size += more
            self._sizes[principal] += more
        else:  # forgotten meanwhile: the callback has ended the only running request
            self.completed(completion)

    def learn(self, completion: Completion) -> None:
        """Enter a completion that another server has stored, unless its request runs here."""
        record = self._clients.get((completion.principal, completion.client))
        running = None if record is None else record.requests.get(completion.sequence)
        if not isinstance(running, ReceivedId):
            self.completed(completion)

    def abandoned(self, principal: str, received: ReceivedId) -> None:
        """Forget a request that did not run after all: its repetition is new."""
        client = (principal, received.client)
        record = self._clients.get(client)
        if record is not None:
            if record.requests.get(received.sequence) is received:
                del record.requests[received.sequence]
                self._add_size(principal, -PER_REQUEST)
            if record.first_incomplete == 1 and not record.requests:
                self._forget(client)  # as if the client had never sent anything

    def expire(self, now: float) -> list[ClientKey]:
        """Forget the clients whose lease has ended, and return them."""
        ended: list[ClientKey] = []
        for client, record in self._clients.items():
            if record.placed + self._lease > now:
                break
            if record.used + self._lease <= now and record.is_idle:
                ended.append(client)
        for client in ended:
            self._forget(client)
        return ended

    def _record(self, client: ClientKey, now: float) -> ClientRecord:
        record = self._clients.get(client)
        if record is None:
            record = self._clients[client] = ClientRecord(now)
            self._add_size(client[0], PER_CLIENT)
        return record

    def _place_last(self, client: ClientKey, record: ClientRecord) -> None:
        del self._clients[client]
        self._clients[client] = record
        record.placed = record.used

    def _forget(self, client: ClientKey) -> None:
        self._add_size(client[0], -self._clients.pop(client).size)

    def _add_size(self, principal: str, more: int) -> None:
        self.size += more
        size = self._sizes[principal] = self._sizes.get(principal, 0) + more
        if not size:
            del self._sizes[principal]
