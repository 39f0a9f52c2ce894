"""The entities of a node: publishers, subscriptions, clients, services, timers and more."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, ClassVar, TypeVar

from taskrpc.errors import NameInUse
from taskrpc.message_types import MsgT, RequestT, ResponseT, Srv

from ..callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from ..client import Client
from ..clock import Clock
from ..constants import S_TO_NS
from ..event_handler import Events, PublisherEventCallbacks, SubscriptionEventCallbacks
from ..guard_condition import GuardCondition
from ..publisher import Publisher
from ..qos import QoSProfile
from ..service import Service
from ..subscription import Subscription, SubscriptionCallback
from ..subscription_content_filter_options import ContentFilterOptions
from ..timer import Rate, Timer
from ..type_support import check_is_valid_msg_type, check_is_valid_srv_type
from ..waitable import Waitable
from .graph.endpoints import check_service_profiles
from .node_interface import NodeInterface

_EntityT = TypeVar("_EntityT")


class NodeEntities:
    """Creates, keeps and destroys the entities of one node; `Node` documents the methods.

    `Node` has the default arguments; here every argument is required.
    """

    subscription_class: ClassVar[type[Subscription[Any]]] = Subscription
    client_class: ClassVar[type[Client[Any, Any]]] = Client
    service_class: ClassVar[type[Service[Any, Any]]] = Service
    timer_class: ClassVar[type[Timer]] = Timer

    def __init__(self, node: NodeInterface) -> None:
        self._node = node
        self.publishers: list[Publisher[Any]] = []
        self.subscriptions: list[Subscription[Any]] = []
        self.clients: list[Client[Any, Any]] = []
        self.services: list[Service[Any, Any]] = []
        self.timers: list[Timer] = []
        self.guards: list[GuardCondition] = []
        self.waitables: list[Waitable[Any]] = []
        self._rates: dict[Timer, Rate] = {}
        """The rates, by the timer that each of them owns."""

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos_profile: QoSProfile | int,
        callback_group: CallbackGroup | None,
        event_callbacks: Any,
        qos_overriding_options: Any,
        publisher_class: type[Publisher[Any]],
    ) -> Publisher[MsgT]:
        """As `Node.create_publisher`."""
        qos = topic_profile(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self._node.resolve_topic_name(topic)
        self._override_qos(Publisher, name, qos, qos_overriding_options)
        group = self._group(callback_group)
        node = self._node
        callbacks = event_callbacks or PublisherEventCallbacks()
        events = Events(node, group, callbacks, topic, qos.to_timing())
        with events.kept():
            publisher = publisher_class(node, msg_type, name, qos, group, events)
        publisher.topic = topic  # as the program wrote it, as in ROS
        return self._added(self.publishers, publisher)

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: SubscriptionCallback[MsgT],
        qos_profile: QoSProfile | int,
        callback_group: CallbackGroup | None,
        event_callbacks: Any,
        qos_overriding_options: Any,
        raw: bool,
        content_filter_options: ContentFilterOptions | None,
    ) -> Subscription[MsgT]:
        """As `Node.create_subscription`."""
        qos = topic_profile(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self._node.resolve_topic_name(topic)
        self._override_qos(Subscription, name, qos, qos_overriding_options)
        group = self._group(callback_group)
        node = self._node
        callbacks = event_callbacks or SubscriptionEventCallbacks()
        events = Events(node, group, callbacks, topic, qos.to_timing())
        subscription: Subscription[MsgT]
        with events.kept():
            subscription = self.subscription_class(
                node,
                msg_type,
                name,
                callback,
                group,
                qos,
                raw,
                events,
                content_filter_options,
            )
        subscription.topic = topic
        return self._added(self.subscriptions, subscription, group)

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup | None,
    ) -> Client[RequestT, ResponseT]:
        """As `Node.create_client`."""
        check_is_valid_srv_type(srv_type)
        name = self._node.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()  # raises AttributeError for a number, as ROS does
        group = self._group(callback_group)
        client: Client[RequestT, ResponseT]
        client = self.client_class(self._node, srv_type, name, qos_profile, group)
        client.srv_name = srv_name
        check_service_profiles(client, is_server=False)
        return self._added(self.clients, client, group)

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callable[[RequestT, ResponseT], ResponseT | Awaitable[ResponseT]],
        qos_profile: QoSProfile,
        callback_group: CallbackGroup | None,
    ) -> Service[RequestT, ResponseT]:
        """As `Node.create_service`."""
        check_is_valid_srv_type(srv_type)
        name = self._node.resolve_service_name(srv_name)
        qos_profile.get_c_qos_profile()
        group = self._group(callback_group)
        service: Service[RequestT, ResponseT]
        try:
            service = self.service_class(self._node, srv_type, name, callback, group, qos_profile)
        except NameInUse as error:
            # A user who started a program twice needs only this error. `from None` leaves out the
            # traceback inside taskrpc. rclpy cannot join a service, so the advice to join is cut.
            raise error.without_join() from None
        service.srv_name = srv_name
        check_service_profiles(service, is_server=True)
        return self._added(self.services, service, group)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None,
        clock: Clock | None,
        autostart: bool,
    ) -> Timer:
        """As `Node.create_timer`."""
        group = self._group(callback_group)
        timer = self.timer_class(
            callback,
            group,
            int(float(timer_period_sec) * S_TO_NS),
            self._node.get_clock() if clock is None else clock,
            context=self._node.context,
            autostart=autostart,
        )
        timer.parent_node = self._node
        return self._added(self.timers, timer, group)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None
    ) -> GuardCondition:
        """As `Node.create_guard_condition`."""
        group = self._group(callback_group)
        guard = GuardCondition(callback, group, context=self._node.context)
        guard.parent_node = self._node
        return self._added(self.guards, guard, group)

    def create_rate(self, frequency: float, clock: Clock | None) -> Rate:
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
        self._added(self.waitables, waitable)

    def remove_waitable(self, waitable: Waitable[Any]) -> None:
        """As `Node.remove_waitable`."""
        if waitable in self.waitables:
            self.waitables.remove(waitable)
            self.wake_executor()

    def destroy(self, entity: Any, entities: list[Any]) -> bool:
        """Destroy an entity; returns whether it was in the list of its kind."""
        if entity not in entities:
            return False
        entities.remove(entity)
        entity.destroy()
        self.wake_executor()
        return True

    def destroy_rate(self, rate: Rate) -> bool:
        """As `Node.destroy_rate`."""
        for timer, known in list(self._rates.items()):
            if known is rate:
                del self._rates[timer]
                rate.destroy()
                return self._node.destroy_timer(timer)
        return False

    def destroy_all(self) -> None:
        """Destroy all entities, at the end of the node."""
        for rate in list(self._rates.values()):
            self._node.destroy_rate(rate)
        for waitable in list(self.waitables):
            waitable.node_destroyed()
        for entities in self._kinds():
            while entities:
                entities.pop().destroy()

    def all(self) -> list[Any]:
        """All entities except waitables."""
        return [entity for entities in self._kinds() for entity in entities]

    def forget(self, entity: Any) -> None:
        """Remove an entity that was destroyed."""
        for entities in self._kinds():
            if entity in entities:
                entities.remove(entity)

    def _kinds(self) -> list[list[Any]]:
        return [
            self.publishers,
            self.subscriptions,
            self.clients,
            self.services,
            self.timers,
            self.guards,
        ]

    def _override_qos(self, kind: type[Any], name: str, qos: QoSProfile, options: Any) -> None:
        if options is not None:
            from ..qos_overriding_options import _declare_qos_parameters

            _declare_qos_parameters(kind, self._node, name, qos, options)

    def _group(self, callback_group: CallbackGroup | None) -> CallbackGroup:
        return self._node.default_callback_group if callback_group is None else callback_group

    def _added(
        self, entities: list[_EntityT], entity: _EntityT, group: CallbackGroup | None = None
    ) -> _EntityT:
        if group is not None:
            member: Any = entity
            try:
                group.add_entity(member)
            except BaseException:  # for example because a program passed no group
                member.destroy()
                raise
        entities.append(entity)
        self.wake_executor()
        return entity

    def wake_executor(self) -> None:
        """Let the executor of the node collect the entities again."""
        if (executor := self._node.executor) is not None:
            executor.wake()


def topic_profile(qos: QoSProfile | int) -> QoSProfile:
    """The profile that a program passes for a topic: a QoSProfile, or a number for its depth."""
    if isinstance(qos, QoSProfile):
        return qos
    if not isinstance(qos, int):
        raise TypeError(f"Expected QoSProfile or int, but received {type(qos)!r}")
    if qos < 0:
        raise ValueError("history depth must be greater than or equal to zero")
    return QoSProfile(depth=qos)
