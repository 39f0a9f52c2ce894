"""`taskrpc-server --web`: measures the server and shows it."""

from __future__ import annotations

import hmac
import os
import time

from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import TaskRpcError
from taskrpc.metrics import Metrics
from taskrpc.metrics.tasks import MeasuredStore, task_families
from taskrpc.security.accounts import AccountBook
from taskrpc.security.listen_policy import refuse_exposure
from taskrpc.security.roles import account_of
from taskrpc.tasks import TaskServer
from taskrpc.tasks.records.store import TaskStore
from taskrpc.transport.tcp.tcp_network import is_loopback, split_place

try:
    from taskrpc.web import WebServer, task_pages
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"--web needs {error.name}: pip install aiohttp") from None


class Watch:
    """Counts what a server does, and shows it at HOST:PORT."""

    def __init__(self, place: str, access: Remote, accounts: str | None) -> None:
        self.metrics = Metrics()
        self._place = place
        self._tls = access.tls
        self._token = access.token or os.environ.get("TASKRPC_TOKEN") or ""
        self._book = AccountBook(accounts) if accounts else None

    def measured(self, store: TaskStore) -> TaskStore:
        """The store, whose commits are measured from now on."""
        measured = MeasuredStore(store)
        self.metrics.add(measured.families)
        return measured

    def web(self, server: TaskServer) -> WebServer:
        """The pages of a server. Raises CannotListen."""
        self.metrics.add(lambda: task_families(server.manager))
        pages = task_pages(server, self.metrics)
        some = self._token or self._book is not None
        may_look = self._may_look if some else None
        shown = WebServer(pages, listen=self._place, tls=self._tls, may_look=may_look)
        host, _ = split_place(self._place)
        if not is_loopback(host):
            known = self._book.now if self._book is not None else None
            refuse_exposure(host, certificate=True, token=self._token, accounts=known, ca=False)
        return shown

    def _may_look(self, given: str) -> bool:
        """Whether a bearer token is the server's own, or that of an account: all may look."""
        said = given.encode(errors="replace")
        if self._token and hmac.compare_digest(said, self._token.encode()):
            return True
        if self._book is None:
            return False
        self._book.look()
        account = self._book.now.find(account_of(said), time.time())
        # Compared all the same, so that the time tells nobody which accounts there are.
        expected = said[::-1] + b"-" if account is None else account.token.encode()
        return hmac.compare_digest(said, expected)
