"""Runs each request of an exactly-once service once, and answers it as often as it comes.

The ledger decides what a request is; a run answers everybody who sent it; the store writes its
effect and its completion in one transaction, before anybody is answered. A lost connection does
not end a run, since its caller will come back: only who cancels, or whose deadline passes, gives
it up, and only before the transaction begins.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
import weakref
from collections.abc import Awaitable, Callable, Hashable
from functools import partial
from typing import Any

import msgspec

from taskrpc.callinfo import log_fields
from taskrpc.errors import (
    Code,
    HandlerFailed,
    OutcomeUnknown,
    RequestIdReused,
    ServerBusy,
    ServiceUnavailable,
    SessionExpired,
    StoreError,
    TaskRpcError,
)
from taskrpc.stepping import Stepper
from taskrpc.transport.base import IncomingCall
from taskrpc.transport.codec import Codec
from taskrpc.wire.once import Claim, Client, Completion, CompletionStore, Ledger, Verdict

log = logging.getLogger("taskrpc.server")

RETRY_AFTER = 0.5
_EXPIRE_EVERY = 60.0


class Effect(msgspec.Struct):
    """What a handler of an exactly-once service returns where its store is to do something.

    The store applies `effect` in one transaction with the record that the request is done.
    """

    response: Any
    effect: Any


class _Shared:
    """What all services of one store have in common."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = weakref.ref(loop)
        self.ledger: Ledger | None = None
        self.runs: dict[tuple[str, bytes, int], Run] = {}
        self.meanwhile: list[Completion] = []
        """Stored while the store is read: what is read may be older."""
        self.opening: asyncio.Task[None] | None = None
        self.store_id: asyncio.Future[bytes] = loop.create_future()
        self.desks = 0
        self.expires = 0.0


_shared: weakref.WeakKeyDictionary[CompletionStore, _Shared] = weakref.WeakKeyDictionary()


def _shared_of(store: CompletionStore) -> _Shared:
    loop = asyncio.get_running_loop()
    known = _shared.get(store)
    other = None if known is None else known.loop()
    if known is not None and known.desks and other not in (None, loop) and not other.is_closed():
        raise StoreError("the store serves another event loop; give each one a store of its own")
    if known is None or other is not loop:
        known = _shared[store] = _Shared(loop)
    return known


class Run(IncomingCall, eq=False):
    """One run of a request; it takes the place of the call that began it."""

    desk: OnceDesk
    callers: list[IncomingCall]
    """Who waits for the answer."""
    arrived: float
    """Seconds since 1970."""
    completion: Completion | None = None
    """Once the transaction has begun: what it remembers."""
    refused: bool = False
    """Whether the callback has done nothing, and is to be asked again."""

    @property
    def lane(self) -> Hashable:
        """Whose call it is: the first caller's."""
        return self.callers[0].lane

    def completed_by(self, response: Any) -> Completion | None:
        """What a handler that stores its own effect must store with it, if anything.

        From here on the run cannot be cancelled. Raises InvalidRequest for a response that cannot
        be sent.
        """
        if self.claim is None:
            return None
        self.completion = self.desk.completion(self, self.desk.codec.encode(response), 0)
        return self.completion

    def nothing_done(self) -> None:
        """Say that the response need not be remembered."""
        self.refused = True

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Store the effect and the completion, then answer everybody."""
        effect = None
        if isinstance(response, Effect):
            response, effect = response.response, response.effect
        if self.completion is not None:  # the handler has stored both itself
            body = self.completion.answer
            self.desk.done(self, self.completion, partial(_reply, response=response, body=body))
            return
        body = self.desk.codec.encode(response)
        answer = partial(_reply, response=response, body=body)
        if self.refused and effect is None:
            self.desk.refused(self, answer)
        else:
            self.desk.commit(self, body, 0, effect, answer)

    def fail(self, error: TaskRpcError) -> None:
        """Answer everybody with an error; one of the handler's own is remembered as an answer."""
        answer = partial(_fail, error=error)
        if isinstance(error, OutcomeUnknown):  # the service is given up; the run has its own end
            self.tell(answer)
        elif isinstance(error, HandlerFailed) and error.code is Code.OUTCOME_UNKNOWN:
            self.desk.unknown(self, OutcomeUnknown(error.message))
        elif self.completion is not None and not error.not_executed:
            problem = f"call {self.number} failed after it may have been stored"
            self.desk.unknown(self, OutcomeUnknown(problem))
        elif isinstance(error, HandlerFailed) and not error.not_executed and self.claim is not None:
            # As it travels: it need not be text. And with the code 0 it would be a response.
            body = error.message.encode("utf-8", "backslashreplace")
            self.desk.commit(self, body, int(error.code or Code.UNKNOWN), None, answer)
        else:
            self.desk.undone(self, error)

    def tell(self, answer: Callable[[IncomingCall], None]) -> None:
        """Answer everybody who waits; nobody does afterwards."""
        callers, self.callers = self.callers, []
        for call in callers:
            answer(call)

    def attach(self, call: IncomingCall) -> None:
        """Another sender of the same request waits too."""
        self.callers.append(call)
        call.on_cancel = partial(self._left, call)
        if self.deadline is not None:
            late = call.deadline
            self.deadline = None if late is None else max(self.deadline, late)

    def _left(self, call: IncomingCall) -> None:
        if call not in self.callers:
            return  # it has its answer
        self.callers.remove(call)
        # What one who leaves is told: for others it may run, also where it has not begun.
        call.started = self.started or bool(self.callers)
        if self.callers or self.completion is not None:
            return
        self.cancel()
        if not self.started:
            self.desk.undone(self, TaskRpcError("cancelled by the caller"))


class OnceDesk:
    """Stands before a service: what comes is run, attached, answered from memory, or refused.

    Args:
        store: where completions and effects are kept.
        codec: encodes and decodes the service's responses.
        serve: runs a call.
        stored: is told when nothing more is on its way to the store.
        wall_clock: seconds since 1970.
    """

    def __init__(
        self,
        store: CompletionStore,
        codec: Codec,
        serve: Callable[[IncomingCall], None],
        stored: Callable[[], object] = lambda: None,
        *,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self.codec = codec
        self._store = store
        self._serve = serve
        self._stored = stored
        self.storing = 0
        """Runs whose transaction has begun and not ended."""
        self._wall_clock = wall_clock
        self._loop = asyncio.get_running_loop()
        self._shared = _shared_of(store)
        self._stepper = Stepper(self._loop, lambda _: None)
        self._shared.desks += 1
        if self._shared.opening is None:
            self._open()

    @property
    def store_id(self) -> asyncio.Future[bytes]:
        """The store's name, once it is open."""
        return self._shared.store_id

    def close(self) -> None:
        """Nothing more will come."""
        self._stepper.close()
        shared = self._shared
        shared.desks -= 1
        if not shared.desks:
            # Whoever offers a service of this store next reads it anew: it may have changed hands.
            self._give_up_opening("the service was withdrawn")
            if _shared.get(self._store) is shared:
                del _shared[self._store]

    def arrived(self, call: IncomingCall) -> None:
        """Do with a call what its number says."""
        shared, claim = self._shared, call.claim
        if claim is None:  # a caller that does not count: at most once
            self._run(call, self._wall_clock())
        elif shared.ledger is None:
            self._wait_for_store(call)
        else:
            self._decided(call, claim, shared.ledger)

    # Runs end here

    def completion(self, run: Run, answer: bytes, code: int) -> Completion:
        """What is to be remembered of a run."""
        claim = run.claim
        assert claim is not None, "only a numbered request is remembered"
        number = claim.number
        return Completion(
            run.principal,
            number.client,
            number.sequence,
            number.first_incomplete,
            claim.fingerprint,
            answer,
            code,
            run.arrived,
        )

    def commit(
        self,
        run: Run,
        body: bytes,
        code: int,
        effect: Any,
        answer: Callable[[IncomingCall], None],
    ) -> None:
        """Store an effect and the completion, then answer."""
        completion = None if run.claim is None else self.completion(run, body, code)
        if completion is None and effect is None:
            self.done(run, None, answer)
            return
        run.completion = completion
        try:
            storing = self._store.complete(completion, effect)
        except BaseException as error:
            self._unstored(run, error)
            if isinstance(error, SystemExit | KeyboardInterrupt):
                raise
            return
        if storing is None:
            self.done(run, completion, answer)
            return
        self.storing += 1
        with contextlib.suppress(StopIteration):  # it did not have to wait
            self._stepper.step(_nothing, self._committed(storing, run, completion, answer))

    def done(
        self, run: Run, completion: Completion | None, answer: Callable[[IncomingCall], None]
    ) -> None:
        """A run's completion is stored: answer everybody."""
        if completion is not None and self._shared.ledger is not None:
            self._shared.ledger.completed(completion)
        elif completion is not None:
            self._shared.meanwhile.append(completion)
        self._ended(run)
        run.tell(answer)

    def undone(self, run: Run, error: TaskRpcError) -> None:
        """A run has left nothing behind: whoever sends the request again has it run."""
        self._left_nothing(run)
        # Cancelled not by these, who came when the run was being given up.
        run.tell(self.arrived if run.cancelled else partial(_fail, error=error))

    def refused(self, run: Run, answer: Callable[[IncomingCall], None]) -> None:
        """A run has left nothing behind but its answer."""
        self._left_nothing(run)
        run.tell(answer)

    def unknown(self, run: Run, error: OutcomeUnknown) -> None:
        """Nobody can tell whether a run's transaction was done, before the store is read anew."""
        log.error("%s: %s", run.service, error, extra=log_fields(run))
        self._ended(run)
        self._shared.ledger = None
        self._open()
        run.tell(partial(_fail, error=error))

    # Inside

    def _decided(self, call: IncomingCall, claim: Claim, ledger: Ledger) -> None:
        now = self._wall_clock()
        match ledger.decide(call.principal, claim.number, claim.fingerprint, now):
            case Verdict.NEW:
                if now >= self._shared.expires:
                    self._expire(ledger, now)
                self._run(call, now)
            case Verdict.ATTACH:
                text = "call %d of %s attaches to its first sending"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                self._shared.runs[_key(call, claim)].attach(call)
            case Verdict.DONE:
                text = "call %d of %s was done before"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                self._repeat(call, ledger.answer(call.principal, claim.number))
            case Verdict.STALE:
                problem = "the server does not remember this client: whether it ran is unknown"
                call.fail(SessionExpired(problem))
            case Verdict.REUSED:
                call.fail(RequestIdReused("another request was sent under this request id"))
            case Verdict.FULL:
                problem = f"{call.service} remembers too many requests"
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))

    def _run(self, call: IncomingCall, now: float) -> None:
        run = Run(
            call.service,
            call.caller,
            call.principal,
            call.role,
            call.number,
            call.deadline,
            call._clock,
            False,  # cancelled
            call.request,
            None,  # on_cancel
            False,  # started
            call.claim,
            self,
            [],
            now,
        )
        run.attach(call)
        if call.claim is not None:
            self._shared.runs[_key(call, call.claim)] = run
        self._serve(run)

    def _left_nothing(self, run: Run) -> None:
        if self._ended(run) and run.claim is not None and self._shared.ledger is not None:
            self._shared.ledger.abandoned(run.principal, run.claim.number)

    def _ended(self, run: Run) -> bool:
        """Whether this is the first end of the run, and nobody else runs its request by now."""
        if run.claim is None or self._shared.runs.get(key := _key(run, run.claim)) is not run:
            return False
        del self._shared.runs[key]
        return True

    def _repeat(self, call: IncomingCall, completion: Completion) -> None:
        if completion.code:
            call.fail(HandlerFailed(Code(completion.code), completion.answer.decode()))
            return
        try:
            call.reply(self.codec.decode(completion.answer), completion.answer)
        except TaskRpcError as error:
            problem = f"it ran before, and its answer cannot be read any more: {error}"
            call.fail(TaskRpcError(problem, not_executed=False))

    async def _committed(
        self,
        storing: Awaitable[None],
        run: Run,
        completion: Completion | None,
        answer: Callable[[IncomingCall], None],
    ) -> None:
        try:
            await storing
        except BaseException as error:
            self._unstored(run, error)
            if isinstance(error, SystemExit | KeyboardInterrupt):
                raise
        else:
            self.done(run, completion, answer)
        finally:
            self.storing -= 1
            if not self.storing:
                self._stored()

    def _unstored(self, run: Run, error: BaseException) -> None:
        if isinstance(error, TaskRpcError) and not isinstance(error, OutcomeUnknown):
            text = "%s cannot store what it did: %s"
            log.error(text, run.service, error, extra=log_fields(run))
            self.undone(run, HandlerFailed(Code.UNAVAILABLE, str(error)))
            return
        if not isinstance(error, OutcomeUnknown):  # no store's word: it may mean anything
            log.error("the store of %s failed:", run.service, exc_info=error, extra=log_fields(run))
            error = OutcomeUnknown(f"the store of {run.service} failed")
        self.unknown(run, error)

    def _expire(self, ledger: Ledger, now: float) -> None:
        self._shared.expires = now + _EXPIRE_EVERY
        if clients := ledger.expire(now):
            with contextlib.suppress(StopIteration):
                self._stepper.step(_nothing, self._forget(clients))

    async def _forget(self, clients: list[Client]) -> None:
        try:
            storing = self._store.complete(None, None, clients)
            if storing is not None:
                await storing
        except Exception as error:  # the next server finds them expired too
            log.warning("cannot forget clients: %s", error)

    # The store's beginning

    def _open(self) -> None:
        self._shared.opening = self._loop.create_task(self._opened())

    async def _opened(self) -> None:
        shared = self._shared
        try:
            remembered = await self._store.recall()
        except BaseException as error:
            if not shared.desks or shared.opening is not asyncio.current_task():
                return  # nobody wants to know any more
            log.error("the store of exactly-once services cannot be used: %s", error)
            self._give_up_opening(str(error))
            return
        if shared.opening is not asyncio.current_task():
            return  # it was read before somebody asked to read it anew
        shared.ledger = ledger = Ledger((*remembered.completions, *shared.meanwhile))
        shared.meanwhile = []
        for run in shared.runs.values():
            assert run.claim is not None, "only numbered runs are listed"
            ledger.runs(run.principal, run.claim, run.arrived)
        if not shared.store_id.done():
            shared.store_id.set_result(remembered.store_id)

    def _give_up_opening(self, problem: str) -> None:
        shared = self._shared
        if shared.opening is not None:
            shared.opening.cancel()
        if not shared.store_id.done():
            shared.store_id.set_exception(HandlerFailed(Code.UNAVAILABLE, problem))
            shared.store_id.exception()  # nobody may be left to ask

    def _wait_for_store(self, call: IncomingCall) -> None:
        shared = self._shared
        if shared.opening is None or shared.opening.done():
            self._open()  # it could not be read before

        def ready(_: object) -> None:
            if call.cancelled:
                return
            if shared.ledger is None and (shared.opening is None or shared.opening.done()):
                call.fail(ServiceUnavailable(f"the store of {call.service} cannot be used"))
            else:
                self.arrived(call)

        assert shared.opening is not None, "opened above"
        shared.opening.add_done_callback(ready)


def _key(call: IncomingCall, claim: Claim) -> tuple[str, bytes, int]:
    return call.principal, claim.number.client, claim.number.sequence


def _reply(call: IncomingCall, response: Any, body: bytes) -> None:
    try:
        call.reply(response, body)
    except TaskRpcError as error:  # it is too large for this caller
        call.fail(TaskRpcError(f"it ran; its answer cannot be sent: {error}", not_executed=False))


def _fail(call: IncomingCall, error: TaskRpcError) -> None:
    call.fail(error)


def _nothing() -> None:
    pass
