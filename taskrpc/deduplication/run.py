"""One run of a request, and everybody who waits for its answer."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING, Any

import msgspec

from taskrpc.errors import Code, HandlerFailed, OutcomeUnknown, TaskRpcError
from taskrpc.transport.base import IncomingCall
from taskrpc.wire.once import Claim, Completion

if TYPE_CHECKING:
    from taskrpc.deduplication.desk import OnceDesk

Key = tuple[str, bytes, int]
"""Principal, client and sequence: which request it is."""


class Effect(msgspec.Struct):
    """What a handler of an exactly-once service returns where its store is to do something.

    The store applies `effect` in one transaction with the record that the request is done.
    """

    response: Any
    effect: Any


class Run(IncomingCall, eq=False):
    """One run of a request; it takes the place of the call that began it."""

    desk: OnceDesk
    callers: list[IncomingCall]
    """Who waits for the answer."""
    arrived: float
    """On the store's clock."""
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
            self.desk.done(self, self.completion, partial(reply_to, response=response, body=body))
            return
        body = self.desk.codec.encode(response)
        answer = partial(reply_to, response=response, body=body)
        if self.refused and effect is None:
            self.desk.refused(self, answer)
        else:
            self.desk.commit(self, body, 0, effect, answer)

    def fail(self, error: TaskRpcError) -> None:
        """Answer everybody with an error; one of the handler's own is remembered as an answer."""
        answer = partial(fail_to, error=error)
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


def key_of(call: IncomingCall, claim: Claim) -> Key:
    """Which request a call brings."""
    return call.principal, claim.number.client, claim.number.sequence


def reply_to(call: IncomingCall, response: Any, body: bytes) -> None:
    """Answer one of those who wait."""
    try:
        call.reply(response, body)
    except TaskRpcError as error:  # it is too large for this caller
        call.fail(TaskRpcError(f"it ran; its answer cannot be sent: {error}", not_executed=False))


def fail_to(call: IncomingCall, error: TaskRpcError) -> None:
    """Answer one of those who wait with an error."""
    call.fail(error)
