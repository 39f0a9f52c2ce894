"""The entities of a node: publishers, subscriptions, clients, services, timers and more."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from typing import Any, TypeVar

from taskrpc.errors import NameInUse
from taskrpc.message_types import MsgT, RequestT, ResponseT, Srv

from ..callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from ..client import Client
from ..clock import Clock
from ..constants import S_TO_NS
from ..event_handler import Events, PublisherEventCallbacks, SubscriptionEventCallbacks
from ..guard_condition import GuardCondition
from ..publisher import Publisher
from ..qos import QoSProfile, qos_profile_services_default
from ..service import Service
from ..subscription import Subscription, SubscriptionCallback
from ..timer import Rate, Timer
from ..type_support import check_is_valid_msg_type, check_is_valid_srv_type
from ..waitable import Waitable
from .graph.endpoints import check_service_profiles
from .node_interface import NodeInterface

_Thing = TypeVar("_Thing")


class NodeEntities:
    """Creates, keeps and destroys the entities of one node; `Node` documents the methods."""

    def __init__(self, node: NodeInterface) -> None:
        self._node = node
        self._publishers: list[Publisher[Any]] = []
        self._subscriptions: list[Subscription[Any]] = []
        self._clients: list[Client[Any, Any]] = []
        self._services: list[Service[Any, Any]] = []
        self._timers: list[Timer] = []
        self._guards: list[GuardCondition] = []
        self._waitables: list[Waitable[Any]] = []
        self._rates: dict[Timer, Rate] = {}

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        """As `Node.publishers`."""
        yield from self._publishers

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        """As `Node.subscriptions`."""
        yield from self._subscriptions

    @property
    def clients(self) -> Iterator[Client[Any, Any]]:
        """As `Node.clients`."""
        yield from self._clients

    @property
    def services(self) -> Iterator[Service[Any, Any]]:
        """As `Node.services`."""
        yield from self._services

    @property
    def timers(self) -> Iterator[Timer]:
        """As `Node.timers`."""
        yield from self._timers

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """As `Node.guards`."""
        yield from self._guards

    @property
    def waitables(self) -> Iterator[Waitable[Any]]:
        """As `Node.waitables`."""
        yield from self._waitables

    # What it makes

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        publisher_class: type[Publisher[Any]] = Publisher,
    ) -> Publisher[MsgT]:
        """As `Node.create_publisher`."""
        qos = profile_of(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self._node.resolve_topic_name(topic)
        self._override_qos(Publisher, name, qos, qos_overriding_options)
        group = self._group(callback_group)
        node = self._node
        events = Events(node, group, event_callbacks or PublisherEventCallbacks(), topic)
        with events.kept():
            publisher = publisher_class(node, msg_type, name, qos, group, events)
        publisher.topic = topic  # ROS keeps it as it was written
        return self._added(self._publishers, publisher)

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: SubscriptionCallback[MsgT],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
        content_filter_options: Any = None,
    ) -> Subscription[MsgT]:
        """As `Node.create_subscription`."""
        qos = profile_of(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self._node.resolve_topic_name(topic)
        self._override_qos(Subscription, name, qos, qos_overriding_options)
        group = self._group(callback_group)
        node = self._node
        events = Events(node, group, event_callbacks or SubscriptionEventCallbacks(), topic)
        subscription: Subscription[MsgT]
        with events.kept():
            subscription = Subscription(node, msg_type, name, callback, group, qos, raw, events)
        subscription.topic = topic
        return self._added(self._subscriptions, subscription, group)

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client[RequestT, ResponseT]:
        """As `Node.create_client`."""
        check_is_valid_srv_type(srv_type)
        name = self._node.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()  # a number is no profile here
        group = self._group(callback_group)
        client: Client[RequestT, ResponseT]
        client = Client(self._node, srv_type, name, qos_profile, group)
        client.srv_name = srv_name
        check_service_profiles(client, is_server=False)
        return self._added(self._clients, client, group)

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callable[[RequestT, ResponseT], ResponseT | Awaitable[ResponseT]],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service[RequestT, ResponseT]:
        """As `Node.create_service`."""
        check_is_valid_srv_type(srv_type)
        name = self._node.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()
        group = self._group(callback_group)
        service: Service[RequestT, ResponseT]
        try:
            service = Service(self._node, srv_type, name, callback, group, qos_profile)
        except NameInUse as error:
            # Its way through us would hide the end, which is all that matters to whoever started
            # a program twice. And nothing here can join.
            raise NameInUse(str(error).partition(", or join it")[0]) from None
        service.srv_name = srv_name
        check_service_profiles(service, is_server=True)
        return self._added(self._services, service, group)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """As `Node.create_timer`."""
        group = self._group(callback_group)
        timer = Timer(
            callback,
            group,
            int(float(timer_period_sec) * S_TO_NS),
            self._node.get_clock() if clock is None else clock,
            context=self._node.context,
            autostart=autostart,
        )
        timer.parent_node = self._node
        return self._added(self._timers, timer, group)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """As `Node.create_guard_condition`."""
        group = self._group(callback_group)
        guard = GuardCondition(callback, group, context=self._node.context)
        guard.parent_node = self._node
        return self._added(self._guards, guard, group)

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """As `Node.create_rate`."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        # A group of its own: the callback that sleeps must not keep its timer from running.
        group = MutuallyExclusiveCallbackGroup()
        timer = self._node.create_timer(1.0 / frequency, None, group, clock)
        rate = self._rates[timer] = Rate(timer, context=self._node.context)
        return rate

    def add_waitable(self, waitable: Waitable[Any]) -> None:
        """As `Node.add_waitable`."""
        waitable.parent_node = self._node
        self._added(self._waitables, waitable)

    def remove_waitable(self, waitable: Waitable[Any]) -> None:
        """As `Node.remove_waitable`."""
        if waitable in self._waitables:
            self._waitables.remove(waitable)
            self.wake_executor()

    # Its ends

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """As `Node.destroy_publisher`."""
        return self._destroyed(self._publishers, publisher)

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        """As `Node.destroy_subscription`."""
        return self._destroyed(self._subscriptions, subscription)

    def destroy_client(self, client: Client[Any, Any]) -> bool:
        """As `Node.destroy_client`."""
        return self._destroyed(self._clients, client)

    def destroy_service(self, service: Service[Any, Any]) -> bool:
        """As `Node.destroy_service`."""
        return self._destroyed(self._services, service)

    def destroy_timer(self, timer: Timer) -> bool:
        """As `Node.destroy_timer`."""
        return self._destroyed(self._timers, timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """As `Node.destroy_guard_condition`."""
        return self._destroyed(self._guards, guard)

    def destroy_rate(self, rate: Rate) -> bool:
        """As `Node.destroy_rate`."""
        for timer, known in list(self._rates.items()):
            if known is rate:
                del self._rates[timer]
                rate.destroy()
                return self._node.destroy_timer(timer)
        return False

    # Inside

    def destroy_all(self) -> None:
        """Destroy all entities, at the end of the node."""
        for rate in list(self._rates.values()):
            self._node.destroy_rate(rate)
        everything: list[list[Any]] = [
            self._publishers,
            self._subscriptions,
            self._clients,
            self._services,
            self._timers,
            self._guards,
        ]
        for things in everything:
            while things:
                things.pop().destroy()

    def _override_qos(self, kind: type[Any], name: str, qos: QoSProfile, options: Any) -> None:
        if options is not None:
            from ..qos_overriding_options import _declare_qos_parameters

            _declare_qos_parameters(kind, self._node, name, qos, options)

    def _group(self, callback_group: CallbackGroup | None) -> CallbackGroup:
        return self._node.default_callback_group if callback_group is None else callback_group

    def _added(
        self, things: list[_Thing], thing: _Thing, group: CallbackGroup | None = None
    ) -> _Thing:
        things.append(thing)
        if group is not None:
            entity: Any = thing
            group.add_entity(entity)
        self.wake_executor()
        return thing

    def _destroyed(self, things: list[_Thing], thing: Any) -> bool:
        if thing not in things:
            return False
        things.remove(thing)
        thing.destroy()
        self.wake_executor()
        return True

    def wake_executor(self) -> None:
        """Make the executor of the node, if it has one, look at the entities again."""
        if (executor := self._node.executor) is not None:
            executor.wake()


def profile_of(qos: QoSProfile | int) -> QoSProfile:
    """A profile as programs give it to a topic: a QoSProfile, or a number for its depth."""
    if isinstance(qos, QoSProfile):
        return qos
    if not isinstance(qos, int):
        raise TypeError(f"Expected QoSProfile or int, but received {type(qos)!r}")
    if qos < 0:
        raise ValueError("History depth must be greater than or equal to zero")
    return QoSProfile(depth=qos)
