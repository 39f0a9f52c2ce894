"""One run of a request, and the callers that wait for its response."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Any, Generic, final

import msgspec

from taskrpc.errors import Code, HandlerFailed, OutcomeUnknown, TaskRpcError
from taskrpc.given_types import ResponseT
from taskrpc.request_ids.ids import Completion
from taskrpc.transport.base import IncomingCall

if TYPE_CHECKING:
    from taskrpc.exactly_once.deduplicator import OnceDesk


@final
class Effect(msgspec.Struct, Generic[ResponseT]):
    """What a handler of an exactly-once service returns where its store is to do something.

    The store applies `effect` in one transaction with the record that the request is done.
    """

    response: ResponseT
    effect: Any


class Run(IncomingCall, eq=False):
    """One run of a request; it takes the place of the call that began it.

    When that `arrived`, where it has a number, is told by the store's clock.
    """

    desk: OnceDesk
    callers: list[IncomingCall]
    """Who waits for the answer."""
    completion: Completion | None = None
    """Once the transaction has begun: what it remembers."""
    is_storing: bool = False
    """Whether the transaction has begun. From then on the run cannot be cancelled."""
    refused: bool = False
    """Whether the callback has done nothing, and is to be asked again."""
    response: Any = None
    """What the callback answered."""
    body: bytes = b""
    """The same, encoded."""

    @property
    def lane(self) -> Hashable:
        """Whose call it is: the first caller's."""
        return self.callers[0].lane

    @property
    def machine(self) -> str:
        """The address of the machine whose call it is, "" for the server's own."""
        return self.callers[0].machine if self.callers else ""

    def completed_by(self, response: Any) -> Completion | None:
        """What a handler that stores its own effect must store with it, if anything.

        From here on the run cannot be cancelled. Raises InvalidRequest for a response that cannot
        be sent.
        """
        if self.claim is not None:
            self.completion = self.completed(self.desk.codec.encode(response), 0)
        self.is_storing = True
        return self.completion

    def completed(self, body: bytes, code: int) -> Completion | None:
        """What is to be remembered with an answer, if anything."""
        claim = self.claim
        if claim is None:
            return None
        return Completion(
            self.principal,
            claim.client,
            claim.sequence,
            claim.first_incomplete,
            claim.fingerprint,
            body,
            code,
            self.arrived,
        )

    def nothing_done(self) -> None:
        """Say that the response need not be remembered."""
        self.refused = True

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Store the effect and the completion, then answer everybody."""
        effect, desk = None, self.desk
        if response.__class__ is Effect:  # final, and isinstance costs more than the rest here
            response, effect = response.response, response.effect
        if self.completion is not None:  # the handler has stored both itself
            self.response, self.body = response, self.completion.answer
            desk.done(self, self.completion)
            return
        self.body = body = desk.codec.encode(response)
        self.response = response
        if self.refused and effect is None:
            desk.refused(self)
        else:
            desk.commit(self, self.completed(body, 0), effect)

    def fail(self, error: TaskRpcError) -> None:
        """Answer everybody with an error; one of the handler's own is remembered as an answer."""
        if isinstance(error, OutcomeUnknown):  # the service is given up; the run has its own end
            self.tell(error)
        elif isinstance(error, HandlerFailed) and error.code is Code.OUTCOME_UNKNOWN:
            self.desk.unknown(self, OutcomeUnknown(error.message))
        elif self.completion is not None and not error.not_executed:
            problem = f"call {self.number} failed after it may have been stored"
            self.desk.unknown(self, OutcomeUnknown(problem))
        elif isinstance(error, HandlerFailed) and not error.not_executed and self.claim is not None:
            # As it travels: it need not be text. And with the code 0 it would be a response.
            body = error.message.encode("utf-8", "backslashreplace")
            completion = self.completed(body, int(error.code or Code.UNKNOWN))
            self.desk.commit(self, completion, None, error)
        else:
            self.desk.undone(self, error)

    def tell(self, error: TaskRpcError | None = None) -> None:
        """Send the error or the response to all waiting callers; none waits afterwards."""
        callers, self.callers = self.callers, []
        for call in callers:
            if error is not None:
                call.fail(error)
                continue
            try:
                call.reply(self.response, self.body)
            except TaskRpcError as problem:  # it is too large for this caller
                text = f"it ran; its answer cannot be sent: {problem}"
                call.fail(TaskRpcError(text, not_executed=False))

    def attach(self, call: IncomingCall) -> None:
        """Another sender of the same request waits too."""
        self.callers.append(call)
        call.on_cancel = self.left
        if self.deadline is not None:
            late = call.deadline
            self.deadline = None if late is None else max(self.deadline, late)

    def left(self) -> None:
        """Somebody waits no more: he is cancelled, unless he has his answer."""
        for call in [each for each in self.callers if each.cancelled]:
            self.callers.remove(call)
            # The text for a caller that leaves: the request may still run for other callers.
            call.started = self.started or bool(self.callers)
            if not self.callers and not self.is_storing:
                self._give_up()

    def _give_up(self) -> None:
        self.cancel()
        if not self.started:
            self.desk.undone(self, TaskRpcError("cancelled by the caller"))
