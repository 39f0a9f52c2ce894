"""What becomes of connections whose account is taken away, expires or changes."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from taskrpc.errors import AuthenticationFailed
from taskrpc.security.roles import Accounts
from taskrpc.transport.connection.server_side import LINGER, ServingConnection
from taskrpc.wire.link import State

log = logging.getLogger("taskrpc.transport")

_GRACE = 2 * LINGER
"""Seconds after which who was shut out is cut off, whether he has read why or not."""


def look_after_accounts(
    served: Iterable[ServingConnection], accounts: Accounts, today: float
) -> None:
    """End connections whose caller's account is not what it was; `today` in seconds since 1970.

    A caller whose account only changed may finish its calls, and comes back to what it may do now.
    """
    for connection in list(served):
        proved = connection.account
        if proved is None or connection.session.state is State.CLOSED:
            continue
        account = accounts.find(proved.name, today)
        if account is None or account.secret != proved.secret:
            why = accounts.refusal(proved.name, today) or f"{proved.name} has another secret now"
            log.warning("closed the connection from %s: %s", connection.peer_name, why)
            _shut_out(connection)
        elif account != proved and connection.session.state is State.OPEN:
            log.info("the account %s changed; its connections begin anew", proved.name)
            connection.role = account.role
            if connection.subscriber is not None:  # a long call keeps the connection for a while
                connection.subscriber.role_changed()
            connection.drain()


def _shut_out(connection: ServingConnection) -> None:
    """End a connection, whatever its peer does; what runs or waits for it is cancelled now."""
    error = AuthenticationFailed("the token is not this server's any more")
    connection.refuse(error)
    for call in connection.session.lost():
        call.cancel()
    connection.owner.loop.call_later(_GRACE, connection.abort, error)
