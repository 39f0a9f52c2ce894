"""`taskrpc-server --web`: metrics of the server, and pages that show them."""

from __future__ import annotations

import hmac
import os
import time

from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import TaskRpcError
from taskrpc.metrics import Metrics
from taskrpc.metrics.tasks import MeasuredStore, task_families
from taskrpc.node import Node
from taskrpc.security.accounts import AccountSource
from taskrpc.security.listen_policy import check_listen_policy
from taskrpc.security.roles import account_of
from taskrpc.tasks import TaskServer
from taskrpc.tasks.records.store import TaskStore
from taskrpc.transport.tcp.tcp_network import is_loopback, split_place

try:
    from taskrpc.rosbridge.server import RosbridgeServer
    from taskrpc.web import WebServer, task_pages
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"--web needs {error.name}: pip install aiohttp") from None


class Monitoring:
    """Measures a server, and serves its pages `/health` and `/metrics` at HOST:PORT."""

    def __init__(self, place: str, access: Remote, accounts: str | None) -> None:
        self.metrics = Metrics()
        self._place = place
        self._tls = access.tls
        self._token = access.token or os.environ.get("TASKRPC_TOKEN") or ""
        self._accounts = AccountSource(accounts) if accounts else None

    def measured(self, store: TaskStore) -> TaskStore:
        """Return the store with metrics of its commits."""
        measured = MeasuredStore(store)
        self.metrics.add(measured.families)
        return measured

    def web(self, server: TaskServer, node: Node) -> WebServer:
        """Return the web server of a task server and its node. Raises CannotListen."""
        self.metrics.add(lambda: task_families(server.manager))
        pages = task_pages(server, self.metrics)
        has_secrets = self._token or self._accounts is not None
        may_look = self._may_look if has_secrets else None
        rosbridge = RosbridgeServer(node, may_connect=self._is_own_token)
        web = WebServer(
            pages,
            listen=self._place,
            tls=self._tls,
            may_look=may_look,
            upgrade=rosbridge.handle,
        )
        host, _ = split_place(self._place)
        if not is_loopback(host):
            known = self._accounts.current if self._accounts is not None else None
            check_listen_policy(host, certificate=True, token=self._token, accounts=known, ca=False)
        return web

    def _is_own_token(self, given: str) -> bool:
        """Whether a bearer token is the server's own."""
        own = self._token.encode()
        return bool(own) and hmac.compare_digest(given.encode(errors="replace"), own)

    def _may_look(self, given: str) -> bool:
        """Whether a bearer token is the server's or an account's; both may see the pages."""
        if self._is_own_token(given):
            return True
        token = given.encode(errors="replace")
        if self._accounts is None:
            return False
        self._accounts.refresh()
        account = self._accounts.current.find(account_of(token), time.time())
        # Compare in every case: the time of the response must not reveal which accounts exist.
        expected = token[::-1] + b"-" if account is None else account.token.encode()
        return hmac.compare_digest(token, expected)
