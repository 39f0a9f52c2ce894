"""`taskrpc-server --web`: metrics of the server, pages that show them, and the live page."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import asynccontextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import srvgen
from taskrpc import Observers, Role
from taskrpc.cli.shared.page_link import NotedLink, PageLink
from taskrpc.cli.shared.remote import Remote
from taskrpc.course.classroom.own_addresses import own_addresses
from taskrpc.course.classroom.register import Register
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.observe.metrics import Metrics
from taskrpc.observe.metrics.tasks import MeasuredStore, task_families
from taskrpc.robot.tasks.model import RUNNING_KEY
from taskrpc.robot.tasks.records.store import TaskStore
from taskrpc.robot.tasks.services.offered_tasks import OfferedTasks, load_types
from taskrpc.spi import AccountSource, address_here, check_listen_policy, is_loopback, split_address

try:
    from taskrpc.bridges.rosbridge.server import RosbridgeServer
    from taskrpc.observe.web import task_pages
    from taskrpc.observe.web.server import WebServer
except ModuleNotFoundError as error:
    if error.name and error.name.startswith("taskrpc"):
        raise
    raise TaskRpcError(f"--web needs {error.name}: pip install aiohttp") from None

from taskrpc.observe.web.calls import CallLog
from taskrpc.observe.web.control import NODE, Control
from taskrpc.observe.web.graph import NodeGraph
from taskrpc.observe.web.live import Live
from taskrpc.observe.web.pages import static_files
from taskrpc.observe.web.server import LivePage
from taskrpc.observe.web.streams import LiveStream
from taskrpc.observe.web.tokens import Tokens

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from taskrpc.cli.course.classroom.live_class import LiveClass


_MAX_QUEUED = 1000
"""Most queued tasks that are counted for the students of a class."""


class Monitoring:
    """Measures a server, and serves its pages and its live page at HOST:PORT.

    Pages of `origins` may open a WebSocket there too, besides those that this user serves on this
    machine. A reverse proxy may serve the pages at these addresses.
    """

    def __init__(
        self, address: str, access: Remote, accounts: str | None, origins: Sequence[str] = ()
    ) -> None:
        self.metrics = Metrics()
        self._calls = CallLog()
        self.observer = Observers(self.metrics, self._calls)
        """Receives the events of the node."""
        self._address = address
        self._origins = origins
        self._tls = access.tls
        self._token = access.token or os.environ.get("TASKRPC_TOKEN") or ""
        self._accounts = AccountSource(accounts) if accounts else None
        self.tokens = Tokens(self._token, self._accounts)
        """The tokens that the live page accepts."""
        self._class: LiveClass | None = None
        self._rosbridge: RosbridgeServer | None = None
        self._node: Node | None = None
        self._service = "/robot_task"

    def measured(self, store: TaskStore) -> TaskStore:
        """Return the store with metrics of its commits."""
        measured = MeasuredStore(store)
        self.metrics.add(measured.families)
        return measured

    def web(self, server: OfferedTasks, node: Node, class_folder: str | None = None) -> WebServer:
        """Return the web server of a task server and its node. Raises CannotListen.

        The live page shows the class of `class_folder`, if it is given.
        """
        self._node = node
        self._service = node.resolve_service_name("robot_task")
        self.metrics.add(lambda: task_families(server.manager))
        pages = task_pages(server, self.metrics)
        has_secrets = self._token or self._accounts is not None
        may_look = self.tokens.may_look if has_secrets else None
        live = self._live_page(server, node, self._students(server, node, class_folder))
        host, _ = split_address(self._address)
        # The certificate of a class is for its laptops: the lecturer's browser would warn of it.
        tls = None if class_folder is not None and is_loopback(host) else self._tls
        self._rosbridge = RosbridgeServer(node, may_connect=self._is_own_token)
        web = WebServer(
            pages,
            listen=self._address,
            tls=tls,
            may_look=may_look,
            live=live,
            upgrade=self._rosbridge.handle,
            origins=self._origins,
            names=() if is_loopback(host) else _names(class_folder),
        )
        if not is_loopback(host):
            known = self._accounts.current if self._accounts is not None else None
            check_listen_policy(host, certificate=True, token=self._token, accounts=known, ca=False)
        return web

    def _is_own_token(self, given: str) -> bool:
        """Whether a bearer token gives the rights of the server's own user."""
        holder = self.tokens.holder(given)
        return holder is not None and not holder.account

    def share_students(self, other: Monitoring) -> None:
        """Count the calls of the students together with the page of another robot."""
        self._calls.accounts = other._calls.accounts

    def forget_students(self) -> None:
        """Forget what the students of the class have done: the next group begins."""
        self._calls.accounts.clear()
        if self._class is not None:
            self._class.forget()

    @asynccontextmanager
    async def serving(self, web: WebServer) -> AsyncIterator[WebServer]:
        """Serve, and note the links of the live page for `taskrpc view`. Raises CannotListen."""
        async with web:
            self._announce(web)
            tokens = self.tokens
            link = PageLink(os.getpid(), web.url, tokens.view, tokens.control, self._service)
            noted = NotedLink(link)
            keeping = asyncio.create_task(noted.keep())
            try:
                yield web
            finally:
                keeping.cancel()
                noted.close()
                if self._rosbridge is not None:
                    await self._rosbridge.close()

    def _announce(self, web: WebServer) -> None:
        """Offer a service that returns the page's address, if other machines can reach it."""
        if self._node is None or is_loopback(split_address(self._address)[0]):
            return

        def address(_: Any, response: Any) -> Any:
            response.success, response.message = True, web.url
            return response

        # `join`: several servers of a machine may have a page each.
        self._node.create_service(
            srvgen.load("std_srvs/srv/Trigger"),
            f"{self._service}/page",
            address,
            idempotent=True,
            join=True,
            role=Role.OBSERVE,
        )

    def _students(
        self, server: OfferedTasks, node: Node, class_folder: str | None
    ) -> Callable[[], list[dict[str, Any]]] | None:
        if class_folder is None:
            return None
        from taskrpc.cli.course.classroom.live_class import (
            LiveClass,  # few servers are those of a class
        )

        def queued() -> Iterator[str]:
            waiting = server.manager.waiting(RUNNING_KEY)
            return (task.client for _, task, _ in islice(waiting, _MAX_QUEUED))

        presence = lambda: node.status().accepted  # noqa: E731
        self._class = LiveClass(Path(class_folder), self._calls.accounts, presence, queued)
        return self._class

    def _live_page(
        self,
        server: OfferedTasks,
        node: Node,
        students: Callable[[], list[dict[str, Any]]] | None,
    ) -> LivePage:
        started = time.time()

        def about() -> dict[str, object]:
            return {
                "node": node.get_fully_qualified_name(),
                "service": self._service,
                "address": node.address,
                "started": started,
            }

        def make_node(token: str) -> Node:
            address = address_here(node.address)
            known = token or self._token or None
            return Node(NODE, namespace="/", peers=[address], tls=self._tls, token=known)

        stream = LiveStream()
        graph = NodeGraph(node, self._calls)
        events = Live(
            server.manager, stream, about, calls=self._calls, graph=graph, students=students
        )
        control = Control(load_types(), make_node, service=self._service)
        return LivePage(static_files(), self.tokens, stream, events, control)


def _names(class_folder: str | None) -> Sequence[str]:
    """Return the names at which other machines reach this one, as the join strings have them."""
    return own_addresses() if class_folder is None else Register(Path(class_folder)).server.hosts
