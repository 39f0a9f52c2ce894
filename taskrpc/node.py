"""A node: a name on a network, with services, clients and topics of its own."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

from srvgen import excepthook
from taskrpc import names, platform, script_errors
from taskrpc.client import DEFAULT_TIMEOUT, Client
from taskrpc.errors import ServiceUnavailable, TaskRpcError, WouldDeadlock
from taskrpc.message_types import RequestT, ResponseT, Srv, service_type
from taskrpc.node_topics import NodeTopics
from taskrpc.request_ids.ids import CompletionStore
from taskrpc.retry import RetryPolicy
from taskrpc.security.roles import Accounts, Role
from taskrpc.security.tls import Tls
from taskrpc.transport.base import Mode, Transport
from taskrpc.transport.discovery.entries import RegistryEntry
from taskrpc.transport.shared_endpoint import lab_namespace, shared_transport

if TYPE_CHECKING:
    from taskrpc.deferred import DeferredService, Take
    from taskrpc.observer import NodeStatus, Observer
    from taskrpc.service import Callback, Service

_Result = TypeVar("_Result")

DRAIN_GRACE = 30.0
"""Seconds that calls in flight get when a node shuts down."""


class Node(NodeTopics):
    """A participant: offers services, calls others'.

    Use it as `async with taskrpc.Node("name") as node:`. All nodes of one program and event loop
    share one listening socket and its connections.

    Arguments:
        name, namespace: by ROS's naming rules. Without a namespace it is the root, or the one that
            this user has in the lab that was joined (`taskrpc join`), where the lab is called.
        transport: `tcp`, or `memory` for nodes of this event loop only (tests, demos).
        listen: `HOST:PORT` to take calls at, or `unix:/path` (`unix:` alone: in the runtime
            folder); any free loopback port unless said.
        peers: `HOST:PORT` (or `unix:/path`) of processes to call, instead of this machine's
            registry (`TASKRPC_PEERS` where not given).
        tls: certificates, for nodes that are reached from, or call, other machines.
        token: the secret that callers and peers on other machines must know
            (`TASKRPC_TOKEN` where not given); processes of one user and machine need none.
        accounts: the other users that may call, with their roles; `Accounts`, or a file of them
            (JSON, TOML) that is read again when it changes. Without them, the token allows
            everything.
        keepalive: how soon a peer whose machine is gone is given up: after 8 s (`default`) or
            2 s (`robot`); `TASKRPC_KEEPALIVE` where not given.
        observer: is told what becomes of each call; a `Metrics`, or an `Observer` of your own.
    """

    _threads = False
    """Whether other threads than the event loop's call."""

    domain: int | None = None
    """Its domain if that is not `ROS_DOMAIN_ID`; to be set before `start`."""

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "",
        transport: str = "tcp",
        listen: str | None = None,
        peers: Sequence[str] | None = None,
        tls: Tls | None = None,
        token: str | None = None,
        accounts: Accounts | str | Path | None = None,
        keepalive: str | None = None,
        observer: Observer | None = None,
    ) -> None:
        super().__init__()
        script_errors.show_in_one_message()
        self._name = names.check_node_name(name)
        in_lab = "" if namespace else lab_namespace(transport, peers)
        self._namespace = names.check_namespace(namespace or in_lab)
        self._is_in_lab = bool(in_lab)
        self._transport_name = transport
        self._listen, self._peers, self._tls = listen, peers, tls
        self._token = token or os.environ.get("TASKRPC_TOKEN")
        self._accounts = accounts
        self._keepalive = keepalive
        self._observer = observer
        self._transport: Transport | None = None
        # Ordered sets: thousands may come and go.
        self._services: dict[Service | DeferredService, None] = {}
        self._clients: dict[Client[Any, Any], None] = {}
        self._retries: dict[str, int] = {}
        """Those of clients that are gone."""

    # What it is

    def get_name(self) -> str:
        """The node's name, without its namespace."""
        return self._name

    def get_namespace(self) -> str:
        """The node's namespace, which begins with `/`."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""
        return names.fully_qualified(self._namespace, self._name)

    def resolve_service_name(self, srv_name: str) -> str:
        """The absolute name that a service name means for this node."""
        return names.expand(srv_name, namespace=self._namespace, node=self._name)

    @property
    def address(self) -> str:
        """Where it takes calls: `HOST:PORT` or `unix:/path`, "" before it offers anything."""
        return self._transport.address if self._transport is not None else ""

    # Its life

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        excepthook.explain(error)
        await self.destroy()

    if not TYPE_CHECKING:  # type checkers report `with`; programs get a better message

        def __enter__(self):
            raise TaskRpcError(
                "taskrpc.Node is asynchronous: write `async with taskrpc.Node(...) as node:`,"
                " or `with taskrpc.sync.Node(...) as node:` in a program without async"
            )

        def __exit__(self, *_):
            """Never called: `with` looks it up before it calls `__enter__`."""

    async def start(self) -> None:
        """Join the network; `async with` does it."""
        if self._transport is None:
            self._transport = shared_transport(
                self._transport_name,
                listen=self._listen,
                peers=self._peers,
                token=self._token,
                accounts=self._accounts,
                keepalive=self._keepalive,
                tls=self._tls,
                threads=self._threads,
                domain=self.domain,
            )
            self._transport.add_node(self.get_fully_qualified_name())
            self._tell(lambda observer: observer.node_started(self))

    async def destroy(self) -> None:
        """Withdraw all that it has and leave the network; `async with` does it.

        It does not wait: callers of what still runs learn that the outcome is unknown. Use `drain`
        before to let them have their answers.
        """
        if self._transport is None:
            return
        self._tell(lambda observer: observer.node_ended(self))
        for service in self._services:
            service.abandon()
        for client in list(self._clients):
            client.destroy()
        self._destroy_parts()
        self._services.clear()
        transport, self._transport = self._transport, None
        transport.remove_node(self.get_fully_qualified_name())
        await transport.release()

    async def spin(self) -> None:
        """Serve until Ctrl-C, SIGTERM or a cancellation; then finish the calls in flight.

        A second signal ends the program at once.
        """
        await self.start()
        async with stop_requested() as stopped:
            try:
                await stopped
            finally:
                await self.drain()

    async def drain(self, grace: float = DRAIN_GRACE) -> None:
        """Withdraw the services; wait until calls in flight are answered, at most `grace` seconds.

        Later calls go to another server of the name, where there is one.
        """
        for service in self._services:
            service.destroy()
        if self._services:
            await asyncio.wait([each.finished for each in self._services], timeout=grace)

    # What it has

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callback[RequestT, ResponseT],
        *,
        concurrency: int | None = None,
        threaded: bool = False,
        idempotent: bool = False,
        exactly_once: CompletionStore | None = None,
        join: bool = False,
        role: Role = Role.SUBMIT,
    ) -> Service:
        """Offer a service: `callback(request, response)` is called for each request.

        It returns the response. It may be async. A plain one runs on the event loop and must be
        quick; `threaded=True` runs it in a thread instead. `concurrency` calls run at a time,
        later ones wait their turn: 1 unless said. `idempotent=True` tells clients that repeating a
        call does no harm. With `exactly_once=store` a repeated call is not run again but answered
        as before, also by a later server of the same store; the callback may return an `Effect`.
        As many calls run at a time then as a caller may have in flight, each until its effect is
        stored; with `concurrency=1` a call sees what those before it have stored. `join=True`
        allows other processes to offer the same name. `role` is the least that the caller's account
        must have, where the node has accounts.

        Raises NameInUse, InvalidName, CannotListen; StoreError where another loop uses the store.
        """
        from taskrpc.service import Service  # with threads for callbacks; clients need none

        service = Service(
            self._started(),
            service_type(srv_type),
            self.resolve_service_name(srv_name),
            self.get_fully_qualified_name(),
            callback,
            concurrency=concurrency,
            threaded=threaded,
            mode=Mode.IDEMPOTENT if idempotent else Mode.AT_MOST_ONCE,
            store=exactly_once,
            join=join,
            observer=self._observer,
            role=role,
        )
        self._keep(service)
        return service

    def create_deferred_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        take: Take[RequestT, ResponseT],
        *,
        join: bool = False,
        role: Role = Role.SUBMIT,
    ) -> DeferredService:
        """Offer a service whose calls are answered later, from any thread.

        `take(call)` is called on the event loop for each `DeferredCall` and returns at once; then
        `call.reply(response)` or `call.fail(error)` ends the call, whenever and in whatever order
        the program likes. Nothing limits how many are open.

        Raises InvalidName; NameInUse, unless it joins a server of the same name.
        """
        from taskrpc.deferred import DeferredService  # few programs have a way of their own

        service = DeferredService(
            self._started(),
            service_type(srv_type),
            self.resolve_service_name(srv_name),
            self.get_fully_qualified_name(),
            take,
            join=join,
            observer=self._observer,
            role=role,
        )
        self._keep(service)
        return service

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
    ) -> Client[RequestT, ResponseT]:
        """A client of a service; `timeout` (seconds) and `retry` hold for all its calls."""
        client = self._client_maker()(
            self._started(),
            service_type(srv_type),
            self.resolve_service_name(srv_name),
            self.get_fully_qualified_name(),
            timeout=timeout,
            retry=retry,
            forget=self._forget_client,
            otherwise=self._name_in_lab(srv_name),
        )
        self._clients[client] = None
        return client

    async def graph(self) -> list[RegistryEntry]:
        """Every process that this node can see: its nodes, and what they have."""
        return await self._started().graph()

    async def definition(self, srv_name: str) -> tuple[str, str]:
        """A service's type name and the full text of its definition, told by its server.

        Raises ServiceUnavailable when nobody offers it.
        """
        transport, otherwise = self._started(), self._name_in_lab(srv_name)
        try:
            return await transport.definition(self.resolve_service_name(srv_name))
        except ServiceUnavailable:
            if not otherwise:
                raise
            return await transport.definition(otherwise)

    def status(self) -> NodeStatus:
        """What this node has to do now, and what it has done since it started."""
        retries = dict(self._retries)
        for client in list(self._clients):  # another thread may ask
            name = client.service_name
            retries[name] = retries.get(name, 0) + client.retries
        services = tuple(service.status() for service in list(self._services))
        from taskrpc.observer import NodeStatus  # few programs ask

        traffic = self._started().traffic()
        return NodeStatus(services, retries, *traffic, self._topic_status())

    def _keep(self, service: Service | DeferredService) -> None:
        self._services[service] = None
        service.finished.add_done_callback(lambda _: self._services.pop(service, None))

    def _name_in_lab(self, name: str) -> str:
        """What else a relative name may mean: what the lab itself has, "" for nothing.

        The lab has its services and topics in the root; programs that were not written for a lab
        name them by relative names.
        """
        if not self._is_in_lab or name.startswith(("/", "~")):
            return ""
        return names.expand(name, node=self._name)

    def _tell(self, tell: Callable[[Observer], None]) -> None:
        if self._observer is not None:
            from taskrpc.observer import told

            told(tell, self._observer)

    def _client_maker(self) -> Callable[..., Client[Any, Any]]:
        if self._observer is None:
            return Client
        from taskrpc.observed_client import ObservedClient  # programs that want it are few

        return partial(ObservedClient, self._observer)

    def _forget_client(self, client: Client[Any, Any]) -> None:
        if client in self._clients:
            del self._clients[client]
            name = client.service_name
            if client.retries:  # names that a program was told may be many
                self._retries[name] = self._retries.get(name, 0) + client.retries

    def _started(self) -> Transport:
        if self._transport is None:
            way = "async with taskrpc.Node(...) as node:` or call `await node.start()"
            if self._threads:
                way = "with taskrpc.sync.Node(...) as node:` or call `node.start()"
            raise TaskRpcError(f"the node {self._name} has not started; write `{way}`")
        return self._transport


@contextlib.asynccontextmanager
async def stop_requested() -> AsyncIterator[asyncio.Future[int]]:
    """A future that is done when the program gets Ctrl-C, SIGTERM or Ctrl-Break.

    Its result is the signal's number. Signals are caught while the block runs; a second one ends
    the program at once.
    """
    loop = asyncio.get_running_loop()
    stopped: asyncio.Future[int] = loop.create_future()

    def stop(number: int) -> None:
        if stopped.done():
            os._exit(128 + number)
        stopped.set_result(number)

    with platform.stop_signals(lambda number: loop.call_soon_threadsafe(stop, number)):
        yield stopped


def run(main: Coroutine[Any, Any, _Result]) -> _Result:
    """Run a coroutine to its end: `asyncio.run`, on uvloop where it is installed.

    An error of taskrpc that escapes from a script is shown as one message without a traceback,
    and sets the script's exit status as in the commands' table.

    Raises:
        TaskRpcError: `main` is not a coroutine.
        WouldDeadlock: an event loop is already running, as in a notebook; await `main()` there.
    """
    script_errors.show_in_one_message()
    _check_main(main)
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        return runner.run(main)


def _check_main(main: Any) -> None:
    """Refuse what `run` cannot run."""
    name = getattr(main, "__name__", "main")
    if not inspect.iscoroutine(main):
        found = f"the function {name}" if callable(main) else repr(main)
        raise TaskRpcError(
            f"taskrpc.run: expected a coroutine, got {found}; write taskrpc.run({name}())"
        )
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return
    main.close()
    raise WouldDeadlock(
        "taskrpc.run: an event loop runs already, as in a notebook or an async function;"
        f" write `await {name}()` there"
    )


def fast_loop() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """uvloop's loop where it is installed, else None for asyncio's own."""
    try:
        from uvloop import new_event_loop
    except ImportError:
        return None
    return cast("Callable[[], asyncio.AbstractEventLoop]", new_event_loop)
