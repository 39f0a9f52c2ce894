"""The state that all exactly-once services of one store share: its ledger, and what runs."""

from __future__ import annotations

import asyncio
import logging
import weakref
from collections.abc import Callable, Iterable

from taskrpc.core.request_ids.ids import Completion, CompletionStore
from taskrpc.core.request_ids.ledger import Ledger
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.connection.deadline_timer import clock_of
from taskrpc.core.transport.time_of_day import time_of_day
from taskrpc.errors import Code, HandlerFailed, StoreError, TaskRpcError, text_for_callers

log = logging.getLogger("taskrpc.server")


class LeaseClock:
    """The clock by which leases end. It counts only the time in which a server of the store runs.

    The time between two servers cannot be distinguished from a jump of the machine's clock. If it
    counted, several jumps could end a lease within minutes, and a repeated request would run again.
    So the clock continues from the newest completion of the store.

    Args:
        completions: those of the store.
        wall: seconds since 1970, for a store without completions.
        ticks: the present time of the loop's clock, in seconds.
    """

    def __init__(self, completions: Iterable[Completion], wall: float, ticks: float) -> None:
        self.offset = max((each.at for each in completions), default=wall) - ticks
        """The offset from the loop's clock."""


class StoreState:
    """The state of one store on one event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = weakref.ref(loop)
        self.clock: LeaseClock | None = None
        """None until the store has been read for the first time."""
        self.ledger: Ledger | None = None
        """None while the store is being read, and when it could not be read."""
        self.deduplicators = 0
        """How many services use the store. Each `Deduplicator` counts itself."""
        self.next_expiry = 0.0
        """The instant on the lease clock at which to look for leases that have ended."""
        self._earlier_ledger: Ledger | None = None
        """The ledger that knows what runs, while the store is read again."""
        self._store_id: asyncio.Future[bytes] = loop.create_future()
        """Resolved when the store has been read."""
        self._completed_meanwhile: list[Completion] = []
        """Completions stored while the store is read; the reading may lack them."""
        self._opening: asyncio.Task[None] | None = None
        """The newest reading of the store."""

    # Reading the store

    def open(self, store: CompletionStore, *, again: bool = False) -> None:
        """Read the store, if it is not read or being read already; with `again`, in any case."""
        if again and self.ledger is not None:
            self._earlier_ledger, self.ledger = self.ledger, None
        if again or (self.ledger is None and not self._is_opening):
            loop = asyncio.get_running_loop()
            self._opening = loop.create_task(self._read(store))

    def store_id(self, store: CompletionStore) -> asyncio.Future[bytes]:
        """Return a future of the store's id; a store that could not be read is read again."""
        if self.deduplicators and self.is_unreadable:
            if self._store_id.exception() is not None:
                self._store_id = asyncio.get_running_loop().create_future()
            self.open(store)
        return self._store_id

    def when_open(self, then: Callable[[], object]) -> None:
        """Call `then` when the store has been read, or could not be read."""
        assert self._opening is not None, "a reading has begun"
        self._opening.add_done_callback(lambda _: then())

    @property
    def is_unreadable(self) -> bool:
        """Whether the store could not be read."""
        return self.ledger is None and not self._is_opening

    def stop_reading(self, problem: str) -> None:
        """Stop reading; coroutines that wait for the store's id get an error with this text."""
        if self._opening is not None:
            self._opening.cancel()
        if not self._store_id.done():
            self._store_id.set_exception(HandlerFailed(Code.UNAVAILABLE, problem))
            self._store_id.exception()  # else asyncio warns if no coroutine waits for the id

    # What runs

    def end(self, execution: IncomingCall, completion: Completion | None = None) -> bool:
        """Note that an execution has ended, and that its completion is stored.

        Returns whether this is its first end, and it has a request id.
        """
        received = execution.received_id
        if received is not None:
            if received.execution is execution:
                received.execution = None
            else:  # it has ended before, and the ledger may have forgotten it
                received = None
        if completion is not None:
            self.stored(completion)
        return received is not None

    def stored(self, completion: Completion) -> None:
        """Note that a completion is stored."""
        if self.ledger is not None:
            self.ledger.completed(completion)
        else:
            self._completed_meanwhile.append(completion)

    def end_without_trace(self, execution: IncomingCall) -> None:
        """Note that an execution has stored nothing: a repetition of its request runs again."""
        received = execution.received_id
        if self.end(execution) and received is not None and self.ledger is not None:
            self.ledger.abandoned(execution.principal, received)

    @property
    def _is_opening(self) -> bool:
        return self._opening is not None and not self._opening.done()

    async def _read(self, store: CompletionStore) -> None:
        try:
            stored = await store.recall()
        except BaseException as error:
            if not self.deduplicators or self._opening is not asyncio.current_task():
                return  # no service uses the result
            log.error("the store of exactly-once services cannot be used: %s", error)
            problem = (
                text_for_callers(error) if isinstance(error, TaskRpcError) else "the store failed"
            )
            self.stop_reading(problem)
            return
        if self._opening is not asyncio.current_task():
            return  # a later reading replaces this one
        if self.clock is None:
            now = clock_of(asyncio.get_running_loop())()
            self.clock = LeaseClock(stored.completions, time_of_day(), now)
        self.ledger = ledger = Ledger((*stored.completions, *self._completed_meanwhile))
        self._completed_meanwhile = []
        for principal, received in (
            self._earlier_ledger.all_running() if self._earlier_ledger else ()
        ):
            if received.execution is not None:
                ledger.add_running(principal, received, received.execution.arrived)
        self._earlier_ledger = None
        if not self._store_id.done():
            self._store_id.set_result(stored.store_id)


_states: weakref.WeakKeyDictionary[CompletionStore, StoreState] = weakref.WeakKeyDictionary()


def state_of(store: CompletionStore) -> StoreState:
    """Return the state of a store. Raises StoreError if another event loop uses the store."""
    loop = asyncio.get_running_loop()
    known = _states.get(store)
    other = None if known is None else known.loop()
    is_used = known is not None and known.deduplicators
    if is_used and other not in (None, loop) and not other.is_closed():
        raise StoreError("the store serves another event loop; give each one a store of its own")
    if known is None or other is not loop:
        known = _states[store] = StoreState(loop)
    return known


def release(store: CompletionStore, state: StoreState) -> None:
    """Forget the state of a store that no service uses: the next service reads the store again."""
    state.stop_reading("the service was withdrawn")
    if _states.get(store) is state:
        del _states[store]
