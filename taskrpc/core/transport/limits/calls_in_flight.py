"""Quotas for all calls in flight together: their number, and the bytes of their requests.

Each connection has limits of its own, which its caller knows. A caller with many connections would
multiply them, so everything beyond a few calls counts against the caller's fair share of a common
quota. Connections borrow quota in advance and in large pieces, so most calls need no check.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

from taskrpc.core.transport.limits.log_throttling import ThrottledLog
from taskrpc.core.transport.limits.quotas import FairQuota, QuotaKey, name_of
from taskrpc.core.wire.frames import LARGE
from taskrpc.core.wire.messages import Limits
from taskrpc.errors import ServerBusy

if TYPE_CHECKING:
    import asyncio

    from taskrpc.core.wire.session import Session

log = logging.getLogger("taskrpc.transport")

MAX_CALLS = 32_768
"""Calls in flight of all callers; one caller alone may have half of them."""
MAX_BYTES = 512 * 1024 * 1024
"""Bytes of their requests; one caller alone may have half of them."""
FREE = Limits(calls=16, bytes=4 * LARGE)
"""What a connection may have in flight without borrowing."""
RETRY_AFTER = 0.2
"""Seconds after which a refused caller may try again."""


class QuotaConnection(Protocol):
    """What the quotas need from a connection."""

    @property
    def session(self) -> Session:
        """Its session, which enforces the quota that it was lent."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """Its event loop."""

    @property
    def quota_key(self) -> QuotaKey:
        """The caller's key in the quotas."""


class CallsInFlight:
    """Lends quota to the connections of one endpoint, and takes unused quota back."""

    def __init__(self) -> None:
        self._calls = FairQuota(MAX_CALLS)
        self._bytes = FairQuota(MAX_BYTES)
        self._lent: dict[QuotaConnection, None] = {}
        """Connections that may have borrowed quota."""
        self._refused = ThrottledLog(log)

    def refusal(self, connection: QuotaConnection) -> ServerBusy | None:
        """Lend the quota that a connection's calls need; returns an error if that is impossible."""
        session, caller = connection.session, connection.quota_key
        limits = session.limits
        self._lent[connection] = None
        calls, size = len(session.open_calls), session.bytes_coming
        free_calls = _raised(self._calls, caller, session.free_calls, calls, limits.calls)
        free_bytes = _raised(self._bytes, caller, session.free_bytes, size, limits.bytes)
        session.set_quota(free_calls, free_bytes)
        if calls <= free_calls and size <= free_bytes:
            return None
        what = "calls" if calls > free_calls else "bytes of requests"
        text, now = "refused calls: %s has used its fair share of %s", connection.loop.time()
        self._refused.warning(now, text, name_of(caller), what)
        problem = f"this caller already has its fair share of the {what} in flight"
        return ServerBusy(problem, retry_after=RETRY_AFTER)

    def settle(self) -> None:
        """Take back quota that is no longer needed; call this about once a second."""
        for connection in list(self._lent):
            session = connection.session
            self._lower(connection, 2 * len(session.open_calls), 2 * session.bytes_coming)
            if (session.free_calls, session.free_bytes) == (FREE.calls, FREE.bytes):
                del self._lent[connection]

    def left(self, connection: QuotaConnection) -> None:
        """Take back the quota of a connection that is gone."""
        if connection in self._lent:
            del self._lent[connection]
            self._lower(connection, 0, 0)

    def _lower(self, connection: QuotaConnection, calls: int, size: int) -> None:
        session, caller = connection.session, connection.quota_key
        # A quota that is below FREE was never lent: the client's limits are that small.
        calls = min(max(FREE.calls, calls), session.free_calls)
        size = min(max(FREE.bytes, size), session.free_bytes)
        if calls < session.free_calls:
            self._calls.give(caller, session.free_calls - calls)
        if size < session.free_bytes:
            self._bytes.give(caller, session.free_bytes - size)
        session.set_quota(calls, size)


def _raised(quota: FairQuota, caller: QuotaKey, lent: int, needed: int, most: int) -> int:
    """Borrow twice the need, else the need, else nothing; return the new quota."""
    for wanted in (min(2 * needed, most), needed):
        if lent < wanted and needed <= wanted and quota.take(caller, wanted - lent):
            return wanted
    return lent
