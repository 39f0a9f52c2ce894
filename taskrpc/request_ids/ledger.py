"""What a server knows of its clients' requests: which are new, run, are done, or are forgotten."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from taskrpc.request_ids.ids import OPEN_PER_CLIENT, Claim, Client, Completion

LEASE = 24 * 3600.0
"""Seconds for which a client is remembered after its last request. Only the time in which a server
of the store runs counts."""

REPEATED_FOR = LEASE / 2
"""Seconds for which a client repeats a request that may have run. Later the server may have
forgotten the request, and would run it again."""

MEMORY = 128 * 2**20
"""Bytes that a ledger remembers. An account may have as many as are still free: one alone gets a
half, and whoever comes after ten that take what they can finds an eleventh."""

PER_CLIENT, PER_REQUEST = 500, 400
"""Bytes that are counted for a client (each `--request-id` is one), and for a request besides its
answer."""

_PLACE_KEPT = 60.0
"""Seconds for which a client that is heard of again keeps its place among those that may be
forgotten: to take its place anew would cost as much as to decide."""


class Verdict(Enum):
    """What is to be done with a request."""

    NEW = "run it"
    ATTACH = "it runs: answer with what that run yields"
    DONE = "answer with what is remembered"
    STALE = "nobody can know any more whether it ran"
    REUSED = "its number belongs to another request"
    FULL = "refuse it: the client has too many open requests, or its account takes too much memory"


# In Python 3.11 to look a member up in its class costs as much as to look it up in the ledger.
_NEW, _STALE, _FULL = Verdict.NEW, Verdict.STALE, Verdict.FULL


class _Known:
    """What is known of one client."""

    __slots__ = ("first_incomplete", "placed", "requests", "used")

    def __init__(self, now: float) -> None:
        self.first_incomplete = 1
        self.used = now
        self.placed = now
        """When it was put behind all others."""
        self.requests: dict[int, Completion | Claim] = {}
        """By their numbers: the completion of what is done, the claim of what runs."""

    def settle(self, first_incomplete: int) -> int:
        """Forget what is done below a number; returns its bytes.

        What runs there stays until it is done.
        """
        known, begin, size = self.requests, self.first_incomplete, 0
        self.first_incomplete = first_incomplete
        numbers: Iterable[int] = range(begin, first_incomplete)
        if first_incomplete - begin > len(known):
            numbers = [number for number in known if number < first_incomplete]
        for number in numbers:
            found = known.pop(number, None)
            if found.__class__ is Completion:
                size += PER_REQUEST + len(found.answer)
            elif found is not None:
                known[number] = found
        return size

    @property
    def size(self) -> int:
        """Bytes."""
        return PER_CLIENT + sum(_size(each) for each in self.requests.values())

    @property
    def is_idle(self) -> bool:
        return all(isinstance(each, Completion) for each in self.requests.values())


def _size(request: Completion | Claim | None) -> int:
    if request is None:
        return 0
    return PER_REQUEST + (len(request.answer) if isinstance(request, Completion) else 0)


def _again(known: Completion | Claim, claim: Claim) -> Verdict:
    """What to do with a request whose number is known."""
    verdict = Verdict.DONE if isinstance(known, Completion) else Verdict.ATTACH
    return verdict if known.fingerprint == claim.fingerprint else Verdict.REUSED


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
        # The least recently placed first: whose lease ends next, but for `_PLACE_KEPT`.
        self._clients: dict[Client, _Known] = {}
        for completion in sorted(completions, key=lambda each: each.at):
            client = (completion.principal, completion.client)
            if known := self._clients.get(client):
                known.used = completion.at
                self._place_last(client, known)
            self.completed(completion)

    def __len__(self) -> int:
        return len(self._clients)

    def decide(self, principal: str, claim: Claim, now: float) -> Verdict:
        """What to do with a request; after NEW it counts as running."""
        client = (principal, claim.client)
        known = self._clients.get(client)
        if known is None:
            return self._met(client, claim, now)
        sequence, first, begin = claim.sequence, claim.first_incomplete, known.first_incomplete
        if sequence < begin:
            return _STALE
        requests, sizes, more = known.requests, self._sizes, 0
        if first > begin:
            done = requests.get(begin)
            if first == begin + 1 and done.__class__ is Completion:
                # As `settle` does. So it is nearly always, and a call would cost half as much as
                # to decide.
                del requests[begin]
                known.first_incomplete = first
                more = -PER_REQUEST - len(done.answer)
            else:
                more = -known.settle(first)
        known.used = now
        if now - known.placed > _PLACE_KEPT:
            self._place_last(client, known)
        # Charged once, not for each: most requests settle the one before.
        taken = self.size + more
        theirs = sizes[principal] + more
        verdict = _NEW
        if sequence in requests:
            verdict = _again(requests[sequence], claim)
        # No share is set apart for each: nobody knows how many accounts will come.
        elif len(requests) >= self._most_open or self._memory - taken <= theirs:
            verdict = _FULL
        else:
            requests[sequence] = claim
            claim.known = known
            taken += PER_REQUEST
            theirs += PER_REQUEST
        self.size = taken
        sizes[principal] = theirs
        return verdict

    def _met(self, client: Client, claim: Claim, now: float) -> Verdict:
        """What to do with a request of a client that is not known."""
        principal, _ = client
        if claim.first_incomplete > 1:
            return _STALE
        has_room = self._memory - self.size > self._sizes.get(principal, 0)
        if not self._most_open or not has_room:
            return _FULL
        self.runs(principal, claim, now)
        return _NEW

    def runs(self, principal: str, claim: Claim, now: float) -> None:
        """A request runs that was decided to run, be it by an earlier ledger."""
        known = self._known((principal, claim.client), now)
        claim.known = None
        if claim.first_incomplete > known.first_incomplete:
            self._charge(principal, -known.settle(claim.first_incomplete))
        if claim.sequence not in known.requests:
            known.requests[claim.sequence] = claim
            claim.known = known
            self._charge(principal, PER_REQUEST)

    def answer(self, principal: str, claim: Claim) -> Completion:
        """What a request that is DONE was answered."""
        found = self._clients[principal, claim.client].requests[claim.sequence]
        assert isinstance(found, Completion), "only what is done has an answer"
        return found

    def running(self, principal: str, claim: Claim) -> Claim:
        """The first claim to a request that is to ATTACH."""
        found = self._clients[principal, claim.client].requests[claim.sequence]
        assert isinstance(found, Claim), "only what runs can be attached to"
        return found

    def all_running(self) -> list[tuple[str, Claim]]:
        """The claims to everything that runs, with their principals."""
        return [
            (principal, each)
            for (principal, _), known in self._clients.items()
            for each in known.requests.values()
            if isinstance(each, Claim)
        ]

    def completed(self, completion: Completion, claim: Claim | None = None) -> None:
        """A request is done, and its completion stored; `claim` is what has run, where that did."""
        sequence = completion.sequence
        if claim is None or (known := claim.known) is None:
            self._enter(completion)
            return
        claim.known = None
        if sequence < known.first_incomplete:
            self._enter(completion)
            return
        known.requests[sequence] = completion  # in the claim's place: only the answer is more
        more = len(completion.answer)
        self.size += more
        self._sizes[completion.principal] += more

    def _enter(self, completion: Completion) -> None:
        principal, sequence = completion.principal, completion.sequence
        known = self._known((principal, completion.client), completion.at)
        more, requests = 0, known.requests
        if completion.first_incomplete > known.first_incomplete:
            more = -known.settle(completion.first_incomplete)
        if sequence >= known.first_incomplete:
            more += _size(completion) - _size(requests.get(sequence))
            requests[sequence] = completion
        else:
            more -= _size(requests.pop(sequence, None))
        self.size += more
        self._sizes[principal] += more

    def abandoned(self, principal: str, claim: Claim) -> None:
        """A request did not run after all: sent again, it is new."""
        client = (principal, claim.client)
        claim.known = None
        known = self._clients.get(client)
        if known is not None:
            if known.requests.get(claim.sequence) is claim:
                del known.requests[claim.sequence]
                self._charge(principal, -PER_REQUEST)
            if known.first_incomplete == 1 and not known.requests:
                self._forget(client)  # nothing is known of it

    def expire(self, now: float) -> list[Client]:
        """Forget the clients whose lease has ended, and return them."""
        ended: list[Client] = []
        for client, known in self._clients.items():
            if known.placed + self._lease > now:
                break
            if known.used + self._lease <= now and known.is_idle:
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

    def _place_last(self, client: Client, known: _Known) -> None:
        del self._clients[client]
        self._clients[client] = known
        known.placed = known.used

    def _forget(self, client: Client) -> None:
        self._charge(client[0], -self._clients.pop(client).size)

    def _charge(self, principal: str, more: int) -> None:
        self.size += more
        size = self._sizes[principal] = self._sizes.get(principal, 0) + more
        if not size:
            del self._sizes[principal]
