"""The engine for ROS 2: one context of rclpy, two threads, and the nodes of this program."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable
from typing import Any

import srvgen
from taskrpc.errors import ProtocolError, TaskRpcError, TypeMismatch
from taskrpc.middleware.ros import bytes_message, types
from taskrpc.middleware.ros.graph import ENCLAVE, Graph
from taskrpc.middleware.ros.installed import NotBuilt, real_rclpy, ros_class
from taskrpc.middleware.ros.native_services import NativeClient, NativeServer, Unserved
from taskrpc.middleware.ros.native_topics import Carrier, NativePublisher, NativeSubscription
from taskrpc.middleware.ros.program_links import NODE, ProgramLinks, address_of
from taskrpc.middleware.ros.security import is_on, security_problem
from taskrpc.middleware.ros.spinning import Ending, Spinner, wait_until_sent
from taskrpc.spi import (
    Cancelable,
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
    TunnelNetwork,
    entry_in,
)

log = logging.getLogger("taskrpc.transport")

LOOK = 0.1
"""Seconds between two looks at ROS's graph; one takes some tens of microseconds."""
SETTLE = 0.5
"""Seconds in which DDS usually finds the programs that already run."""
SETTLE_ALONE = 1.3
"""Seconds to wait while no other program is found: DDS repeats its question after one second."""
_LONGEST_SETTLE = 2.5
DISCOVERY = 5.0
"""Seconds after the start in which DDS finds the other programs even if it loses a message: it
repeats messages after three seconds. Until then, a call waits for a server of its service."""
_FIRST_LOOK = 0.02


def open_network(settings: Settings) -> TunnelNetwork:
    """Return the network of a program on ROS 2. Raises TaskRpcError without a real rclpy."""
    return TunnelNetwork(RosEngine(settings.domain), settings)


class RosEngine:
    """One program's access to ROS 2."""

    name = "ROS 2"

    def __init__(self, domain: int) -> None:
        self.address = ""
        self.discovery_ends = 0.0
        self._domain = domain
        self._ros = real_rclpy()
        self._bytes_class = ros_class(bytes_message.TYPE)
        self._id = os.urandom(8).hex()
        self._loop = asyncio.get_running_loop()
        self._handoff = Handoff(self._loop)
        self._ending = Ending()
        self._links = ProgramLinks(self._ros, self._bytes_class, self._handoff)
        self._events: EngineEvents | None = None
        """None before `open` and after `close`."""
        self._context: Any = None
        self._node: Any = None
        """The hidden node, for the graph and the other taskrpc programs."""
        self._spinners: list[Spinner] = []
        """One for the hidden node, one for all others, whose services must not slow it down."""
        self._graph: Graph | None = None
        self._nodes: dict[str, tuple[Any, int]] = {}
        """The nodes of this program by name, and how many nodes of taskrpc have the name."""
        self._clients: dict[tuple[str, str], NativeClient] = {}
        """By name and type hash of the service."""
        self._entries: dict[str, RegistryEntry] = {}
        """The entries of the other taskrpc programs by address."""
        self._looking: asyncio.TimerHandle | None = None
        self._refused: set[str] = set()
        """The packages for which a warning was logged."""

    # Presence and datagrams

    async def open(self, events: EngineEvents) -> None:
        """Join ROS 2. Raises TaskRpcError."""
        try:
            await asyncio.to_thread(self._create)
        except TaskRpcError:
            raise
        except Exception as error:  # rclpy's own errors have no common class
            problem = security_problem(os.environ, str(error), os.path.isdir) or error
            raise TaskRpcError(f"ROS 2 cannot start here: {problem}") from None
        self.address = address_of(self._id)
        self.discovery_ends = self._loop.time() + DISCOVERY
        self._events = events
        self._links.open(self._node, self._id, _Reports(self, events))
        self._graph = Graph(self._ros, self._node, types.service_hash)
        await self._settle()
        self._read()
        self._look()

    def _create(self) -> None:
        """Create context, node and threads; this blocks for some tenths of a second."""
        self._context = self._ros.context.Context()
        arguments = ["taskrpc"]
        if not is_on(os.environ):
            arguments += ["--ros-args", "--enclave", ENCLAVE + self._id]
        self._context.init(arguments, initialize_logging=False, domain_id=self._domain)
        self._node = self._create_node(NODE + self._id, "/")
        names = ("ROS links", "ROS nodes")
        self._spinners = [Spinner(self._ros, self._context, name) for name in names]
        self._spinners[0].add(self._node)

    async def _settle(self) -> None:
        """Wait until DDS has found the other programs."""
        began = self._loop.time()
        while self._events is not None:
            self._look_for_programs()
            await asyncio.sleep(_FIRST_LOOK)
            passed = self._loop.time() - began
            least = SETTLE if self._graph is not None and self._graph.others else SETTLE_ALONE
            if passed > _LONGEST_SETTLE or (passed > least and not self._links.awaited):
                return

    def send(self, address: str, datagram: bytes) -> None:
        """Send a datagram."""
        self._links.send(address, datagram)

    def announce(self, entry: bytes) -> None:
        """Show this program to the others."""
        self._links.announce(entry)

    def close(self) -> None:
        """Leave ROS 2."""
        if self._looking is not None:
            self._looking.cancel()
        self._events = None
        senders = self._links.close()
        self._handoff.close()
        if self._context is not None:
            context, self._context = self._context, None
            self._ending.put(self._leave, context, senders)
            self._ending.close()

    def _leave(self, context: Any, senders: list[Any]) -> None:
        for sender in senders:
            wait_until_sent(self._ros, sender)
        # The hidden node is the last one: DDS leaves the domain with it.
        have_ended = [spinner.close() for spinner in reversed(self._spinners)]
        if not all(have_ended):
            log.warning("a thread of rclpy hangs: its nodes stay until the program ends")
            return  # rclpy crashes if the context is destroyed while a thread uses it
        with contextlib.suppress(Exception):
            context.try_shutdown()
        with contextlib.suppress(Exception):
            context.destroy()

    # The graph

    def update(self, change: EntryChange) -> None:
        """Create or destroy the ROS node that shows a taskrpc node."""
        if not change.node or self._context is None:
            return
        node, count = self._nodes.get(change.node, (None, 0))
        count += -1 if change.gone else 1
        if count > 0:
            self._nodes[change.node] = node or self._add_node(change.node), count
        elif node is not None:
            del self._nodes[change.node]
            self._drop_node(node)

    def foreign_entries(self) -> list[RegistryEntry]:
        """Return the nodes of ROS programs."""
        return [] if self._graph is None else self._graph.entries()

    def foreign_servers(self, service: str) -> list[ForeignServer]:
        """Return the servers of a service in ROS programs."""
        servers = [] if self._graph is None else self._graph.servers(service)
        return [ForeignServer(each.type_name, each.type_hash, each.node) for each in servers]

    def program_seen(self, address: str, entry: bytes) -> None:
        """Note the nodes of another taskrpc program, which are not foreign."""
        with contextlib.suppress(ProtocolError):  # the tunnel logs it
            self._entries[address] = entry_in(entry, address)
        self._read()

    def program_gone(self, address: str) -> None:
        """Forget the nodes of a program."""
        self._entries.pop(address, None)

    def _look(self) -> None:
        """Compare ROS's graph with that of the last look, again and again."""
        if self._events is None:
            return
        try:
            if self._look_for_programs():
                self._read()
        except Exception as error:  # rclpy's own errors have no common class
            if not self._context.ok():
                self._events.interrupted("rclpy's context was shut down")
                return
            log.warning("cannot read ROS's graph: %s", error)
        self._looking = self._loop.call_later(LOOK, self._look)

    def _look_for_programs(self) -> bool:
        assert self._graph is not None, "called before open"
        names = self._graph.look()
        if names is not None:
            self._links.look(names)
        return names is not None

    def _read(self) -> None:
        if self._graph is None or self._events is None:
            return
        listed = [node for entry in self._entries.values() for node in entry.nodes]
        if self._graph.read([*self._nodes, *listed]):
            self._events.foreign_changed()

    # Nodes

    def _create_node(self, name: str, namespace: str) -> Any:
        # Without the services and topics that each node of ROS has: nothing of taskrpc serves them.
        no_descriptions = self._ros.parameter.Parameter(
            "start_type_description_service", value=False
        )
        return self._ros.node.Node(
            name,
            context=self._context,
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[no_descriptions],
        )

    def _add_node(self, full_name: str) -> Any:
        namespace, _, name = full_name.rpartition("/")
        node = self._create_node(name, namespace or "/")
        self._spinners[1].add(node)
        return node

    def _drop_node(self, node: Any) -> None:
        for key, client in list(self._clients.items()):
            if client.node is node:
                del self._clients[key]
                client.close()
        self._ending.put(self._spinners[1].remove, node)  # after its publishers

    def _node_of(self, full_name: str) -> Any:
        """Return a node of this program; the hidden one for a name that is not known."""
        return self._nodes[full_name][0] if full_name in self._nodes else self._node

    # Native services

    def serve(
        self,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> Closable:
        """Offer a service to ROS programs, if ROS has built its type."""
        try:
            ros_type = types.ros_service(srv_type)
        except (TypeMismatch, srvgen.DefinitionError) as error:
            self._warn_once(srv_type._TYPE, f"ROS programs cannot call {named.name}", error)
            return Unserved()
        node = self._node_of(named.node)
        return NativeServer(self._ros, node, named.name, (srv_type, ros_type), serve, self._handoff)

    def call(
        self, service: str, srv_type: ServiceType, request: Any, on_done: OnDone
    ) -> Cancelable:
        """Call a service of a ROS program. Raises TaskRpcError."""
        key = service, srv_type._HASH
        client = self._clients.get(key)
        if client is None:
            ros_type = types.ros_service(srv_type)
            node = next((node for node, _ in self._nodes.values()), self._node)
            client = NativeClient(node, service, (srv_type, ros_type), self._handoff)
            self._clients[key] = client
        return client.call(request, on_done)

    # Native topics

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, on_mismatch: OnMismatch | None
    ) -> NativePublisher:
        """Create a publisher on ROS 2."""
        problem = f"ROS programs do not see {named.name}"
        node, carrier = self._node_of(named.node), self._carrier(msg_type, problem)
        return NativePublisher(
            self._ros, node, named, carrier, on_mismatch, self._handoff, self._ending
        )

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
    ) -> NativeSubscription:
        """Create a subscription on ROS 2."""
        problem = f"no messages of ROS programs arrive on {named.name}"
        node, carrier = self._node_of(named.node), self._carrier(msg_type, problem)
        return NativeSubscription(
            self._ros, node, named, carrier, deliver, on_mismatch, self._handoff
        )

    def _carrier(self, msg_type: Any, problem: str) -> Carrier:
        try:
            ros_type = types.ros_message(msg_type)
        except (TypeMismatch, srvgen.DefinitionError) as error:
            self._warn_once(msg_type._TYPE, problem, error)
            ros_type = None
        return Carrier(self._ros, msg_type, ros_type, self._bytes_class)

    def _warn_once(self, type_name: str, what: str, error: Exception) -> None:
        package = type_name.partition("/")[0] if isinstance(error, NotBuilt) else type_name
        if package not in self._refused:
            self._refused.add(package)
            log.warning("%s: %s", what, error)


class _Reports:
    """Receives the events of the links: the engine notes a program before the tunnel does."""

    def __init__(self, engine: RosEngine, events: EngineEvents) -> None:
        self._engine = engine
        self._events = events
        self.received = events.received
        self.foreign_changed = events.foreign_changed
        self.interrupted = events.interrupted
        self.resumed = events.resumed

    def program_seen(self, address: str, entry: bytes) -> None:
        """Note a program."""
        self._engine.program_seen(address, entry)
        self._events.program_seen(address, entry)

    def program_gone(self, address: str) -> None:
        """Forget a program."""
        self._engine.program_gone(address)
        self._events.program_gone(address)
