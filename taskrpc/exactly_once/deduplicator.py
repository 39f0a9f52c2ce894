"""The desk before an exactly-once service: what comes is run, attached, answered or refused."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from taskrpc.callinfo import log_fields
from taskrpc.errors import (
    Code,
    HandlerFailed,
    OutcomeUnknown,
    RequestIdReused,
    ServerBusy,
    ServiceUnavailable,
    SessionExpired,
    TaskRpcError,
    told,
)
from taskrpc.exactly_once.runs import Run
from taskrpc.exactly_once.store_state import forget, shared_of
from taskrpc.execution.stepping import Stepper
from taskrpc.request_ids.ids import Claim, Client, Completion, CompletionStore
from taskrpc.request_ids.ledger import Ledger, Verdict
from taskrpc.transport.base import IncomingCall
from taskrpc.transport.codec import Codec

if TYPE_CHECKING:
    from taskrpc.observer import OnceStatus

log = logging.getLogger("taskrpc.server")

RETRY_AFTER = 0.5
_EXPIRE_EVERY = 60.0
_NEW = Verdict.NEW  # in Python 3.11 to look it up in its class costs as much as to decide


class OnceDesk:
    """Stands before a service: what comes is run, attached, answered from memory, or refused.

    Args:
        store: where completions and effects are kept.
        codec: encodes and decodes the service's responses.
        serve: runs a call.
    """

    def __init__(
        self,
        store: CompletionStore,
        codec: Codec,
        serve: Callable[[IncomingCall], None],
    ) -> None:
        self.codec = codec
        self._store = store
        self._serve = serve
        self.storing: dict[IncomingCall, Callable[[], object]] = {}
        """Runs whose transaction has begun and not ended; what stands here is called at its end."""
        self._begun = 0
        self._repeats = dict.fromkeys(Verdict, 0)
        self._shared = shared_of(store)
        self._stepper = Stepper(asyncio.get_running_loop(), lambda _: None)
        self._shared.desks += 1
        self._shared.open(store)

    def store_id(self) -> asyncio.Future[bytes]:
        """The store's name, once it is open; one that could not be read is read again."""
        return self._shared.store_id(self._store)

    def status(self) -> OnceStatus:
        """What was asked, and what is remembered."""
        from taskrpc.observer import OnceStatus  # few programs ask

        ledger = self._shared.ledger
        verdicts = self._repeats | {Verdict.NEW: self._begun}
        requests = {verdict.name.lower(): count for verdict, count in verdicts.items()}
        return OnceStatus(requests, len(ledger or ()), 0 if ledger is None else ledger.size)

    def close(self) -> None:
        """Nothing more will come."""
        self._stepper.close()
        self._shared.desks -= 1
        if not self._shared.desks:  # the store may change hands
            forget(self._store, self._shared)

    def arrived(self, call: IncomingCall) -> None:
        """Do with a call what its number says."""
        shared, claim, now = self._shared, call.claim, call.arrived
        if claim is not None:  # else the caller does not count: at most once
            ledger, clock = shared.ledger, shared.clock
            if ledger is None or clock is None:
                self._wait_for_store(call)
                return
            now += clock.offset
            if now >= shared.expires:
                self._expire(ledger, now)
            verdict = ledger.decide(call.principal, claim, now)
            if verdict is not _NEW:
                self._repeated(call, claim, verdict, ledger)
                return
            self._begun += 1
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
            claim,
            now,
            self,
            [call],
        )
        call.on_cancel = run.left
        if claim is not None:
            claim.run = run
        self._serve(run)

    # Runs end here

    def commit(
        self,
        run: Run,
        completion: Completion | None,
        effect: Any,
        error: TaskRpcError | None = None,
    ) -> None:
        """Store an effect and the completion, then answer, with the error if there is one."""
        if completion is None and effect is None:
            self.done(run, None, error)
            return
        run.completion, run.is_storing = completion, True
        try:
            storing = self._store.complete(completion, effect)
        except BaseException as problem:
            self._unstored(run, problem)
            if isinstance(problem, SystemExit | KeyboardInterrupt):
                raise
            return
        if storing is None:  # as `done` does: most stores are as quick
            ledger, claim = self._shared.ledger, run.claim
            if completion is None or claim is None or claim.run is not run or ledger is None:
                self._shared.end(run, completion)
            else:
                claim.run = None
                ledger.completed(completion, claim)
            run.tell(error)
            return
        with contextlib.suppress(StopIteration):  # it did not have to wait
            self._stepper.step(_nothing, self._committed(storing, run, completion, error))
            self.storing[run] = _nothing

    def done(
        self, run: Run, completion: Completion | None, error: TaskRpcError | None = None
    ) -> None:
        """A run's completion is stored: answer everybody."""
        self._shared.end(run, completion)
        run.tell(error)

    def undone(self, run: Run, error: TaskRpcError) -> None:
        """A run has stored nothing: the request runs again when it is repeated."""
        self._shared.end_without_trace(run)
        if not run.cancelled:
            run.tell(error)
            return
        callers, run.callers = run.callers, []
        for call in callers:  # they came when the run was being given up, not by them
            self.arrived(call)

    def refused(self, run: Run) -> None:
        """A run has left nothing behind but its answer."""
        self._shared.end_without_trace(run)
        run.tell()

    def unknown(self, run: Run, error: OutcomeUnknown) -> None:
        """Nobody can tell whether a run's transaction was done, before the store is read anew."""
        log.error("%s: %s", run.service, error, extra=log_fields(run))
        self._shared.end(run)
        self._shared.open(self._store, anew=True)
        run.tell(OutcomeUnknown(told(error)))

    # Inside

    def _repeated(self, call: IncomingCall, claim: Claim, verdict: Verdict, ledger: Ledger) -> None:
        self._repeats[verdict] += 1
        match verdict:
            case Verdict.ATTACH:
                text = "call %d of %s attaches to its first sending"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                run: Run = ledger.running(call.principal, claim).run
                run.attach(call)
            case Verdict.DONE:
                text = "call %d of %s was done before"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                self._repeat(call, ledger.answer(call.principal, claim))
            case Verdict.STALE:
                problem = "the server does not remember this client: whether it ran is unknown"
                call.fail(SessionExpired(problem))
            case Verdict.REUSED:
                call.fail(RequestIdReused("another request was sent under this request id"))
            case Verdict.FULL:
                whose = f" of the account {call.principal}" if call.principal else ""
                problem = f"{call.service} remembers too many requests{whose}"
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))

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
        error: TaskRpcError | None,
    ) -> None:
        try:
            await storing
        except BaseException as problem:
            self._unstored(run, problem)
            if isinstance(problem, SystemExit | KeyboardInterrupt):
                raise
        else:
            self.done(run, completion, error)
        finally:
            self.storing.pop(run, _nothing)()

    def _unstored(self, run: Run, error: BaseException) -> None:
        if isinstance(error, TaskRpcError) and not isinstance(error, OutcomeUnknown):
            text = "%s cannot store what it did: %s"
            log.error(text, run.service, error, extra=log_fields(run))
            self.undone(run, HandlerFailed(Code.UNAVAILABLE, told(error)))
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
            if isinstance(error, OutcomeUnknown) or not isinstance(error, TaskRpcError):
                self._shared.open(self._store, anew=True)

    def _wait_for_store(self, call: IncomingCall) -> None:
        shared = self._shared
        shared.open(self._store)  # it may be that it could not be read before

        def ready() -> None:
            if call.cancelled:
                return
            if shared.is_given_up:
                call.fail(ServiceUnavailable(f"the store of {call.service} cannot be used"))
            else:
                self.arrived(call)

        shared.when_open(ready)


def _nothing() -> None:
    pass
