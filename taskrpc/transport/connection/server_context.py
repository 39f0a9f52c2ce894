"""What the connections of one process ask it for."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING, Protocol

from taskrpc.transport.base import Offer
from taskrpc.transport.connection.connection import Owner
from taskrpc.transport.limits.backpressure import Unread
from taskrpc.transport.limits.calls_in_flight import Load
from taskrpc.wire.messages import Listing

if TYPE_CHECKING:
    from taskrpc.transport.connection.server_side import ServingConnection
    from taskrpc.transport.pubsub.endpoint_topics import Topics


class Host(Owner, Protocol):
    """What a process offers, as far as its connections ask."""

    call_numbers: count[int]
    """Counts calls, for logs."""
    offers: dict[int, Offer]
    """The services by their method ids."""
    unread: Unread
    """What callers have not read."""
    load: Load
    """What is in flight of theirs."""

    @property
    def topics(self) -> Topics:
        """What is published here."""

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""

    def listing(self) -> Listing:
        """Everything that this process offers."""

    def caller_proved(self, connection: ServingConnection) -> None:
        """A caller has proved that he may be here."""
