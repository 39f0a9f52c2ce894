"""A node: a name on the network that owns services, clients, publishers, subscriptions, timers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

from srvgen import excepthook
from taskrpc.core import names
from taskrpc.core.request_ids.ids import CompletionStore
from taskrpc.core.security.roles import Accounts, Role
from taskrpc.core.transport.base import DEFAULT_TIMEOUT, Mode, OnMismatch, ProgramStatistics
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.transport.shared_endpoint import lab_namespace, shared_endpoint
from taskrpc.errors import ServiceUnavailable, TaskRpcError
from taskrpc.message_types import (
    Action,
    FeedbackT,
    GoalT,
    MsgT,
    RequestT,
    ResponseT,
    ResultT,
    Srv,
    action_type,
    message_type,
    service_type,
)
from taskrpc.program import show_errors_in_one_message, stop_requested
from taskrpc.qos import QoS, qos_of

if TYPE_CHECKING:
    from taskrpc.actions.client import ActionClient
    from taskrpc.actions.server import ActionServer
    from taskrpc.actions.server_goal import AcceptCancel, AcceptGoal, Execute
    from taskrpc.client import Client
    from taskrpc.core.introspection import IntrospectionState, ServiceIntrospection
    from taskrpc.core.observer import NodeStatus, Observer, TopicStatus
    from taskrpc.core.security.tls import Tls
    from taskrpc.core.transport.connection.incoming_call import RouteFaults
    from taskrpc.deferred import DeferredService, Take
    from taskrpc.retry import RetryPolicy
    from taskrpc.service import Callback, Service
    from taskrpc.timer import Timer
    from taskrpc.topic import Publisher, Subscription

log = logging.getLogger("taskrpc.node")

DRAIN_GRACE = 30.0
"""Seconds that calls in flight get when a node shuts down."""
GOAL_GRACE = 2.0
"""Seconds that goals get when a node shuts down: they may take far longer than calls."""


def unspun_text(name: str, offered: Sequence[str], advice: str) -> str:
    """Return the warning about a node whose program ends before a callback of it could run."""
    which = f", which offers {', '.join(offered)}," if offered else ""
    return f"the node {name}{which} ends before a callback of it could run; {advice}"


class _Part(Protocol):
    """A publisher, subscription, timer or action client of a node."""

    def destroy(self) -> None: ...
    def _count_into(self, topics: dict[str, TopicStatus]) -> None: ...


class Node:
    """A participant of the network: offers services and topics, and calls the services of others.

    Use it as `async with taskrpc.Node("name") as node:`. All nodes of one program and event loop
    share one listening socket and its connections.

    Args:
        name: follows ROS's naming rules.
        namespace: follows ROS's naming rules. The default is the root namespace; for a node that
            calls the lab of `taskrpc join`, it is the user's namespace in this lab.
        transport: `tcp`; `zenoh` to meet ROS 2 programs on rmw_zenoh too; or `memory` for nodes of
            this event loop only (tests, demos).
        listen: `HOST:PORT` to listen at, or `unix:/path`; `unix:` alone chooses a path in the
            runtime folder. The default is any free loopback port.
        peers: `HOST:PORT` (or `unix:/path`) of processes to call, instead of this machine's
            registry (`TASKRPC_PEERS` if not given). Over Zenoh, the addresses of routers.
        tls: certificates, for connections to and from other machines.
        token: the secret that callers and peers on other machines must know
            (`TASKRPC_TOKEN` if not given). Processes of the same user on this machine need none.
        accounts: the other users that may call, with their roles: `Accounts`, or the path of a
            JSON or TOML file. The node reads the file again when it changes. Without accounts, the
            token allows everything.
        keepalive: when to give up on a silent peer: `default` (8 s) or `robot` (2 s);
            `TASKRPC_KEEPALIVE` if not given.
        observer: receives an event for each call; a `Metrics`, or an `Observer` of your own.
        faults: faults to inject into the calls of its services, for tests and for teaching: a
            `taskrpc.testing.CallFaults`.
    """

    _threads = False
    """Whether threads other than the event loop's use the node."""

    domain: int | None = None
    """The node's domain if it is not `ROS_DOMAIN_ID`; set it before `start`."""

    default_observer: ClassVar[Observer | None] = None
    """Observes the nodes that are created without an observer; a notebook sets it."""

    default_faults: ClassVar[RouteFaults | None] = None
    """Faults of the nodes that are created without any; a simulation sets it."""

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
        faults: RouteFaults | None = None,
    ) -> None:
        show_errors_in_one_message()
        self._name = names.check_node_name(name)
        in_lab = "" if namespace else lab_namespace(transport, peers)
        self._namespace = names.check_namespace(namespace or in_lab)
        self._is_in_lab = bool(in_lab)
        self._open_transport = partial(
            shared_endpoint,
            transport,
            listen=listen,
            peers=peers,
            token=token or os.environ.get("TASKRPC_TOKEN"),
            accounts=accounts,
            keepalive=keepalive,
            tls=tls,
            threads=self._threads,
            faults=faults or self.default_faults,
        )
        self._observer = observer or self.default_observer
        self._transport: Endpoint | None = None
        """None before `start` and after `destroy`."""
        # Dicts as ordered sets: removing one of thousands of entries is fast.
        self._services: dict[Service | DeferredService | ActionServer, Callable[[], None]] = {}
        """The services and actions, and how each begins to end when the program is stopped."""
        self._clients: dict[Client[Any, Any], None] = {}
        self._retries: dict[str, int] = {}
        """Retries of destroyed clients, by service."""
        self._parts: dict[_Part, None] = {}
        """The publishers, subscriptions, timers and action clients."""
        self._earlier_topics: dict[str, TopicStatus] = {}
        """The counts of destroyed publishers and subscriptions, by topic."""
        self._introspection: ServiceIntrospection | None = None
        """None until `configure_introspection` is called."""
        self._can_run_callbacks: bool | None = None
        """False until the program awaits something; None if the node has no callbacks."""

    # Names and address

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
        """Return the absolute name that a service name means for this node."""
        return names.expand(srv_name, namespace=self._namespace, node=self._name)

    @property
    def address(self) -> str:
        """The address for calls: `HOST:PORT` or `unix:/path`; "" until the node offers anything."""
        return self._transport.address if self._transport is not None else ""

    # Start and end

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
        if error is None and self._can_run_callbacks is False:
            self._warn_unspun("await node.spin()")
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
            await self._start()

    async def _start(self) -> None:
        transport = self._open_transport(domain=self.domain)
        try:
            await transport.open()
        except BaseException:
            await transport.release()
            raise
        if self._transport is not None:  # another task has started the node meanwhile
            await transport.release()
            return
        self._transport = transport
        transport.add_node(self.get_fully_qualified_name())
        self._notify(lambda observer: observer.node_started(self))
        if self._observer is not None and self._observer is self.default_observer:
            # A notebook's observer ends the node that this one replaces, before this one offers
            # the same services.
            await asyncio.sleep(0)

    async def destroy(self) -> None:
        """Withdraw the node's services and topics and leave the network; `async with` does it.

        It does not wait: callers whose calls still run get OutcomeUnknown. Call `drain` first to
        let those calls finish.
        """
        if self._transport is None:
            return
        self._notify(lambda observer: observer.node_ended(self))
        for service in list(self._services):
            service.abandon()
        for client in list(self._clients):
            client.destroy()
        for part in list(self._parts):
            part.destroy()
        self._services.clear()
        transport, self._transport = self._transport, None
        transport.remove_node(self.get_fully_qualified_name())
        await transport.release()

    async def spin(self) -> None:
        """Serve until Ctrl-C, SIGTERM or a cancellation; then finish the calls in flight.

        Goals of its actions are cancelled, and aborted if they still run 2 s later. A second signal
        ends the program at once.
        """
        await self.start()
        async with stop_requested() as stopped:
            try:
                await stopped
            finally:
                await self._finish()

    def _warn_unspun(self, spin: str) -> None:
        """Say that the program ends before a callback of this node could run."""
        left = [service for service in self._services if not service.finished.done()]
        if not left and not self._parts:
            return
        offered = [service.status().name for service in left]
        log.warning(unspun_text(self._name, offered, f"end its block with `{spin}`"))

    async def _finish(self) -> None:
        """Drain; but goals, which may take hours, are cancelled."""
        for end in list(self._services.values()):
            end()
        await self.drain()

    async def drain(self, grace: float = DRAIN_GRACE) -> None:
        """Withdraw the services and wait for calls in flight and goals, at most `grace` seconds.

        Later calls go to another server of the same service, if there is one.
        """
        for service in self._services:
            service.destroy()
        if self._services:
            await asyncio.wait([each.finished for each in self._services], timeout=grace)

    # Services, clients, publishers, subscriptions, timers

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

        The callback returns the response.

        Args:
            srv_type: the class of the service.
            srv_name: the name of the service.
            callback: it may be async. A plain callback runs on the event loop and must be quick.
            concurrency: how many calls run at a time; later calls wait. The default is 1. With
                `exactly_once` it is the number of calls that a caller may have in flight; with
                `concurrency=1`, each call sees the stored effects of the calls before it.
            threaded: whether a plain callback runs in a thread instead of on the event loop.
            idempotent: whether clients may repeat a call, because repeating it does no harm.
            exactly_once: a store. A repeated call does not run again but gets the stored response,
                also from a later server of the same store. The callback may return an `Effect`;
                then the call ends only when the effect is stored.
            join: whether other processes may offer a service with the same name.
            role: the least role that the caller's account must have, if the node has accounts.

        Raises NameInUse, InvalidName, CannotListen; StoreError if the store cannot be used, or
        another loop uses it.
        """
        from taskrpc.service import Service  # imports thread pools, which clients do not need

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
        self._keep(service, service.destroy)
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
        """Offer a service; the program responds to its calls later, from any thread.

        `take(call)` is called on the event loop for each `DeferredCall`, and must return at once.
        The program ends each call with `call.reply(response)` or `call.fail(error)`, at any time
        and in any order. The number of open calls is not limited.

        Raises InvalidName; NameInUse, unless it joins a server of the same name.
        """
        from taskrpc.deferred import DeferredService  # few programs need it

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
        self._keep(service, service.destroy)
        return service

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
    ) -> Client[RequestT, ResponseT]:
        """Return a client of a service; `timeout` (seconds) and `retry` apply to all its calls."""
        client = self._client_maker()(
            self._started(),
            service_type(srv_type),
            self.resolve_service_name(srv_name),
            self.get_fully_qualified_name(),
            timeout=timeout,
            retry=retry,
            forget=self._forget_client,
            otherwise=self._names_in_lab(srv_name),
        )
        self._clients[client] = None
        return client

    def resolve_topic_name(self, topic: str) -> str:
        """Return the absolute name that a topic name means for this node."""
        return names.expand(topic, namespace=self._namespace, node=self._name, kind="topic name")

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos: QoS | int = 10,
        *,
        role: Role = Role.OBSERVE,
        on_mismatch: OnMismatch | None = None,
    ) -> Publisher[MsgT]:
        """Publish messages of a type on a topic; a number as `qos` is the depth.

        `role` is the least role that a subscriber's account must have, if the node has accounts.
        For a subscription that does not match, the node logs a warning, or calls
        `on_mismatch(reason)` on the event loop; the reason is `TYPE`, `RELIABILITY`,
        `DURABILITY`, `DEADLINE` or `LIVELINESS`.

        Raises InvalidName, CannotListen.
        """
        from taskrpc.topic import Publisher  # few programs need it

        publisher = Publisher(
            self._started(),
            message_type(msg_type),
            self.resolve_topic_name(topic),
            self.get_fully_qualified_name(),
            qos_of(qos),
            role,
            self._forget_part,
            on_mismatch,
        )
        self._parts[publisher] = None
        return publisher

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: Callable[[MsgT], object],
        qos: QoS | int = 10,
        *,
        threaded: bool = False,
        on_mismatch: OnMismatch | None = None,
    ) -> Subscription[MsgT]:
        """Call `callback(message)` for each message of a topic; a number as `qos` is the depth.

        The callback may be async. A plain callback runs on the event loop and must be quick;
        `threaded=True` runs it in a thread instead. One call runs at a time; meanwhile, the last
        `depth` messages wait. The node finds publishers whenever they appear. For a publisher that
        does not match, it calls `on_mismatch` as in `create_publisher`.

        Raises InvalidName.
        """
        from taskrpc.topic import Subscription  # few programs need it

        subscription = Subscription(
            self._started(),
            message_type(msg_type),
            self.resolve_topic_name(topic),
            self.get_fully_qualified_name(),
            callback,
            qos_of(qos),
            threaded=threaded,
            forget=self._forget_part,
            on_mismatch=on_mismatch,
            otherwise=next(iter(self._names_in_lab(topic)), ""),
        )
        self._parts[subscription] = None
        self._expect_callbacks()
        return subscription

    def create_timer(
        self, period: float, callback: Callable[[], object], *, threaded: bool = False
    ) -> Timer:
        """Call `callback()` every `period` seconds, first after one period.

        The callback may be async; a plain callback runs on the event loop unless `threaded=True`.
        Calls that are due while a call runs are skipped.
        """
        from taskrpc.timer import Timer  # few programs need it

        self._started()
        timer = Timer(period, callback, threaded=threaded, forget=self._forget_part)
        self._parts[timer] = None
        self._expect_callbacks()
        return timer

    def create_action_server(
        self,
        act_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        execute: Execute[GoalT, ResultT, FeedbackT],
        *,
        goal: AcceptGoal[GoalT] | None = None,
        cancel: AcceptCancel[GoalT, ResultT, FeedbackT] | None = None,
        concurrency: int = 1,
        threaded: bool = False,
        result_timeout: float = 900.0,
        role: Role = Role.SUBMIT,
    ) -> ActionServer:
        """Offer an action: `execute(goal)` is called for each accepted goal and returns its result.

        In the callback, `goal.request` is the goal message. `goal.publish_feedback(feedback)` sends
        feedback. If `goal.is_cancel_requested` is true, the callback should end with
        `return goal.canceled(result)`. `return goal.abort(result)` gives the goal up; so does an
        exception. A HandlerError reaches the client with its code and message.

        Args:
            act_type: the class of the action.
            action_name: the name of the action.
            execute: it may be async. A plain callback runs on the event loop and must be quick.
            goal: `goal(request)` returns whether the server accepts a goal; it may be async. A
                HandlerError rejects the goal with a reason. The default accepts all goals.
            cancel: `cancel(goal)` returns whether the server cancels a goal; it may be async. The
                default cancels all. A goal that waits ends at once; the callback of one that runs
                must end it. At the end of `spin`, it is called outside a call.
            concurrency: how many goals run at a time; other accepted goals wait, at most 1024.
            threaded: whether a plain callback runs in a thread instead of on the event loop.
            result_timeout: the seconds for which results are kept, of at most 10,000 goals.
            role: the least role that a caller's account must have to send and cancel goals, if the
                node has accounts.

        Raises NameInUse, InvalidName, CannotListen.
        """
        from taskrpc.actions.server import ActionServer  # few programs need it

        self._started()
        server = ActionServer(
            self,
            action_type(act_type),
            action_name,
            execute,
            accept_goal=goal,
            accept_cancel=cancel,
            concurrency=concurrency,
            threaded=threaded,
            result_timeout=result_timeout,
            role=role,
        )
        for service in server.services:
            self._services.pop(service, None)  # the action server ends them
        self._keep(server, partial(server.stop, GOAL_GRACE))
        return server

    def create_action_client(
        self,
        act_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        feedback_depth: int = 16,
    ) -> ActionClient[GoalT, ResultT, FeedbackT]:
        """Return a client of an action.

        `timeout` (seconds) applies to sending and cancelling goals. Of each goal, the last
        `feedback_depth` feedback messages are kept for a program that reads them slowly.
        """
        from taskrpc.actions.client import ActionClient  # few programs need it

        self._started()
        client: ActionClient[GoalT, ResultT, FeedbackT] = ActionClient(
            self,
            action_type(act_type),
            action_name,
            timeout=timeout,
            feedback_depth=feedback_depth,
            forget=self._forget_part,
        )
        self._parts[client] = None
        return client

    def configure_introspection(
        self, service: Service, state: IntrospectionState, qos: QoS | int = 100
    ) -> None:
        """Publish an event for each step of each call of a service of this node.

        The topic is `SERVICE/_service_event`; `taskrpc service echo` shows it. With `metadata`, an
        event has the step (request received or response sent), the time and the caller. With
        `contents`, it also has the messages. `off` stops the events. If the node has accounts,
        subscribers need the role operate. Services without introspection have no extra cost.

        Raises CannotListen.
        """
        if self._introspection is None:
            from taskrpc.core.introspection import ServiceIntrospection  # few programs need it

            self._introspection = ServiceIntrospection(self, self._observer)
        self._introspection.configure(service, state, qos)

    async def graph(self) -> list[RegistryEntry]:
        """Return every process that this node can see, with its nodes, services and topics."""
        return await self._started().graph()

    async def statistics(self, timeout: float = 2.0) -> list[ProgramStatistics]:
        """Return the calls of every other program that this node can see, as `taskrpc top` does.

        The programs measure their calls from now on, until this node disconnects from them; a call
        then takes about 15 µs more. A program that does not answer within `timeout` seconds
        has a `problem`.
        """
        return await self._started().statistics(timeout)

    async def definition(self, srv_name: str) -> tuple[str, str]:
        """Return a service's type name and the text of its definition, as its server reports them.

        Raises ServiceUnavailable if no server offers it.
        """
        transport = self._started()
        *others, last = self.resolve_service_name(srv_name), *self._names_in_lab(srv_name)
        for name in others:
            with contextlib.suppress(ServiceUnavailable):
                return await transport.definition(name)
        return await transport.definition(last)

    def status(self) -> NodeStatus:
        """Return the present load of this node, and its counts since it started."""
        retries = dict(self._retries)
        for client in list(self._clients):  # a copy: another thread may call this
            name = client.service_name
            retries[name] = retries.get(name, 0) + client.retries
        services = tuple(service.status() for service in list(self._services))
        from taskrpc.core.observer import NodeStatus  # few programs need it

        traffic = self._started().traffic()
        return NodeStatus(services, retries, *traffic, self._topic_status())

    def _expect_callbacks(self) -> None:
        """Note that the node has callbacks. They run only while the program awaits something."""
        if self._can_run_callbacks is None:
            self._can_run_callbacks = False
            asyncio.get_running_loop().call_soon(self._run_callbacks)

    def _run_callbacks(self) -> None:
        self._can_run_callbacks = True

    def _keep(
        self, service: Service | DeferredService | ActionServer, end: Callable[[], None]
    ) -> None:
        self._services[service] = end
        self._expect_callbacks()
        service.finished.add_done_callback(lambda _: self._services.pop(service, None))

    def _names_in_lab(self, name: str) -> tuple[str, ...]:
        """Return where a lab may offer a relative name; nothing outside a lab.

        The user's robot has the namespace above the user's, and the lab's other services and
        topics are in the root namespace. Programs that were not written for a lab use relative
        names for them.
        """
        if not self._is_in_lab or name.startswith(("/", "~")):
            return ()
        above = self._namespace.rpartition("/")[0] or "/"
        found = (names.expand(name, namespace=each, node=self._name) for each in (above, "/"))
        return tuple(dict.fromkeys(found))

    def _notify(self, method: Callable[[Observer], None]) -> None:
        if self._observer is not None:
            from taskrpc.core.observer import call_observer

            call_observer(method, self._observer)

    def _client_maker(self) -> Callable[..., Client[Any, Any]]:
        from taskrpc.client import Client, ObservedClient  # many programs only serve

        if self._observer is None:
            return Client
        return partial(ObservedClient, self._observer)

    def _forget_part(self, part: _Part) -> None:
        if part in self._parts:
            del self._parts[part]
            part._count_into(self._earlier_topics)
            for status in self._earlier_topics.values():
                status.subscriptions = status.publishers = 0

    def _topic_status(self) -> dict[str, TopicStatus]:
        topics = {name: copy(status) for name, status in self._earlier_topics.items()}
        for part in list(self._parts):  # a copy: another thread may call `status`
            part._count_into(topics)
        return topics

    def _forget_client(self, client: Client[Any, Any]) -> None:
        if client in self._clients:
            del self._clients[client]
            name = client.service_name
            if client.retries:  # most have none, and a program may call thousands of services
                self._retries[name] = self._retries.get(name, 0) + client.retries

    def _started(self) -> Endpoint:
        if self._transport is None:
            advice = "async with taskrpc.Node(...) as node:` or call `await node.start()"
            if self._threads:
                advice = "with taskrpc.sync.Node(...) as node:` or call `node.start()"
            raise TaskRpcError(f"the node {self._name} has not started; write `{advice}`")
        return self._transport
