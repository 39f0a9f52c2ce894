"""The part of a node that makes, keeps and destroys what callbacks come from."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from typing import Any, TypeVar, cast

from taskrpc.errors import NameInUse
from taskrpc.given_types import MsgT, RequestT, ResponseT, Srv

from ..callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from ..client import Client
from ..clock import Clock
from ..constants import S_TO_NS
from ..context import Context
from ..event_handler import Events, PublisherEventCallbacks, SubscriptionEventCallbacks
from ..guard_condition import GuardCondition
from ..publisher import Publisher
from ..qos import QoSProfile, qos_profile_services_default
from ..service import Service
from ..subscription import Subscription, SubscriptionCallback
from ..timer import Rate, Timer
from ..type_support import check_is_valid_msg_type, check_is_valid_srv_type
from ..waitable import Waitable
from .graph.endpoints import meet
from .node_interface import NodeInterface

_Thing = TypeVar("_Thing")


class NodeEntities:
    """What a node has: publishers, subscriptions, clients, services, timers and more."""

    _context: Context
    executor: Any
    resolve_topic_name: Callable[[str], str]
    resolve_service_name: Callable[[str], str]
    get_clock: Callable[[], Clock]

    def __init__(self) -> None:
        self._rclpy_publishers: list[Publisher[Any]] = []
        self._rclpy_subscriptions: list[Subscription[Any]] = []
        self._rclpy_clients: list[Client[Any, Any]] = []
        self._rclpy_services: list[Service[Any, Any]] = []
        self._rclpy_timers: list[Timer] = []
        self._rclpy_guards: list[GuardCondition] = []
        self._rclpy_waitables: list[Waitable[Any]] = []
        self._rclpy_rates: dict[Timer, Rate] = {}
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of all that was made without one: its callbacks exclude each other."""
        return self._default_callback_group

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        """Its publishers."""
        yield from self._rclpy_publishers

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        """Its subscriptions."""
        yield from self._rclpy_subscriptions

    @property
    def clients(self) -> Iterator[Client[Any, Any]]:
        """Its clients."""
        yield from self._rclpy_clients

    @property
    def services(self) -> Iterator[Service[Any, Any]]:
        """Its services."""
        yield from self._rclpy_services

    @property
    def timers(self) -> Iterator[Timer]:
        """Its timers."""
        yield from self._rclpy_timers

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """Its guard conditions."""
        yield from self._rclpy_guards

    @property
    def waitables(self) -> Iterator[Waitable[Any]]:
        """What else it waits for."""
        yield from self._rclpy_waitables

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
        """Publish messages of a type on a topic; a number as `qos_profile` is its depth."""
        qos = profile_of(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self.resolve_topic_name(topic)
        self._override_qos(Publisher, name, qos, qos_overriding_options)
        group = self._rclpy_group(callback_group)
        node = self._rclpy_as_node()
        events = Events(node, group, event_callbacks or PublisherEventCallbacks(), topic)
        with events.kept():
            publisher = publisher_class(node, msg_type, name, qos, group, events)
        publisher.topic = topic  # ROS keeps it as it was written
        return self._rclpy_added(self._rclpy_publishers, publisher)

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
        """Have `callback(message)` called for each message of a topic.

        A callback with two parameters gets a `MessageInfo`, too; with `raw`, the message is CDR.
        """
        qos = profile_of(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self.resolve_topic_name(topic)
        self._override_qos(Subscription, name, qos, qos_overriding_options)
        group = self._rclpy_group(callback_group)
        node = self._rclpy_as_node()
        events = Events(node, group, event_callbacks or SubscriptionEventCallbacks(), topic)
        subscription: Subscription[MsgT]
        with events.kept():
            subscription = Subscription(node, msg_type, name, callback, group, qos, raw, events)
        subscription.topic = topic
        return self._rclpy_added(self._rclpy_subscriptions, subscription, group)

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client[RequestT, ResponseT]:
        """A client of a service."""
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()  # a number is no profile here
        group = self._rclpy_group(callback_group)
        client: Client[RequestT, ResponseT]
        client = Client(self._rclpy_as_node(), srv_type, name, qos_profile, group)
        client.srv_name = srv_name
        meet(client, is_server=False)
        return self._rclpy_added(self._rclpy_clients, client, group)

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callable[[RequestT, ResponseT], ResponseT | Awaitable[ResponseT]],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service[RequestT, ResponseT]:
        """Offer a service: `callback(request, response)` is called for each and returns the answer.

        Raises NameInUse where another program offers it.
        """
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()
        group = self._rclpy_group(callback_group)
        service: Service[RequestT, ResponseT]
        try:
            service = Service(self._rclpy_as_node(), srv_type, name, callback, group, qos_profile)
        except NameInUse as error:
            # Its way through us would hide the end, which is all that matters to whoever started
            # a program twice. And nothing here can join.
            raise NameInUse(str(error).partition(", or join it")[0]) from None
        service.srv_name = srv_name
        meet(service, is_server=True)
        return self._rclpy_added(self._rclpy_services, service, group)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Have `callback()` called every `timer_period_sec` seconds, first after one period."""
        group = self._rclpy_group(callback_group)
        timer = Timer(
            callback,
            group,
            int(float(timer_period_sec) * S_TO_NS),
            self.get_clock() if clock is None else clock,
            context=self._context,
            autostart=autostart,
        )
        timer.parent_node = self
        return self._rclpy_added(self._rclpy_timers, timer, group)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Have `callback()` called whenever the guard condition is triggered."""
        group = self._rclpy_group(callback_group)
        guard = GuardCondition(callback, group, context=self._context)
        guard.parent_node = self
        return self._rclpy_added(self._rclpy_guards, guard, group)

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Sleep `frequency` times a second, in a thread beside the one that spins.

        Raises ValueError for a frequency that is not above 0.
        """
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        # A group of its own: the callback that sleeps must not keep its timer from running.
        group = MutuallyExclusiveCallbackGroup()
        timer = self.create_timer(1.0 / frequency, None, group, clock)
        rate = self._rclpy_rates[timer] = Rate(timer, context=self._context)
        return rate

    def add_waitable(self, waitable: Waitable[Any]) -> None:
        """Wait for something of the program's own, too."""
        waitable.parent_node = self
        self._rclpy_added(self._rclpy_waitables, waitable)

    def remove_waitable(self, waitable: Waitable[Any]) -> None:
        """Wait for it no longer."""
        if waitable in self._rclpy_waitables:
            self._rclpy_waitables.remove(waitable)
            self._wake_executor()

    # Its ends

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Publish no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_publishers, publisher)

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        """Read no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_subscriptions, subscription)

    def destroy_client(self, client: Client[Any, Any]) -> bool:
        """Call no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_clients, client)

    def destroy_service(self, service: Service[Any, Any]) -> bool:
        """Offer it no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_services, service)

    def destroy_timer(self, timer: Timer) -> bool:
        """Call back no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_timers, timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Call back no more; whether it was this node's."""
        return self._rclpy_destroyed(self._rclpy_guards, guard)

    def destroy_rate(self, rate: Rate) -> bool:
        """Wake who sleeps; whether it was this node's."""
        for timer, known in list(self._rclpy_rates.items()):
            if known is rate:
                del self._rclpy_rates[timer]
                rate.destroy()
                return self.destroy_timer(timer)
        return False

    # Inside

    def _rclpy_destroy_entities(self) -> None:
        for rate in list(self._rclpy_rates.values()):
            self.destroy_rate(rate)
        everything: list[list[Any]] = [
            self._rclpy_publishers,
            self._rclpy_subscriptions,
            self._rclpy_clients,
            self._rclpy_services,
            self._rclpy_timers,
            self._rclpy_guards,
        ]
        for things in everything:
            while things:
                things.pop().destroy()

    def _rclpy_as_node(self) -> NodeInterface:
        return cast("NodeInterface", self)

    def _override_qos(self, kind: type[Any], name: str, qos: QoSProfile, options: Any) -> None:
        if options is not None:
            from ..qos_overriding_options import _declare_qos_parameters

            _declare_qos_parameters(kind, self._rclpy_as_node(), name, qos, options)

    def _rclpy_group(self, callback_group: CallbackGroup | None) -> CallbackGroup:
        return self._default_callback_group if callback_group is None else callback_group

    def _rclpy_added(
        self, things: list[_Thing], thing: _Thing, group: CallbackGroup | None = None
    ) -> _Thing:
        things.append(thing)
        if group is not None:
            entity: Any = thing
            group.add_entity(entity)
        self._wake_executor()
        return thing

    def _rclpy_destroyed(self, things: list[_Thing], thing: Any) -> bool:
        if thing not in things:
            return False
        things.remove(thing)
        thing.destroy()
        self._wake_executor()
        return True

    def _wake_executor(self) -> None:
        if (executor := self.executor) is not None:
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
