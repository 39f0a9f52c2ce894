"""One execution of a request, and the callers that wait for its response."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Generic, Protocol, final

import msgspec

from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.codec import Codec
from taskrpc.errors import Code, HandlerError, HandlerFailed, OutcomeUnknown, TaskRpcError
from taskrpc.message_types import ResponseT


@final
class Effect(msgspec.Struct, Generic[ResponseT]):
    """The return value of an exactly-once handler that lets the store change something.

    The store applies `effect` in one transaction with the record that the request is done.
    """

    response: ResponseT
    effect: Any


class ExecutionOwner(Protocol):
    """Receives the end of an execution: exactly one of these methods is called, once."""

    codec: Codec
    """Encodes and decodes the service's responses."""

    def commit(
        self,
        execution: Execution,
        completion: Completion | None,
        effect: Any,
        error: TaskRpcError | None = None,
    ) -> None:
        """Store the effect and the completion, then answer, with the error if there is one."""

    def done(self, execution: Execution, completion: Completion | None) -> None:
        """Answer: the handler has stored the completion itself."""

    def undone(self, execution: Execution, error: TaskRpcError) -> None:
        """Answer with an error: nothing was stored, a repetition runs again."""

    def refused(self, execution: Execution) -> None:
        """Answer: the handler refused and stored nothing, a repetition runs again."""

    def unknown(self, execution: Execution, error: OutcomeUnknown) -> None:
        """Answer with an error: only the store can tell whether the effect is stored."""


class Execution(IncomingCall, eq=False, kw_only=True):
    """One execution of a request; the service runs it in the place of the call that began it.

    With a request id, `arrived` is the instant on the store's lease clock.
    """

    owner: ExecutionOwner
    callers: list[IncomingCall]
    """The calls that wait for the response."""
    completion: Completion | None = None
    """The completion that is being stored, once the transaction has begun."""
    is_storing: bool = False
    """Whether the transaction has begun. From then on the execution cannot be cancelled."""
    refused: bool = False
    """Whether the handler said that it did nothing, so that a repetition runs again."""
    response: Any = None
    """The handler's response."""
    body: bytes = b""
    """The encoded response."""

    @property
    def flow(self) -> Hashable:
        """The first caller's key in the fair queue."""
        return self.callers[0].flow

    @property
    def machine(self) -> str:
        """The address of the first caller's machine, "" for the server's own."""
        return self.callers[0].machine if self.callers else ""

    @property
    def is_foreign(self) -> bool:
        """Whether the first caller is a program of ROS 2."""
        return bool(self.callers) and self.callers[0].is_foreign

    def completed_by(self, response: Any) -> Completion | None:
        """Return the completion that a handler must store with its own effect, None for none.

        From here on the execution cannot be cancelled. Raises InvalidRequest for a response that
        cannot be sent.
        """
        if self.received_id is not None:
            self.completion = self._completion(self.owner.codec.encode(response), 0)
        self.is_storing = True
        return self.completion

    def _completion(self, body: bytes, code: int) -> Completion | None:
        """Return the completion for a response or a failure; None without a request id."""
        received = self.received_id
        if received is None:
            return None
        return received.completion(self.principal, body, code, self.arrived)

    def completed_elsewhere(self, completion: Completion) -> Any:
        """Take over the response of another server that completed the request meanwhile.

        The handler must return the response that this method returns.

        Raises HandlerError: the other server's handler failed, or it completed another request.
        """
        if self.received_id is None or completion.fingerprint != self.received_id.fingerprint:
            text = "another request was sent under this request id"
            raise HandlerError(Code.INVALID_ARGUMENT, text)
        if completion.code:
            raise HandlerError(Code(completion.code), completion.response.decode())
        self.completion, self.is_storing = completion, True
        return self.owner.codec.decode(completion.response)

    def nothing_done(self) -> None:
        """Say that the response need not be stored."""
        self.refused = True

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Store the effect and the completion, then answer all callers."""
        effect, owner = None, self.owner
        if response.__class__ is Effect:  # final, and isinstance costs more than the rest here
            response, effect = response.response, response.effect
        if self.completion is not None:  # the handler has stored both itself
            self.response, self.body = response, self.completion.response
            owner.done(self, self.completion)
            return
        self.body = body = owner.codec.encode(response)
        self.response = response
        if self.refused and effect is None:
            owner.refused(self)
        else:
            owner.commit(self, self._completion(body, 0), effect)

    def fail(self, error: TaskRpcError) -> None:
        """Answer all callers with an error; the handler's own error is stored like a response."""
        if isinstance(error, OutcomeUnknown):  # the service is abandoned; the execution ends later
            self.answer(error)
        elif isinstance(error, HandlerFailed) and error.code is Code.OUTCOME_UNKNOWN:
            self.owner.unknown(self, OutcomeUnknown(error.message))
        elif self.completion is not None and not error.not_executed:
            problem = f"call {self.number} failed after it may have been stored"
            self.owner.unknown(self, OutcomeUnknown(problem))
        elif (
            isinstance(error, HandlerFailed)
            and not error.not_executed
            and self.received_id is not None
        ):
            # Encoded as on the wire: the message need not be valid text. A failure must not have
            # the code 0, which marks a response.
            body = error.message.encode("utf-8", "backslashreplace")
            completion = self._completion(body, int(error.code or Code.UNKNOWN))
            self.owner.commit(self, completion, None, error)
        else:
            self.owner.undone(self, error)

    def answer(self, error: TaskRpcError | None = None) -> None:
        """Send the error, or else the response, to all waiting callers."""
        callers, self.callers = self.callers, []
        for call in callers:
            if error is not None:
                call.fail(error)
                continue
            try:
                call.reply(self.response, self.body)
            except TaskRpcError as problem:  # the response is too large for this caller
                text = f"the call ran, but its response cannot be sent: {problem}"
                call.fail(TaskRpcError(text, not_executed=False))

    def attach(self, call: IncomingCall) -> None:
        """Let a repetition of the request wait for the same response."""
        self.callers.append(call)
        call.on_cancel = self.remove_cancelled
        if self.deadline is not None:
            late = call.deadline
            self.deadline = None if late is None else max(self.deadline, late)

    def remove_cancelled(self) -> None:
        """Remove the callers that were cancelled; cancel the execution if none is left."""
        for call in [each for each in self.callers if each.cancelled]:
            self.callers.remove(call)
            # This selects the error for the caller that leaves: the request may still run for
            # other callers.
            call.started = self.started or bool(self.callers)
            if not self.callers and not self.is_storing:
                self._cancel()

    def _cancel(self) -> None:
        self.cancel()
        if not self.started:
            self.owner.undone(self, TaskRpcError("cancelled by the caller"))
