"""Injects faults into the calls of a node's services, over any transport: `Node(faults=...)`.

The faults act on calls where they arrive from a connection, so clients need no change. A node
without `faults` uses none of this.
"""

from __future__ import annotations

import copy
import logging
import random
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, cast

import msgspec

from taskrpc.core.callinfo import log_fields
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.connection.incoming_call import ObservedCall, Route, answer_unexpected
from taskrpc.errors import ConnectionLost, ServerBusy, TaskRpcError
from taskrpc.testing.fault_specs import Fault, FaultKind, FaultPlan, parse_fault

log = logging.getLogger("taskrpc.server")

RETRY_AFTER = 0.1
"""Seconds after which a client may repeat a call that was refused as busy."""


class Plan(Protocol):
    """Decides which call gets which fault."""

    def concerns(self, service: str) -> bool:
        """Return whether calls of a service can get a fault."""

    def next(self, service: str) -> Fault | None:
        """Return the fault of the next call of a service, None for none."""


class CallFaults:
    """Faults in the calls of a node: `Node("robot", faults=CallFaults("lose-response:first=1"))`.

    Each specification is a kind of fault, and after a colon, separated by commas: a time (`0.5s`),
    a share of the calls (`0.2`), `first=N`, `service=NAME`, and `seed=N`. The kinds are
    `lose-request`, `duplicate-request`, `lose-response`, `delay-response`, `slow`, `busy` and
    `cut-connection`. The same seed and the same calls give the same faults. Each fault is logged.

    Args:
        specs: the specifications; a call that gets one fault does not count for the later ones.
        service: the service of specifications that name none; "" for all services of the node.

    Raises ValueError for an invalid specification.
    """

    def __init__(self, *specs: str, service: str = "") -> None:
        self.faults = [parse_fault(spec, service) for spec in specs]
        """The faults; as text, each says what it does."""
        self.happened = dict.fromkeys((fault.kind.value for fault in self.faults), 0)
        """How often each kind of fault happened."""
        self.plan: Plan = FaultPlan(
            self.faults, [random.Random(fault.seed).random for fault in self.faults]
        )
        """Decides which call gets which fault; a simulation has its own."""

    def applied(self, route: Route) -> Route:
        """Return a route of a connection whose calls get the faults."""
        if not self.plan.concerns(route.offer.name):
            return route
        serve = partial(self._serve, route.offer.serve)
        offer = msgspec.structs.replace(route.offer, serve=serve)
        return msgspec.structs.replace(route, offer=offer, call=_FaultyCall)

    def report(self, call: IncomingCall, fault: Fault) -> None:
        """Log what happens to a call; it is called when it happens."""
        where = call.number, call.service, call.caller
        log.info("fault in call %d of %s from %s: %s", *where, fault.effect, extra=log_fields(call))

    def _serve(self, serve: Callable[[IncomingCall], None], incoming: IncomingCall) -> None:
        call = cast("_FaultyCall", incoming)
        if call.is_decided:  # the call waited for a free place, and arrives here again
            serve(call)
            return
        call.is_decided = True
        fault = self.plan.next(call.service)
        if fault is None:
            serve(call)
            return
        self.happened[fault.kind.value] = self.happened.get(fault.kind.value, 0) + 1
        call.report = self.report
        if not fault.kind.concerns_response:
            self.report(call, fault)
        match fault.kind:
            case FaultKind.LOSE_REQUEST:
                call.started = True  # otherwise the caller would learn that the call did not run
            case FaultKind.BUSY:
                problem = f"an injected fault: {call.service} is busy"
                call.fail(ServerBusy(problem, retry_after=RETRY_AFTER))
            case FaultKind.DUPLICATE_REQUEST:
                twin = copy.copy(call)
                twin.is_twin = True
                serve(call)
                serve(twin)
            case FaultKind.SLOW:
                call.started = True  # as in a slow handler: after a timeout, the outcome is unknown
                timer = call.connection.owner.loop.call_later(
                    fault.seconds, self._begin, serve, call
                )
                call.on_cancel = timer.cancel
            case _:
                call.fault = fault
                serve(call)

    def _begin(self, serve: Callable[[IncomingCall], None], call: _FaultyCall) -> None:
        call.on_cancel = None
        call.started = False
        serve(call)


class _Abortable(Protocol):
    """The connection of a call."""

    def abort(self, error: TaskRpcError) -> None:
        """Close the connection at once."""


class _FaultyCall(ObservedCall, eq=False, kw_only=True):
    """A call whose response may be lost or delayed, or may cut the connection."""

    fault: Fault | None = None
    """What happens to the response."""
    is_decided: bool = False
    """Whether it is decided which fault the call gets."""
    report: Callable[[IncomingCall, Fault], None] | None = None
    """Is called when it happens."""
    is_answered: bool = False
    """Whether its service has answered, also if the response is lost."""
    is_twin: bool = False
    """Whether it is a second arrival of another call, whose response nobody gets."""

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Answer with a response message, unless a fault prevents it."""
        fault, self.fault = self.fault, None
        self.is_answered = True
        if self.is_twin:
            return
        if fault is None or self.ended:
            super().reply(response, body)
            return
        self.started = True  # the caller must not learn that the call did not run
        loop = self.connection.owner.loop
        if self.report is not None:
            self.report(self, fault)
        if fault.kind is FaultKind.DELAY_RESPONSE:
            loop.call_later(fault.seconds, self._reply_late, response, body)
        elif fault.kind is FaultKind.CUT_CONNECTION:
            # Not at once: other calls of the same read are being handled.
            error = ConnectionLost("an injected fault cut the connection")
            loop.call_soon(cast("_Abortable", self.connection).abort, error)

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        if not self.is_twin:
            super().fail(error)

    def _reply_late(self, response: Any, body: bytes | None) -> None:
        try:
            super().reply(response, body)
        except Exception as error:  # such as a response that is too large
            answer_unexpected(self, error)
