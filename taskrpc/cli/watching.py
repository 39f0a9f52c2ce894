"""`taskrpc-server --web`: measures the server and shows it."""

from __future__ import annotations

import hmac
import os

from taskrpc.cli.remote import Remote
from taskrpc.errors import TaskRpcError
from taskrpc.metrics import Metrics
from taskrpc.metrics.tasks import MeasuredStore, task_families
from taskrpc.tasks import TaskServer
from taskrpc.tasks.store import TaskStore

try:
    from taskrpc.web import WebServer, task_pages
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"--web needs {error.name}: pip install 'taskrpc[web]'") from None


class Watch:
    """Counts what a server does, and shows it at HOST:PORT."""

    def __init__(self, place: str, access: Remote) -> None:
        self.metrics = Metrics()
        self._place = place
        self._tls = access.tls
        self._token = access.token or os.environ.get("TASKRPC_TOKEN") or ""

    def measured(self, store: TaskStore) -> TaskStore:
        """The store, whose commits are measured from now on."""
        measured = MeasuredStore(store)
        self.metrics.add(measured.families)
        return measured

    def web(self, server: TaskServer) -> WebServer:
        """The pages of a server. Raises CannotListen."""
        self.metrics.add(lambda: task_families(server.manager))
        pages = task_pages(server, self.metrics)
        may_look = self._may_look if self._token else None
        return WebServer(pages, listen=self._place, tls=self._tls, may_look=may_look)

    def _may_look(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(errors="replace"), self._token.encode())
