"""The background event loop and the native nodes on it; no other module of rclpy knows them."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Coroutine
from functools import cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from taskrpc import sync
from taskrpc.errors import NameInUse, ServiceUnavailable, WouldDeadlock
from taskrpc.spi import current_program, names

from .diagnostics.explain import like_ros, two_servers

if TYPE_CHECKING:
    import asyncio

    from taskrpc.deferred import DeferredCall, DeferredService
    from taskrpc.qos import QoS
    from taskrpc.spi import LoopThread, OnMismatch, RegistryEntry

T = TypeVar("T")

_ITERATIONS = 4
"""Iterations of the loop until the response of a callback reaches a caller in this process:
hand-off, write, read, delivery."""
_MAX_WAIT = 0.05
"""The longest wait for a busy loop, in seconds."""

Take = Callable[["DeferredCall[Any, Any]"], object]
"""Receives a call, on the thread of the event loop."""


class Bridge:
    """A native node and the event loop that it lives on; every rclpy node has one."""

    running: ClassVar[LoopThread | None] = None
    """The loop, once there was a node."""

    def __init__(self, name: str, namespace: str, domain_id: int) -> None:
        self.native = sync.Node(name, namespace=namespace)
        self.domain_id = domain_id
        self._loop = Bridge.running = self.native.loop_thread
        node = self.native.async_node
        node.domain = domain_id
        self.run(node.start())

    @property
    def namespace(self) -> str:
        """The namespace of the native node; a joined lab may have chosen it."""
        return self.native.get_namespace()

    @property
    def event_loop(self) -> asyncio.AbstractEventLoop:
        """The loop, for what waits on its thread."""
        return self._loop.event_loop

    def soon(self, action: Callable[[], object]) -> None:
        """Run a function on the loop, without waiting for it."""
        self._loop.soon(action)

    def do(self, action: Callable[[], T]) -> T:
        """Run a function on the loop and return its result."""
        return self._loop.do(action, "a node's method")

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the loop and return its result."""
        return self._loop.run(coroutine, "a node's method")

    def graph(self) -> list[RegistryEntry]:
        """The registry entries of all visible processes."""
        return self.native.graph()

    def client(self, srv_type: Any, name: str) -> NativeClient:
        """Create a client without a deadline."""
        name = self._relative(name)
        return NativeClient(self, self.native.create_client(srv_type, name, timeout=None))

    def _relative(self, name: str) -> str:
        # rclpy's names are absolute here. But the native node looks only for relative names in the
        # namespaces of a joined lab, where the robot is.
        return names.relative(name, namespace=self.namespace)

    def offer(self, srv_type: Any, name: str, take: Take, *, join: bool) -> Offered:
        """Offer a service; `take` receives every call, on the thread of the loop."""
        return _Shared.of(self, srv_type, name).add(self, take, join=join)

    def publisher(
        self, msg_type: Any, topic: str, qos: QoS, on_mismatch: OnMismatch | None = None
    ) -> NativePublisher:
        """Create a publisher; `on_mismatch` receives incompatible peers, on the loop's thread."""
        create = self.native.create_publisher
        return NativePublisher(create(msg_type, topic, qos, on_mismatch=on_mismatch))

    def subscription(
        self,
        msg_type: Any,
        topic: str,
        take: Callable[[Any], object],
        qos: QoS,
        on_mismatch: OnMismatch | None = None,
    ) -> NativeSubscription:
        """Create a subscription; `take` receives each message, on the thread of the loop.

        `on_mismatch` receives there why a publisher is incompatible.
        """
        create, topic = self.native.create_subscription, self._relative(topic)
        return NativeSubscription(
            create(msg_type, topic, take, qos, threaded=False, on_mismatch=on_mismatch)
        )

    def close(self) -> None:
        """Leave the network; does nothing when the program has already ended the loop."""
        with contextlib.suppress(WouldDeadlock):
            self.native.destroy()


def settle() -> None:
    """Wait a moment, so that messages that this program sent to itself arrive."""
    if Bridge.running is not None:
        Bridge.running.settle(_ITERATIONS, _MAX_WAIT)


class NativeClient:
    """The methods of a native client that other threads use."""

    def __init__(self, bridge: Bridge, client: sync.Client[Any, Any]) -> None:
        self.bridge = bridge
        self.inner = client.async_client
        self.channel = self.inner.channel
        self.call_then = client.call_then
        self.is_known = client.service_is_ready
        self.wait = client.wait_for_service
        self._client = client

    @property
    def connected(self) -> bool:
        """Whether a request can be sent at once."""
        return self.channel.ready

    def close(self) -> None:
        """Release the service."""
        with contextlib.suppress(WouldDeadlock):
            self._client.destroy()


class NativePublisher:
    """The methods of a native publisher that other threads use."""

    def __init__(self, publisher: sync.Publisher[Any]) -> None:
        self.publish = publisher.publish
        self.set_alive = publisher.set_alive
        self.get_subscription_count = publisher.get_subscription_count
        self._publisher = publisher

    def watch_matches(self, report: Callable[[int], object]) -> None:
        """Call `report` with the number of matching subscriptions, now and at each change.

        It is called on the thread of the event loop.
        """
        self._publisher.watch_matches(lambda: report(self.get_subscription_count()))

    def close(self) -> None:
        """Stop publishing."""
        with contextlib.suppress(WouldDeadlock):
            self._publisher.destroy()


class NativeSubscription:
    """The methods of a native subscription that other threads use."""

    def __init__(self, subscription: sync.Subscription[Any]) -> None:
        self.get_publisher_count = subscription.get_publisher_count
        self.get_liveliness = subscription.get_liveliness
        self._subscription = subscription

    def watch_matches(self, report: Callable[[int], object]) -> None:
        """Call `report` with the number of matching publishers, now and at each change of it or
        of their liveliness.

        It is called on the thread of the event loop.
        """
        self._subscription.watch_matches(lambda: report(self.get_publisher_count()))

    def close(self) -> None:
        """Stop receiving messages."""
        with contextlib.suppress(WouldDeadlock):
            self._subscription.destroy()


class Offered:
    """One server of a service in this program."""

    def __init__(self, shared: _Shared, bridge: Bridge, take: Take) -> None:
        self.bridge = bridge
        self.node = bridge.native.get_fully_qualified_name()
        self.take = take
        self._shared = shared

    def close(self) -> None:
        """Withdraw the server; calls that have arrived are still answered."""
        self._shared.remove(self)


class _Shared:
    """The servers of one service in this program; the oldest one is the native server."""

    _all: ClassVar[dict[tuple[str, int, str], _Shared]] = {}
    _guard = threading.RLock()

    def __init__(self, srv_type: Any, name: str) -> None:
        self._srv_type = srv_type
        self._name = name
        self._servers: list[Offered] = []
        self._native: DeferredService | None = None

    @classmethod
    def of(cls, bridge: Bridge, srv_type: Any, name: str) -> _Shared:
        """The servers of this name; a new object for the first one."""
        key = (current_program.get(), bridge.domain_id, name)
        with cls._guard:
            known = cls._all.get(key)
            if known is None or known._srv_type is not srv_type:
                known = cls._all[key] = cls(srv_type, name)
            return known

    def add(self, bridge: Bridge, take: Take, *, join: bool) -> Offered:
        """Add a server. Raises NameInUse when another program has the name."""
        offered = Offered(self, bridge, take)
        with self._guard:
            if self._servers and not join:
                two_servers(self._name, refused=False)
            self._servers.append(offered)  # before the offer: a request may arrive at once
            try:
                if self._servers[0] is offered:
                    self._first(offered, join=join)
                else:
                    self._announce(offered)
            except BaseException:
                self._servers.remove(offered)
                raise
        return offered

    def _first(self, offered: Offered, *, join: bool) -> None:
        try:
            self._offer(offered, join=join or like_ros())
        except NameInUse:
            two_servers(self._name, refused=True)
            raise

    def remove(self, offered: Offered) -> None:
        """Remove a server; the next one becomes the native server."""
        with self._guard:
            if offered not in self._servers:
                return
            is_native = self._servers[0] is offered
            self._servers.remove(offered)
            native = self._native
            if native is None:
                return
            if not is_native:
                offered.bridge.do(partial(native.remove_server, offered.node))
                return
            offered.bridge.do(native.destroy)
            self._native = None
            if self._servers:
                self._offer(self._servers[0], join=True)
                for other in self._servers[1:]:
                    self._announce(other)

    def _offer(self, offered: Offered, *, join: bool) -> None:
        create = offered.bridge.native.create_deferred_service
        self._native = create(self._srv_type, self._name, self._take, join=join)

    def _announce(self, offered: Offered) -> None:
        if self._native is not None:
            offered.bridge.do(partial(self._native.add_server, offered.node))

    def _take(self, call: DeferredCall[Any, Any]) -> None:
        servers = list(self._servers if like_ros() else self._servers[:1])
        if not servers:  # another thread is withdrawing the service
            call.fail(ServiceUnavailable(f"{self._name} is withdrawn"))
        for server in servers:
            server.take(call)


def detached(message: Any) -> Any:
    """Copy a message and its nested messages, so that checks do not change the program's own.

    The values are the same objects.
    """
    made = message.__copy__()
    cls: Any = type(message)
    for attribute in _nested(cls):
        setattr(made, attribute, _copied(getattr(made, attribute)))
    return made


def _copied(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_copied(one) for one in value]
    return detached(value) if hasattr(type(value), "_NESTED") else value


@cache
def _nested(cls: type[Any]) -> list[str]:
    """The attributes of a message class that hold messages."""
    fields = zip(cls.__struct_fields__, cls._FIELDS, strict=True)
    return [attribute for attribute, (name, _) in fields if name in cls._NESTED]
