"""The deduplicator of an exactly-once service: executes, attaches, answers or refuses each call."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, cast

from taskrpc.core.callinfo import log_fields
from taskrpc.core.exactly_once.executions import Execution
from taskrpc.core.exactly_once.store_state import StoreState, release, state_of
from taskrpc.core.execution.eager_start import EagerStarter
from taskrpc.core.request_ids.ids import (
    ClientKey,
    Completion,
    CompletionStore,
    ReceivedId,
    SharedCompletionStore,
)
from taskrpc.core.request_ids.ledger import ClientRecord, Ledger, Verdict
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.codec import Codec
from taskrpc.errors import (
    Code,
    HandlerFailed,
    OutcomeUnknown,
    RequestIdReused,
    ServerBusy,
    ServiceUnavailable,
    SessionExpired,
    TaskRpcError,
    text_for_callers,
)

if TYPE_CHECKING:
    from taskrpc.core.observer import DeduplicationStatus

log = logging.getLogger("taskrpc.server")

RETRY_AFTER = 0.5
"""Seconds after which a client may repeat a request that was refused because memory is full."""
_EXPIRE_EVERY = 60.0
"""Seconds between two searches for leases that have ended."""
_NEW = Verdict.NEW  # looking it up in the Enum takes as long as the decision, in Python 3.11


class Deduplicator:
    """Stands between the transport and an exactly-once service.

    The ledger decides what a request is. An execution answers all callers that sent the request.
    The store writes its effect and its completion in one transaction, before any caller gets a
    response. A lost connection does not end an execution, because the caller will reconnect. A
    cancel or a deadline ends it, but only before the transaction begins.

    Args:
        store: keeps completions and effects.
        codec: encodes and decodes the service's responses.
        serve: runs a call.

    Raises:
        StoreError: the store has an `open_now`, and cannot be opened.
    """

    def __init__(
        self,
        store: CompletionStore,
        codec: Codec,
        serve: Callable[[IncomingCall], None],
    ) -> None:
        if hasattr(store, "open_now"):  # before the service is offered
            store.open_now()
        self.codec = codec
        self.storing: dict[IncomingCall, Callable[[], object]] = {}
        """Executions whose transaction runs; each value is called when the transaction ends."""
        self._store = store
        self._serve = serve
        self._new = 0
        """How many requests were new."""
        self._repeated = dict.fromkeys(Verdict, 0)
        """How many requests were not new, by verdict."""
        self._shared = cast("SharedCompletionStore", store) if hasattr(store, "look_up") else None
        """The store, if other servers use it too."""
        self._problem = ""
        """Why the last request could not be looked up; "" if it could."""
        self.state: StoreState = state_of(store)
        """Shared with all services of the store."""
        self._starter = EagerStarter(asyncio.get_running_loop(), lambda _: None)
        self.state.deduplicators += 1
        self.state.open(store)

    def store_id(self) -> asyncio.Future[bytes]:
        """Return a future of the store's id; reads the store again if this has failed before."""
        return self.state.store_id(self._store)

    def status(self) -> DeduplicationStatus:
        """Return the counts of requests, and what the ledger remembers."""
        from taskrpc.core.observer import DeduplicationStatus  # few programs need it

        ledger = self.state.ledger
        verdicts = self._repeated | {Verdict.NEW: self._new}
        requests = {verdict.name.lower(): count for verdict, count in verdicts.items()}
        return DeduplicationStatus(
            requests, len(ledger or ()), 0 if ledger is None else ledger.size
        )

    def close(self) -> None:
        """Stop using the store; `arrived` must not be called afterwards."""
        self._starter.close()
        self.state.deduplicators -= 1
        if not self.state.deduplicators:  # another event loop may use the store next
            release(self._store, self.state)

    def arrived(self, call: IncomingCall) -> None:
        """Execute, attach, answer or refuse a call."""
        state, received, now = self.state, call.received_id, call.arrived
        if received is not None:  # without a request id, a call runs at most once
            ledger, clock = state.ledger, state.clock
            if ledger is None or clock is None:
                self._wait_for_store(call)
                return
            if self._shared is not None and not received.is_looked_up:
                self._look_up(self._shared, call, received)
                return
            now += clock.offset
            if now >= state.next_expiry:
                self._expire(ledger, now)
            verdict = ledger.decide(call.principal, received, now)
            if verdict is not _NEW:
                self._answer_repetition(call, received, verdict, ledger)
                return
            self._new += 1
        execution = self._execution(call, now)
        self._begin(execution, call)
        self._serve(execution)

    def _execution(self, call: IncomingCall, now: float) -> Execution:
        """Return the execution of a new request; `now` is its arrival on the lease clock."""
        return Execution(
            service=call.service,
            caller=call.caller,
            principal=call.principal,
            role=call.role,
            number=call.number,
            deadline=call.deadline,
            clock=call.clock,
            request=call.request,
            received_id=call.received_id,
            arrived=now,
            owner=self,
            callers=[call],
        )

    def _begin(self, execution: Execution, call: IncomingCall) -> None:
        """Let later calls with the same id find the execution, and a cancel of the call end it."""
        call.on_cancel = execution.remove_cancelled
        if call.received_id is not None:
            call.received_id.execution = execution

    # The plain path: a new request whose callback returns at once, and a store that completes it
    # at once. A test compares it with the general path.

    @property
    def is_plain(self) -> bool:
        """Whether connections may run the calls themselves."""
        return getattr(self._store, "completes_at_once", False) and self._shared is None

    def complete(self, completion: Completion, record: ClientRecord) -> None:
        """Store the completion of a request that the ledger has admitted."""
        self._new += 1
        self._store.complete(completion, None)
        if more := record.enter(completion):
            assert self.state.ledger is not None, "it has admitted the request"
            self.state.ledger.grown(completion, record, more)

    def executed(self, call: IncomingCall, *, is_over: bool) -> Execution:
        """Return the execution of an admitted request; one that is over answers nobody."""
        ledger, clock = self.state.ledger, self.state.clock
        assert ledger is not None, "it has admitted the request"
        assert clock is not None, "the store has been read"
        now = call.arrived + clock.offset
        execution = self._execution(call, now)
        execution.started = True
        if is_over:
            execution.callers, execution.is_storing = [], True
        else:
            assert call.received_id is not None, "only requests with an id are admitted"
            self._new += 1
            ledger.add_running(call.principal, call.received_id, now)
            self._begin(execution, call)
        return execution

    # The end of an execution

    def commit(
        self,
        execution: Execution,
        completion: Completion | None,
        effect: Any,
        error: TaskRpcError | None = None,
    ) -> None:
        """Store an effect and the completion, then answer, with the error if there is one."""
        if completion is None and effect is None:
            self.done(execution, None, error)
            return
        execution.completion, execution.is_storing = completion, True
        try:
            storing = self._store.complete(completion, effect)
        except BaseException as problem:
            self._store_failed(execution, problem)
            if isinstance(problem, SystemExit | KeyboardInterrupt):
                raise
            return
        if storing is None:
            self.done(execution, completion, error)
            return
        with contextlib.suppress(StopIteration):  # it is stored already
            self._starter.start(self._await_store(storing, execution, completion, error))
            self.storing[execution] = _nothing

    def done(
        self,
        execution: Execution,
        completion: Completion | None,
        error: TaskRpcError | None = None,
    ) -> None:
        """Answer all callers: the completion is stored."""
        self.state.end(execution, completion)
        execution.answer(error)

    def undone(self, execution: Execution, error: TaskRpcError) -> None:
        """Answer with an error: nothing was stored, and a repetition of the request runs again."""
        self.state.end_without_trace(execution)
        if not execution.cancelled:
            execution.answer(error)
            return
        callers, execution.callers = execution.callers, []
        for call in callers:  # they attached while the execution was cancelled by another caller
            self.arrived(call)

    def refused(self, execution: Execution) -> None:
        """Answer with the handler's refusal; a repetition of the request runs again."""
        self.state.end_without_trace(execution)
        execution.answer()

    def unknown(self, execution: Execution, error: OutcomeUnknown) -> None:
        """Answer with an error, and read the store again: only it knows what was stored."""
        log.error("%s: %s", execution.service, error, extra=log_fields(execution))
        self.state.end(execution)
        self.state.open(self._store, again=True)
        execution.answer(OutcomeUnknown(text_for_callers(error)))

    async def _await_store(
        self,
        storing: Awaitable[None],
        execution: Execution,
        completion: Completion | None,
        error: TaskRpcError | None,
    ) -> None:
        try:
            await storing
        except BaseException as problem:
            self._store_failed(execution, problem)
            if isinstance(problem, SystemExit | KeyboardInterrupt):
                raise
        else:
            self.done(execution, completion, error)
        finally:
            self.storing.pop(execution, _nothing)()

    def _store_failed(self, execution: Execution, error: BaseException) -> None:
        fields = log_fields(execution)
        if isinstance(error, TaskRpcError) and not isinstance(error, OutcomeUnknown):
            log.error("%s cannot store a result: %s", execution.service, error, extra=fields)
            self.undone(execution, HandlerFailed(Code.UNAVAILABLE, text_for_callers(error)))
            return
        if not isinstance(error, OutcomeUnknown):  # the effect may or may not be stored
            log.error("the store of %s failed:", execution.service, exc_info=error, extra=fields)
            error = OutcomeUnknown(f"the store of {execution.service} failed")
        self.unknown(execution, error)

    # Repetitions

    def _answer_repetition(
        self, call: IncomingCall, received: ReceivedId, verdict: Verdict, ledger: Ledger
    ) -> None:
        self._repeated[verdict] += 1
        if verdict in (Verdict.ATTACH, Verdict.DONE):
            call.note_repetition()
        match verdict:
            case Verdict.ATTACH:
                text = "call %d of %s repeats a request that runs: it waits for the same response"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                execution: Execution = ledger.running(call.principal, received).execution
                execution.attach(call)
            case Verdict.DONE:
                text = "call %d of %s repeats a request that is done: it gets the stored response"
                log.debug(text, call.number, call.service, extra=log_fields(call))
                self._answer_from_store(call, ledger.completion(call.principal, received))
            case Verdict.STALE:
                problem = (
                    "the server does not remember this client: whether the call ran is unknown"
                )
                call.fail(SessionExpired(problem))
            case Verdict.REUSED:
                call.fail(RequestIdReused("another request was sent under this request id"))
            case Verdict.FULL:
                whose = f" of the account {call.principal}" if call.principal else ""
                problem = f"{call.service} remembers too many requests{whose}"
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))

    def _answer_from_store(self, call: IncomingCall, completion: Completion) -> None:
        if completion.code:
            call.fail(HandlerFailed(Code(completion.code), completion.response.decode()))
            return
        try:
            call.reply(self.codec.decode(completion.response), completion.response)
        except TaskRpcError as error:
            problem = f"the call ran before, but its stored response cannot be read: {error}"
            call.fail(TaskRpcError(problem, not_executed=False))

    # The store

    def _look_up(
        self, store: SharedCompletionStore, call: IncomingCall, received: ReceivedId
    ) -> None:
        """Learn what other servers have completed for the client of a call, then decide."""
        received.is_looked_up = True
        with contextlib.suppress(StopIteration):  # it is known already
            self._starter.start(self._learn(store, call, received))

    async def _learn(
        self, store: SharedCompletionStore, call: IncomingCall, received: ReceivedId
    ) -> None:
        try:
            found = await store.look_up((call.principal, received.client))
        except TaskRpcError as error:
            if str(error) != self._problem:  # an outage would fill the log: many requests fail
                self._problem = str(error)
                log.error("%s cannot look requests up: %s", call.service, error)
            call.fail(HandlerFailed(Code.UNAVAILABLE, text_for_callers(error)))
            return
        self._problem = ""
        if (ledger := self.state.ledger) is not None:
            for completion in found:
                ledger.learn(completion)
        if not call.cancelled:
            self.arrived(call)

    def _expire(self, ledger: Ledger, now: float) -> None:
        self.state.next_expiry = now + _EXPIRE_EVERY
        if clients := ledger.expire(now):
            with contextlib.suppress(StopIteration):
                self._starter.start(self._forget(clients))

    async def _forget(self, clients: list[ClientKey]) -> None:
        try:
            storing = self._store.complete(None, None, clients)
            if storing is not None:
                await storing
        except Exception as error:  # harmless: the next server finds them expired too
            log.warning("cannot forget clients whose lease has ended: %s", error)
            if isinstance(error, OutcomeUnknown) or not isinstance(error, TaskRpcError):
                self.state.open(self._store, again=True)

    def _wait_for_store(self, call: IncomingCall) -> None:
        state = self.state
        state.open(self._store)  # again, if it could not be read before

        def ready() -> None:
            if call.cancelled:
                return
            if state.is_unreadable:
                call.fail(ServiceUnavailable(f"the store of {call.service} cannot be used"))
            else:
                self.arrived(call)

        state.when_open(ready)


def _nothing() -> None:
    pass
