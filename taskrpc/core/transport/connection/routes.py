"""The routes of one connection, and the answers to its lookups; decides, and sends nothing.

A peer looks up a service once, with RESOLVE, and gets a method id. Several nodes of a program share
a connection, so a method id names a service and the node that calls it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from taskrpc.core.request_ids.ids import ReceivedId
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import Offer
from taskrpc.core.transport.connection.incoming_call import (
    Route,
    RouteFaults,
    mismatch,
    rerouted,
    route_to,
)
from taskrpc.core.wire.events import RequestReceived
from taskrpc.core.wire.frames import Flag
from taskrpc.core.wire.messages import Resolve, cut_span
from taskrpc.errors import ServerBusy, ServiceUnavailable, TaskRpcError

MAX_HANDLES = 0xFFFF
"""Most pairs of a service and a calling node that one connection can use."""


_TRACED = int(Flag.TRACED)
_EXACTLY_ONCE = int(Flag.EXACTLY_ONCE)  # a Flag's own & costs as much as a decoded message


class Refusal(msgspec.Struct, frozen=True):
    """Why a lookup fails, and what follows for the connection."""

    error: TaskRpcError
    exists: bool
    """Whether the service is offered, although this peer cannot call it."""
    drains: bool = False
    """Whether the connection is used up: the caller must connect again."""


class Routes(dict[int, Route]):
    """The routes of a connection by their method ids, which are never used twice.

    It is a dict, because each request looks up its route.
    """

    __slots__ = ("_ids",)

    def __init__(self) -> None:
        # Created when first needed: of thousands of idle connections, most have no route.
        self._ids: dict[tuple[int, str], int] | None = None
        """The method id by the server's number of the service, and the calling node."""

    def refusal(self, question: Resolve, offer: Offer | None) -> Refusal | None:
        """Return why a peer cannot call the service that it looks up; None if it can."""
        if offer is None:
            error: TaskRpcError = ServiceUnavailable(f"no service {question.name} here")
            return Refusal(error, exists=False)
        if question.type_hash not in ("", offer.srv_type._HASH):
            return Refusal(mismatch(question, offer), exists=True)
        if len(self) >= MAX_HANDLES:
            # Ids are never reused on one connection; a new connection starts again at 1.
            error = ServerBusy(f"this connection has used all of its {MAX_HANDLES} method ids")
            return Refusal(error, exists=True, drains=True)
        return None

    def add(
        self,
        offer: Offer,
        method: int,
        caller: str,
        account: str,
        role: Role,
        faults: RouteFaults | None = None,
    ) -> int:
        """Return the method id with which a node calls a service; the same pair keeps its id."""
        if self._ids is None:
            self._ids = {}
        known = self._ids.setdefault((method, caller), len(self._ids) + 1)
        if known not in self:
            self[known] = _with_faults(
                route_to(offer, known, method, caller, account, role), faults
            )
        return known

    def reroute(
        self,
        offers: Mapping[int, Offer],
        replaced: Callable[[Offer], Offer],
        faults: RouteFaults | None,
    ) -> None:
        """Lead later calls to `replaced(offer)`, for each service that is still offered."""
        for handle, route in self.items():
            if (offer := offers.get(route.method)) is not None:
                self[handle] = _with_faults(rerouted(route, replaced(offer)), faults)


def read_request(route: Route, event: RequestReceived) -> tuple[object, ReceivedId | None]:
    """Return the message and the request id of a request; moves its span out of the body.

    Raises InvalidRequest or ProtocolError for bytes that are not valid, and PermissionDenied if the
    caller's role is too low.
    """
    received_id = None
    if event.flags & _TRACED:
        event.span, event.body = cut_span(event.body)
    if event.flags & _EXACTLY_ONCE:
        client, sequence, first, fingerprint, event.body = route.split_id(event.body)
        received_id = ReceivedId(client, sequence, first, fingerprint)
    return route.decode(event.body), received_id


def _with_faults(route: Route, faults: RouteFaults | None) -> Route:
    return route if faults is None else faults.applied(route)
