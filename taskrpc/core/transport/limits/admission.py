"""Which connections may stay: a bound for all, and a smaller one for those without a proof."""

from __future__ import annotations

import logging
from collections import Counter
from typing import TYPE_CHECKING, Protocol

from taskrpc.core.system import resources
from taskrpc.errors import ServerBusy

if TYPE_CHECKING:
    import asyncio

    from taskrpc.errors import TaskRpcError
from taskrpc.core.transport.limits.log_throttling import ThrottledLog
from taskrpc.core.transport.limits.quotas import HostQueues, QuotaKey, host_of, name_of

log = logging.getLogger("taskrpc.transport")

MAX_CONNECTIONS = 10_000
"""Connections of callers with a proof, as far as descriptors allow."""
MAX_UNAUTHENTICATED = 128
"""Connections without a proof; one more closes the oldest one of the machine that has the most."""

RETRY_AFTER = 1.0
"""Seconds after which a refused or evicted caller may try again."""
GRACE = 5.0
"""Seconds that a connection has to finish its calls when another caller needs its place."""


class AdmittedConnection(Protocol):
    """What admission needs from a connection."""

    host_name: str
    """The caller's machine, "" for this one; admission sets it."""

    @property
    def quota_key(self) -> QuotaKey:
        """The caller's key in the quotas."""

    @property
    def in_flight(self) -> int:
        """Calls without a response."""

    @property
    def peer_name(self) -> str:
        """The caller's address, for logs."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """Its event loop."""

    def drain(self) -> None:
        """Take no new calls; close once those in flight are answered."""

    def refuse(self, error: TaskRpcError) -> None:
        """Close, and tell the caller why."""

    def abort(self, error: TaskRpcError) -> None:
        """Close at once."""


class Admission:
    """Counts the connections of one listener.

    A flood of connections without a proof closes only such connections, and only those of the
    machine that it comes from. Connections with a proof stay, and a proof takes far less time than
    128 new connections. A flood from one account, or from one machine of an account, does not keep
    others out: the caller with the most connections loses one to a caller with fewer.
    """

    def __init__(self) -> None:
        descriptors = resources.descriptor_limit()
        # The other descriptors are left for files, and for connections of this process.
        self._most = min(MAX_CONNECTIONS, descriptors * 3 // 4)
        self._most_unauthenticated = min(MAX_UNAUTHENTICATED, descriptors // 8)
        self._unauthenticated = HostQueues[AdmittedConnection]()
        self._authenticated: dict[QuotaKey, dict[AdmittedConnection, None]] = {}
        """The connections of each caller, in order of arrival."""
        self._count = 0
        self._unauthenticated_log = ThrottledLog(log)
        self._refusal_log = ThrottledLog(log)
        self._eviction_log = ThrottledLog(log)
        self._problem = f"the server has {self._most} connections, as many as it can"

    def arrived(self, connection: AdmittedConnection, peername: object) -> None:
        """Count a new connection; close the oldest one without a proof if there are too many."""
        connection.host_name = host_of(peername)
        if len(self._unauthenticated) >= self._most_unauthenticated:
            self._close_oldest(connection)
        self._unauthenticated.add(connection.host_name, connection)

    def proved(self, connection: AdmittedConnection) -> None:
        """Keep a connection whose caller has proved its identity, unless the server is full."""
        if not self._unauthenticated.remove(connection.host_name, connection):
            return
        if self._count >= self._most and not self._make_room(connection.quota_key):
            self._unauthenticated.add(connection.host_name, connection)
            self._refuse(connection)
            return
        self._authenticated.setdefault(connection.quota_key, {})[connection] = None
        self._count += 1

    def left(self, connection: AdmittedConnection) -> None:
        """Forget a connection that is gone."""
        self._unauthenticated.remove(connection.host_name, connection)
        self._forget(connection)

    def _forget(self, connection: AdmittedConnection) -> None:
        known = self._authenticated.get(connection.quota_key, {})
        if connection in known:
            del known[connection]
            self._count -= 1
            if not known:
                del self._authenticated[connection.quota_key]

    def _caller_to_evict(self, newcomer: QuotaKey) -> QuotaKey | None:
        """The caller to evict: the one with the most connections in the largest account.

        None if that is the newcomer itself."""
        own, accounts = newcomer[0], Counter[str]()
        for (account, _), theirs in self._authenticated.items():
            accounts[account] += len(theirs)
        most = max(accounts, key=accounts.__getitem__, default=own)
        if accounts[most] <= accounts[own] + 1:
            most = own
        counts = {key: len(theirs) for key, theirs in self._authenticated.items() if key[0] == most}
        heaviest = max(counts, key=counts.__getitem__, default=newcomer)
        is_newcomer = most == own and counts.get(heaviest, 0) <= counts.get(newcomer, 0) + 1
        return None if is_newcomer else heaviest

    def _make_room(self, newcomer: QuotaKey) -> bool:
        """Evict a connection of the caller with the most; False if that is the newcomer itself."""
        heaviest = self._caller_to_evict(newcomer)
        if heaviest is None:
            return False
        theirs = self._authenticated[heaviest]
        idle = (each for each in theirs if not each.in_flight)
        evicted = next(idle, None) or next(iter(theirs))
        loop, count = evicted.loop, len(theirs)
        text = "%s; %s has %d of them, and one is evicted"
        self._eviction_log.warning(loop.time(), text, self._problem, name_of(heaviest), count)
        self._forget(evicted)
        evicted.drain()
        error = ServerBusy(self._problem, retry_after=RETRY_AFTER)
        loop.call_later(GRACE, evicted.abort, error)
        return True

    def _close_oldest(self, newest: AdmittedConnection) -> None:
        oldest = self._unauthenticated.pop_oldest(self._unauthenticated.largest())
        self._unauthenticated_log.warning(
            newest.loop.time(),
            "more than %d connections without a proof; closed the oldest, from %s",
            self._most_unauthenticated,
            oldest.peer_name,
        )
        oldest.abort(ServerBusy("too many connections without a proof"))

    def _refuse(self, connection: AdmittedConnection) -> None:
        """Refuse a connection; until it is gone it counts among those without a proof."""
        now, problem = connection.loop.time(), self._problem
        self._refusal_log.warning(now, "refused %s: %s", connection.peer_name, problem)
        connection.refuse(ServerBusy(problem, retry_after=RETRY_AFTER))
