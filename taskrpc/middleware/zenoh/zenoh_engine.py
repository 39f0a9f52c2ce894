"""The engine for Zenoh: taskrpc programs find each other, and meet programs of ROS 2.

Each program has a session, which is a client of a router by default. A liveliness token shows that
the program is alive; Zenoh removes it when the program ends or loses its router. A program
that loses its router no longer sees any token, not even its own. So it notices this at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import zenoh

from taskrpc.errors import ServiceUnavailable, TaskRpcError
from taskrpc.middleware.zenoh import keys
from taskrpc.middleware.zenoh.configuration import Configuration, configuration_of
from taskrpc.middleware.zenoh.graph import Graph
from taskrpc.middleware.zenoh.services import NativeCall, NativeClient, NativeServer
from taskrpc.middleware.zenoh.session import handler, open_session, reason_of
from taskrpc.middleware.zenoh.tokens import (
    SERVICE_QOS,
    UNKNOWN_HASH,
    Kind,
    Qos,
    Token,
    all_tokens,
)
from taskrpc.middleware.zenoh.topics import (
    NativeTopic,
    TopicSetup,
    ZenohPublisher,
    ZenohSubscription,
)
from taskrpc.spi import (
    Closable,
    Deliver,
    EngineEvents,
    EntryChange,
    ForeignServer,
    Handoff,
    NativeReply,
    OnDone,
    OnMismatch,
    RegistryEntry,
    ServiceEndpoint,
    ServiceType,
    Settings,
    TopicEndpoint,
    TopicPublisher,
    TopicSubscription,
    TunnelNetwork,
)

_Topic = TypeVar("_Topic", bound=NativeTopic)

DISCOVERY_TIMEOUT = 1.0
"""Seconds that `open` waits for the programs that already run."""
ROUTER_POLL = 0.1
"""Seconds between two looks for a router that is gone."""
MAX_PUBLISHERS = 1024
"""Programs to which a publisher of datagrams is kept."""


def open_network(settings: Settings) -> TunnelNetwork:
    """Return the network of a program over Zenoh. Raises TaskRpcError for an invalid setting."""
    if settings.tls is not None:
        raise TaskRpcError(
            "transport='zenoh' takes no certificates with tls=; name a configuration with TLS in"
            " ZENOH_SESSION_CONFIG_URI, and a router such as peers=['tls/robot:7447']"
        )
    configuration = configuration_of(settings.peers, environ=os.environ)
    return TunnelNetwork(ZenohEngine(settings.domain, configuration), settings)


class ZenohEngine:
    """One program's access to Zenoh."""

    name = "Zenoh"
    discovery_ends = 0.0  # `open` asks for all programs

    def __init__(self, domain: int, configuration: Configuration) -> None:
        self.address = ""
        self._domain = domain
        self._configuration = configuration
        self._loop = asyncio.get_running_loop()
        self._handoff = Handoff(self._loop)
        self._opened: zenoh.Session | None = None
        self._events: EngineEvents
        self._closed = False
        self._interrupted = False
        self._router_check_planned = False
        self._declared: list[Any] = []
        """Kept until the session ends, because Zenoh closes objects that nothing refers to."""
        self._entry: bytes | None = None
        """What this program has announced."""
        self._entry_publisher: zenoh.Publisher
        self._publishers: OrderedDict[str, zenoh.Publisher] = OrderedDict()
        """The publishers of datagrams by address, the most recently declared last."""
        self._programs: set[str] = set()
        """The addresses of taskrpc programs, this one included."""
        self._graph = Graph()
        self._foreign_change_planned = False
        self._nodes: dict[str, int] = {}
        """The id of each node of this program."""
        self._ids = itertools.count()
        self._shown: dict[str | ServiceEndpoint, list[zenoh.LivelinessToken]] = {}
        """The tokens of this program's nodes and clients."""
        self._clients: dict[str, NativeClient] = {}
        """By key."""
        self._topics: dict[NativeTopic, None] = {}
        """The native publishers and subscriptions of this program."""

    @property
    def _session(self) -> zenoh.Session:
        if self._opened is None:
            raise TaskRpcError("Zenoh is not open: start the node first")
        return self._opened

    # Presence and datagrams

    async def open(self, events: EngineEvents) -> None:
        """Connect to the router, and learn which programs are there. Raises TaskRpcError."""
        self._events = events
        session = await asyncio.to_thread(open_session, self._configuration)
        if self._closed:
            session.close()
            return
        self._opened = session
        self.address = str(session.zid())
        self._programs.add(self.address)
        await asyncio.to_thread(self._join, session)
        self._handoff.drain()

    def _join(self, session: zenoh.Session) -> None:
        """Declare what this program listens to; runs in a thread, because it waits."""
        domain, address, callback = self._domain, self.address, partial(handler, self._handoff)
        live = session.liveliness()
        alive, entries, own = keys.alive_key(domain), keys.entry_key(domain), self._answer
        entry_key, inbox_key = keys.entry_key(domain, address), keys.inbox_key(domain, address)
        self._entry_publisher = session.declare_publisher(
            entry_key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._declared += [
            session.declare_subscriber(inbox_key, callback(self._received)),
            session.declare_subscriber(entries, callback(self._entry_received)),
            session.declare_queryable(
                entry_key, zenoh.handlers.Callback(own, lambda: None, indirect=False)
            ),
            live.declare_subscriber(alive, callback(self._alive_changed), history=True),
            # After the taskrpc programs: their nodes are not foreign.
            live.declare_subscriber(
                all_tokens(domain), callback(self._token_changed), history=True
            ),
            live.declare_token(keys.alive_key(domain, address)),
        ]
        # When these questions are answered, the tokens of all running programs have arrived.
        _wait_for(lambda over: self._ask_entries(session, entries, over))
        _wait_for(
            lambda over: live.get(
                all_tokens(domain), zenoh.handlers.Callback(_ignore, over, indirect=False)
            )
        )

    def send(self, address: str, datagram: bytes) -> None:
        """Send a datagram."""
        publisher = self._publishers.get(address)
        if publisher is None:
            if self._opened is None or not keys.is_address(address):
                return
            publisher = self._inbox_publisher(self._opened, address)
        with contextlib.suppress(
            zenoh.ZError
        ):  # The receiver misses the datagram's number, and ends the connection.
            publisher.put(datagram)

    def _inbox_publisher(self, session: zenoh.Session, address: str) -> zenoh.Publisher:
        if len(self._publishers) >= MAX_PUBLISHERS:
            self._publishers.popitem(last=False)[1].undeclare()
        publisher = self._publishers[address] = session.declare_publisher(
            keys.inbox_key(self._domain, address),
            # A lost datagram would end its connection.
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
        return publisher

    def announce(self, entry: bytes) -> None:
        """Show this program to the others."""
        self._entry = entry
        if self._opened is not None:
            self._entry_publisher.put(entry)

    def close(self) -> None:
        """Leave Zenoh."""
        if self._closed:
            return
        self._closed = True
        self._handoff.close()
        if self._opened is not None:
            self._opened.close()

    def _received(self, sample: zenoh.Sample) -> None:
        self._events.received(sample.payload.to_bytes())

    def _entry_received(self, sample: zenoh.Sample) -> None:
        address = keys.address_of(str(sample.key_expr))
        if address and address != self.address:
            self._programs.add(address)
            self._events.program_seen(address, sample.payload.to_bytes())

    def _answer(self, query: zenoh.Query) -> None:
        """Answer a question for this program's entry; called by Zenoh's threads."""
        with query:
            if (entry := self._entry) is not None:
                query.reply(keys.entry_key(self._domain, self.address), entry)

    def _ask_entries(
        self, session: zenoh.Session, key: str, over: Callable[[], object] = lambda: None
    ) -> None:
        """Ask programs for their entries; `over` is called in another thread at the end."""

        def reply(answer: zenoh.Reply) -> None:
            if answer.ok is not None:
                self._handoff.put(self._entry_received, answer.ok)

        asked = zenoh.handlers.Callback(reply, over, indirect=False)
        session.get(key, asked, timeout=DISCOVERY_TIMEOUT)

    def _alive_changed(self, sample: zenoh.Sample) -> None:
        address = keys.address_of(str(sample.key_expr))
        is_alive = sample.kind == zenoh.SampleKind.PUT
        if address == self.address:
            self._resume() if is_alive else self._interrupt()
        elif address and is_alive:
            self._programs.add(address)
            # It may have announced its entry before this program listened.
            self._ask_entries(self._session, keys.entry_key(self._domain, address))
            self._plan_foreign_change()
        elif address:
            self._programs.discard(address)
            if (publisher := self._publishers.pop(address, None)) is not None:
                publisher.undeclare()
            self._events.program_gone(address)
            # Before Zenoh 1.9, this program's own token does not disappear with the router.
            self._plan_router_check()

    def _plan_router_check(self) -> None:
        if not self._router_check_planned:
            self._router_check_planned = True
            self._loop.call_later(ROUTER_POLL, self._check_router)

    def _check_router(self) -> None:
        """Notice that the router is gone, or that it is back."""
        self._router_check_planned = False
        if self._closed:
            return
        info = self._session.info
        if not (info.routers_zid() or info.peers_zid()):
            self._interrupt()
        else:
            self._resume()

    def _interrupt(self) -> None:
        """Note that this program's own token is gone: it cannot reach its router any more."""
        if not self._interrupted:
            self._interrupted = True
            self._events.interrupted("the connection to the Zenoh router is lost")
        self._plan_router_check()

    def _resume(self) -> None:
        if self._interrupted:
            self._interrupted = False
            self._events.resumed()
            # If the router was there all the time, no token appears again.
            self._ask_entries(self._session, keys.entry_key(self._domain))

    # The graph

    def update(self, change: EntryChange) -> None:
        """Show a node or client; native services and topics show themselves."""
        if change.node:
            self._show(change.node, change.gone, lambda: self._node_token(change.node))
        if (client := change.client) is not None:
            self._show(client, change.gone, lambda: self._token(Kind.CLIENT, client, SERVICE_QOS))

    def _show(self, item: str | ServiceEndpoint, is_gone: bool, key: Callable[[], str]) -> None:
        if self._opened is None or self._closed:
            return
        shown = self._shown.setdefault(item, [])
        if not is_gone:
            shown.append(self._session.liveliness().declare_token(key()))
        elif shown:
            shown.pop().undeclare()
        if not shown:
            del self._shown[item]

    def foreign_entries(self) -> list[RegistryEntry]:
        """Return the nodes of programs that are not taskrpc's."""
        return self._graph.entries(without=self._programs)

    def foreign_servers(self, service: str) -> list[ForeignServer]:
        """Return the native servers of a service in foreign programs."""
        return [
            ForeignServer(
                token.type_name,
                "" if token.type_hash == UNKNOWN_HASH else token.type_hash,
                token.node,
            )
            for token in self._foreign_tokens(service)
        ]

    def _foreign_tokens(self, service: str) -> list[Token]:
        shown = self._graph.named(Kind.SERVER, service)
        return [token for token in shown if token.session not in self._programs]

    def _token_changed(self, sample: zenoh.Sample) -> None:
        self._change_token(str(sample.key_expr), is_there=sample.kind == zenoh.SampleKind.PUT)

    def _change_token(self, key: str, *, is_there: bool) -> None:
        token = self._graph.add(key) if is_there else self._graph.remove(key)
        if token is None:
            return
        if token.session not in self._programs:
            self._plan_foreign_change()
        for topic in list(self._topics):
            if token.kind is topic.counterpart and token.name == topic.named.name:
                topic.appeared(token) if is_there else topic.counterparts_changed()

    def _plan_foreign_change(self) -> None:
        if not self._foreign_change_planned:
            self._foreign_change_planned = True
            self._loop.call_soon(self._report_foreign_change)

    def _report_foreign_change(self) -> None:
        self._foreign_change_planned = False
        if not self._closed:
            self._events.foreign_changed()

    def _node_id(self, node: str) -> int:
        if node not in self._nodes:
            self._nodes[node] = next(self._ids)
        return self._nodes[node]

    def _node_token(self, node: str) -> str:
        number = self._node_id(node)
        return Token(Kind.NODE, self._domain, self.address, number, number, node).key()

    def _token(self, kind: Kind, named: ServiceEndpoint | TopicEndpoint, qos: Qos) -> str:
        return Token(
            kind=kind,
            domain=self._domain,
            session=self.address,
            node_id=self._node_id(named.node),
            endpoint_id=next(self._ids),
            node=named.node,
            name=named.name,
            type_name=named.type_name,
            type_hash=named.type_hash,
            qos=qos,
        ).key()

    def _data_key(self, named: ServiceEndpoint | TopicEndpoint) -> str:
        return keys.data_key(self._domain, named.name, named.type_name, named.type_hash)

    # Native services

    def serve(
        self,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> Closable:
        """Offer a service to foreign programs. Raises TaskRpcError."""
        key, token = self._data_key(named), self._token(Kind.SERVER, named, SERVICE_QOS)
        try:
            return NativeServer(self._session, self._handoff, key, token, srv_type, serve)
        except zenoh.ZError as error:
            raise TaskRpcError(f"Zenoh refuses {named.name}: {reason_of(error)}") from None

    def call(
        self, service: str, srv_type: ServiceType, request: Any, on_done: OnDone
    ) -> NativeCall:
        """Call the native servers of a service that have this type. Raises InvalidRequest."""
        wanted = srv_type._HASH, UNKNOWN_HASH
        same = [token for token in self._foreign_tokens(service) if token.type_hash in wanted]
        if not same:
            raise ServiceUnavailable(f"no native server offers {service} as {srv_type._TYPE}")
        key = keys.data_key(self._domain, service, same[0].type_name, same[0].type_hash)
        client = self._clients.get(key)
        if client is None:
            client = NativeClient(self._session, self._handoff, key, service)
            self._clients[key] = client
        return client.call(srv_type, request, on_done)

    # Native topics

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, on_mismatch: OnMismatch | None
    ) -> TopicPublisher:
        """Create a native publisher."""
        setup = self._topic_setup(Kind.PUBLISHER, named)
        return self._added(ZenohPublisher(setup, named, msg_type, on_mismatch))

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
    ) -> TopicSubscription:
        """Create a native subscription."""
        setup, handoff = self._topic_setup(Kind.SUBSCRIPTION, named), self._handoff
        subscription = ZenohSubscription(setup, handoff, named, msg_type, deliver, on_mismatch)
        return self._added(subscription)

    def _topic_setup(self, kind: Kind, named: TopicEndpoint) -> TopicSetup:
        qos = Qos(named.reliable, named.latched, named.depth)
        token, removed = self._token(kind, named, qos), self._topic_closed
        return TopicSetup(self._session, self._graph, self._data_key(named), token, removed)

    def _added(self, topic: _Topic) -> _Topic:
        # Now, so that counterparts of this program count at once.
        self._change_token(topic.token, is_there=True)
        self._topics[topic] = None
        return topic

    def _topic_closed(self, topic: NativeTopic) -> None:
        del self._topics[topic]
        self._change_token(topic.token, is_there=False)


def _wait_for(begin: Callable[[Callable[[], object]], object]) -> None:
    """Start an operation that calls its argument at the end, and wait for the end."""
    ended = threading.Event()
    begin(ended.set)
    ended.wait(DISCOVERY_TIMEOUT)


def _ignore(_: zenoh.Reply) -> None:
    """Do nothing: the subscriber gets the tokens too."""
