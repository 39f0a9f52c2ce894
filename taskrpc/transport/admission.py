"""Who may stay connected: a bound on all connections, a smaller one on those without proof."""

from __future__ import annotations

import logging

from taskrpc import platform
from taskrpc.errors import ServerBusy
from taskrpc.transport.seldom import SeldomLog
from taskrpc.transport.serving import ServingConnection

log = logging.getLogger("taskrpc.transport")

MAX_CONNECTIONS = 10_000
"""Connections of callers that have proved themselves, where descriptors allow so many."""
MAX_STRANGERS = 128
"""Connections that have not; one more cuts the oldest off."""

RETRY_AFTER = 1.0


class Admission:
    """Counts the connections of one listener.

    A flood of strangers costs only strangers their places: whoever has proved himself stays, and
    a proof takes far less time than 128 others need to come.
    """

    def __init__(self) -> None:
        descriptors = platform.descriptor_limit()
        self._most = min(MAX_CONNECTIONS, descriptors * 3 // 4)
        self._most_strangers = min(MAX_STRANGERS, descriptors // 8)
        self._strangers: dict[ServingConnection, None] = {}
        self._known: set[ServingConnection] = set()
        self._crowded = SeldomLog(log)
        self._full = SeldomLog(log)

    def came(self, connection: ServingConnection) -> None:
        """Somebody connected; there is room for him, or there will be."""
        if len(self._known) >= self._most:
            self._refuse(connection)
            return
        if len(self._strangers) >= self._most_strangers:
            self._cut_oldest(connection)
        self._strangers[connection] = None

    def proved(self, connection: ServingConnection) -> None:
        """Somebody showed that he may be here."""
        if self._strangers.pop(connection, False) is None:
            self._known.add(connection)

    def left(self, connection: ServingConnection) -> None:
        """A connection is gone."""
        self._strangers.pop(connection, None)
        self._known.discard(connection)

    def _cut_oldest(self, newest: ServingConnection) -> None:
        oldest = next(iter(self._strangers))
        del self._strangers[oldest]
        self._crowded.warning(
            newest.owner.loop.time(),
            "more than %d connections without a proof; the oldest, from %s, was cut off",
            self._most_strangers,
            oldest.peer_name,
        )
        oldest.abort(ServerBusy("too many connections without a proof"))

    def _refuse(self, connection: ServingConnection) -> None:
        problem = f"the server has {self._most} connections, as many as it can"
        self._full.warning(
            connection.owner.loop.time(), "refused %s: %s", connection.peer_name, problem
        )
        connection.refuse(ServerBusy(problem, retry_after=RETRY_AFTER))
