"""What all exactly-once services of one store have in common: its ledger, and what runs."""

from __future__ import annotations

import asyncio
import logging
import time
import weakref
from collections.abc import Callable, Iterable

from taskrpc.errors import Code, HandlerFailed, StoreError, TaskRpcError, told
from taskrpc.exactly_once.runs import Run
from taskrpc.request_ids.ids import Completion, CompletionStore
from taskrpc.request_ids.ledger import Ledger
from taskrpc.transport.connection.deadline_timer import clock_of

log = logging.getLogger("taskrpc.server")


class LeaseClock:
    """The clock by which leases end. It counts only the time in which a server of the store runs.

    The time between two servers cannot be distinguished from a leap of the machine's clock. If it
    counted, several leaps could end a lease within minutes, and a repeated request would run again.
    So the clock continues from the newest completion of the store.

    Args:
        completions: those of the store.
        wall: seconds since 1970, for a store without completions.
        ticks: what the loop's clock shows now.
    """

    def __init__(self, completions: Iterable[Completion], wall: float, ticks: float) -> None:
        self.offset = max((each.at for each in completions), default=wall) - ticks
        """The offset from the loop's clock."""


class Shared:
    """The state of one store on one event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = weakref.ref(loop)
        self.clock: LeaseClock | None = None
        """Set once the store has been read."""
        self.ledger: Ledger | None = None
        """None while the store is being read."""
        self._before: Ledger | None = None
        """What knows what runs, while the store is read anew."""
        self._store_id: asyncio.Future[bytes] = loop.create_future()
        self.desks = 0
        self.expires = 0.0
        """When to look for leases that have ended."""
        self._meanwhile: list[Completion] = []
        """Stored while the store is read: what is read may be older."""
        self._opening: asyncio.Task[None] | None = None

    # Reading the store

    def open(self, store: CompletionStore, *, anew: bool = False) -> None:
        """Read the store, unless it is read or being read; `anew`: even then."""
        if anew and self.ledger is not None:
            self._before, self.ledger = self.ledger, None
        if anew or (self.ledger is None and not self._is_opening):
            loop = asyncio.get_running_loop()
            self._opening = loop.create_task(self._opened(store))

    def store_id(self, store: CompletionStore) -> asyncio.Future[bytes]:
        """The store's name, once it is open; one that could not be read is read again."""
        if self.desks and self.is_given_up:
            if self._store_id.exception() is not None:
                self._store_id = asyncio.get_running_loop().create_future()
            self.open(store)
        return self._store_id

    def when_open(self, then: Callable[[], object]) -> None:
        """Call back when the store has been read, or could not be."""
        assert self._opening is not None, "a reading has begun"
        self._opening.add_done_callback(lambda _: then())

    @property
    def is_given_up(self) -> bool:
        """Whether the store could not be read."""
        return self.ledger is None and not self._is_opening

    def give_up(self, problem: str) -> None:
        """Stop reading, and wake the callers that wait for the store's name."""
        if self._opening is not None:
            self._opening.cancel()
        if not self._store_id.done():
            self._store_id.set_exception(HandlerFailed(Code.UNAVAILABLE, problem))
            self._store_id.exception()  # nobody may be left to ask

    # What runs

    def end(self, run: Run, completion: Completion | None = None) -> bool:
        """A run has ended, and what is to be remembered of it is stored.

        Returns whether this is its first end, and its request had a number.
        """
        claim = run.claim
        if claim is not None:
            if claim.run is run:
                claim.run = None
            else:  # it had its end before, and the ledger need not have it any more
                claim = None
        if completion is not None:
            if self.ledger is not None:
                self.ledger.completed(completion, claim)
            else:
                self._meanwhile.append(completion)
        return claim is not None

    def end_without_trace(self, run: Run) -> None:
        """A run has left nothing behind: sent again, its request is new."""
        if self.end(run) and run.claim is not None and self.ledger is not None:
            self.ledger.abandoned(run.principal, run.claim)

    @property
    def _is_opening(self) -> bool:
        return self._opening is not None and not self._opening.done()

    async def _opened(self, store: CompletionStore) -> None:
        try:
            remembered = await store.recall()
        except BaseException as error:
            if not self.desks or self._opening is not asyncio.current_task():
                return  # nobody wants to know any more
            log.error("the store of exactly-once services cannot be used: %s", error)
            problem = told(error) if isinstance(error, TaskRpcError) else "the store failed"
            self.give_up(problem)
            return
        if self._opening is not asyncio.current_task():
            return  # the reading began before the request to read again
        if self.clock is None:
            now = clock_of(asyncio.get_running_loop())()
            self.clock = LeaseClock(remembered.completions, time.time(), now)
        self.ledger = ledger = Ledger((*remembered.completions, *self._meanwhile))
        self._meanwhile = []
        for principal, claim in self._before.all_running() if self._before else ():
            if claim.run is not None:
                ledger.runs(principal, claim, claim.run.arrived)
        self._before = None
        if not self._store_id.done():
            self._store_id.set_result(remembered.store_id)


_shared: weakref.WeakKeyDictionary[CompletionStore, Shared] = weakref.WeakKeyDictionary()


def shared_of(store: CompletionStore) -> Shared:
    """The state of a store; raises StoreError where another event loop uses it."""
    loop = asyncio.get_running_loop()
    known = _shared.get(store)
    other = None if known is None else known.loop()
    if known is not None and known.desks and other not in (None, loop) and not other.is_closed():
        raise StoreError("the store serves another event loop; give each one a store of its own")
    if known is None or other is not loop:
        known = _shared[store] = Shared(loop)
    return known


def forget(store: CompletionStore, shared: Shared) -> None:
    """No service of this store is offered any more: the next one reads the store again."""
    shared.give_up("the service was withdrawn")
    if _shared.get(store) is shared:
        del _shared[store]
