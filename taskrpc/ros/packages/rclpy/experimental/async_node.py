"""The node of asyncio: its callbacks run on the event loop of the program, without an executor."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, ClassVar, Self, cast

from taskrpc.message_types import MsgT, RequestT, ResponseT, Srv

from .._impl.execution.async_entity import AsyncEntity
from .._impl.execution.wakeups import Sleep
from .._impl.node_entities import NodeEntities
from ..callback_groups import CallbackGroup, ReentrantCallbackGroup
from ..client import Client
from ..clock_type import ClockType
from ..node import BaseNode
from ..qos import QoSProfile, qos_profile_services_default
from ..service import Service
from ..subscription import Subscription, SubscriptionCallback
from ..subscription_content_filter_options import ContentFilterOptions
from ..timer import Timer
from .async_client import AsyncClient
from .async_clock import AsyncClock
from .async_publisher import AsyncPublisher
from .async_service import AsyncService
from .async_subscription import AsyncSubscription
from .async_timer import AsyncTimer


class _Entities(NodeEntities):
    """Creates the entities of an AsyncNode."""

    subscription_class: ClassVar[type[Subscription[Any]]] = AsyncSubscription
    client_class: ClassVar[type[Client[Any, Any]]] = AsyncClient
    service_class: ClassVar[type[Service[Any, Any]]] = AsyncService
    timer_class: ClassVar[type[Timer]] = AsyncTimer


class AsyncNode(BaseNode):
    """A node for programs of asyncio: callbacks are functions or coroutine functions.

    It runs inside `async with node:`, or while `await node.run()` waits. An exception of a callback
    ends it: both raise an ExceptionGroup. The arguments are those of `Node`.
    """

    default_callback_group: ClassVar[CallbackGroup] = ReentrantCallbackGroup()
    """Without effect: a callback of an entity begins after the end of the one before."""

    _rclpy_entities_class: ClassVar[type[NodeEntities]] = _Entities

    def _rclpy_begin(self) -> None:
        self._group: asyncio.TaskGroup | None = None
        """The tasks of the entities, while the node runs."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_over = asyncio.Event()
        """Set at the destruction, and when a signal shuts the context down."""

    def _rclpy_begun(self) -> None:
        self.handle.no_waitables = (
            f"{self.get_name()} is an AsyncNode, which has no actions; create action servers and"
            " clients on a rclpy.node.Node"
        )

    async def __aenter__(self) -> Self:
        if not self.handle.valid:
            raise RuntimeError("Node has been destroyed and cannot be reentered")
        if self._group is not None:
            raise RuntimeError("Node is already running")
        self._loop = asyncio.get_running_loop()
        self._group = group = await asyncio.TaskGroup().__aenter__()
        for entity in self._rclpy_entities.all():
            if isinstance(entity, AsyncEntity):
                entity.start(group)
        return self

    async def __aexit__(self, *exc_info: Any) -> None:
        group = self._group
        try:
            self.destroy_node()
            if group is not None:
                await group.__aexit__(*exc_info)
        finally:
            self._group = self._loop = None

    async def run(self) -> None:
        """Run the callbacks until `destroy_node`, or until the context is shut down.

        Raises RuntimeError inside `async with node:`, an ExceptionGroup with the exception of a
        callback.
        """
        async with self:
            ending = _Ending(asyncio.get_running_loop(), self._is_over)
            self.context.add_sleep(ending)
            if self.context.ok():
                await self._is_over.wait()

    def destroy_node(self) -> None:
        """Cancel the callbacks, destroy the entities, leave the network; twice is harmless."""
        if self._loop is not None and _is_elsewhere(self._loop):
            # The shutdown of the context may come from any thread; tasks belong to the loop's.
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self.destroy_node)
            return
        self._is_over.set()
        self.get_clock().destroy()
        super().destroy_node()

    async def wait_for_node(  # type: ignore[override]  # as in ROS
        self, fully_qualified_node_name: str, *, check_interval: float = 0.1
    ) -> None:
        """Wait for a node; looks for it every `check_interval` seconds."""
        name = f"/{fully_qualified_node_name.lstrip('/')}"
        while name not in self.get_fully_qualified_node_names():  # noqa: ASYNC110 - no Event tells
            await asyncio.sleep(check_interval)

    def get_clock(self) -> AsyncClock:
        """Its clock: `await node.get_clock().sleep(seconds)`."""
        return cast("AsyncClock", super().get_clock())

    @property
    def executor(self) -> None:
        """None: it needs no executor. Setting it, as `spin` does, raises TypeError."""
        return None

    @executor.setter
    def executor(self, new_executor: object) -> None:
        raise TypeError(
            f"{self.get_name()} is an AsyncNode, which no executor can spin;"
            " write `await node.run()`, or `async with node:`"
        )

    def add_waitable(self, waitable: object) -> None:
        """Raise TypeError: it has no actions and no other waitables."""
        self.handle.check_waitables()

    def create_publisher(
        self, msg_type: type[MsgT], topic: str, qos_profile: QoSProfile | int
    ) -> AsyncPublisher[MsgT]:
        """Create a publisher of a topic; a number as `qos_profile` is the depth.

        Raises RuntimeError on a destroyed node, as all methods that create something.
        """
        create = self._creating("publisher", self._rclpy_entities.create_publisher)
        created: AsyncPublisher[MsgT] = create(
            msg_type, topic, qos_profile, None, None, None, AsyncPublisher
        )
        return created

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: SubscriptionCallback[MsgT] | Callable[..., Awaitable[object]],
        qos_profile: QoSProfile | int,
        *,
        raw: bool = False,
        concurrent: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> AsyncSubscription[MsgT]:
        """Create a subscription, which calls `callback(message)` for each message of a topic.

        With `concurrent`, a callback may begin while another one awaits something.
        """
        create = self._creating("subscription", self._rclpy_entities.create_subscription)
        created: AsyncSubscription[MsgT] = create(
            msg_type,
            topic,
            callback,
            qos_profile,
            None,
            None,
            None,
            raw,
            content_filter_options,
            concurrent=concurrent,
        )
        return created

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callable[[RequestT, ResponseT], ResponseT | Awaitable[ResponseT]],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        concurrent: bool = False,
    ) -> AsyncService[RequestT, ResponseT]:
        """Offer a service: `callback(request, response)` returns the response of a request.

        With `concurrent`, a callback may begin while another one awaits something. Raises NameInUse
        when another program offers the service.
        """
        create = self._creating("service", self._rclpy_entities.create_service)
        created: AsyncService[RequestT, ResponseT] = create(
            srv_type, srv_name, callback, qos_profile, None, concurrent=concurrent
        )
        return created

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
    ) -> AsyncClient[RequestT, ResponseT]:
        """Create a client of a service."""
        create = self._creating("client", self._rclpy_entities.create_client)
        created: AsyncClient[RequestT, ResponseT] = create(srv_type, srv_name, qos_profile, None)
        return created

    def create_timer(
        self, timer_period_sec: float, callback: Callable[..., Any], autostart: bool = True
    ) -> AsyncTimer:
        """Call `callback()` every `timer_period_sec` seconds, first after one period.

        A callback with one parameter gets a TimerInfo.
        """
        create = self._creating("timer", self._rclpy_entities.create_timer)
        created: AsyncTimer = create(timer_period_sec, callback, None, None, autostart)
        return created

    def _creating(self, what: str, create: Callable[..., Any]) -> Callable[..., Any]:
        """A function that creates an entity, and begins to run its callbacks if the node runs."""
        if not self.handle.valid:
            raise RuntimeError(f"Cannot create {what} on a destroyed node")

        def created(*arguments: Any, concurrent: bool = False) -> Any:
            entity = create(*arguments)
            entity.forget = partial(self._rclpy_entities.forget, entity)
            if isinstance(entity, AsyncEntity):
                entity.concurrent = concurrent
                if self._group is not None:
                    entity.start(self._group)
            return entity

        return created

    def _rclpy_create_clock(self) -> AsyncClock:
        return AsyncClock(clock_type=ClockType.ROS_TIME)


class _Ending(Sleep):
    """Ends `run` when a signal shuts the context down."""

    def __init__(self, loop: asyncio.AbstractEventLoop, is_over: asyncio.Event) -> None:
        super().__init__()
        self._loop = loop
        self._is_over = is_over

    def end(self) -> None:
        """Set the event; from any thread and from signal handlers."""
        super().end()
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._is_over.set)


def _is_elsewhere(loop: asyncio.AbstractEventLoop) -> bool:
    """Whether this thread does not run the loop."""
    try:
        return asyncio.get_running_loop() is not loop
    except RuntimeError:
        return not loop.is_closed() and loop.is_running()
