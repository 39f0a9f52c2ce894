"""Offers services and topics of a robot, which uses one transport, to callers on another one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import srvgen
from taskrpc.bridges.gateway.account_limits import AccountLimits
from taskrpc.bridges.gateway.allowed import Allowed
from taskrpc.bridges.gateway.robot_topics import RobotTopic, topics_of
from taskrpc.client import Client
from taskrpc.deferred import DeferredCall, DeferredService
from taskrpc.errors import (
    DeadlineExceeded,
    NameInUse,
    OutcomeUnknown,
    ServerBusy,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.node import Node
from taskrpc.spi import ServiceEndpoint, TopicEndpoint
from taskrpc.topic import Publisher, Subscription

log = logging.getLogger("taskrpc.gateway")

LOOK = 0.5
"""Seconds between two looks at the robot's graph."""


class Gateway:
    """Offers the allowed services and topics of the node `robot` at the node `lab`.

    A service that appears or vanishes on the robot appears or vanishes here. Callers need no
    definitions: the gateway sends them. Messages of topics flow from the robot only.
    """

    def __init__(
        self,
        robot: Node,
        lab: Node,
        *,
        services: Allowed,
        topics: Allowed,
        limits: AccountLimits,
        timeout: float,
    ) -> None:
        self.robot = robot
        self.lab = lab
        self.limits = limits
        self.timeout = timeout
        """The most seconds that a call to the robot may take."""
        self._services = services
        self._topics = topics
        self._offered: dict[str, _Service] = {}
        self._published: dict[str, _Topic] = {}
        self._reported: dict[str, str] = {}
        """The problem that was logged last, by name."""
        self.unused: list[str] = []
        """The patterns of names that allow nothing of what the robot has now."""

    @property
    def names(self) -> list[str]:
        """The services that are offered now."""
        return sorted(self._offered)

    @property
    def topic_names(self) -> list[str]:
        """The topics that are offered now."""
        return sorted(self._published)

    @property
    def calls_in_flight(self) -> int:
        """The calls that have no response yet."""
        return sum(each.calls_in_flight for each in self._offered.values())

    async def follow(self) -> None:
        """Keep services and topics up to date, until cancelled."""
        while True:
            await self.update()
            await asyncio.sleep(LOOK)

    async def update(self) -> None:
        """Offer what the robot has now, and withdraw the rest."""
        services: dict[str, ServiceEndpoint] = {}
        publishers: list[TopicEndpoint] = []
        for entry in await self.robot.graph():
            services |= {each.name: each for each in entry.services if each.name in self._services}
            publishers += [each for each in entry.publishers if each.name in self._topics]
        topics = topics_of(publishers)
        self.unused = self._services.unused(services) + self._topics.unused(topics)
        for name in [name for name, each in self._offered.items() if each.is_over(services)]:
            self._offered.pop(name).close()
            log.info("%s has left the robot", name)
        for name in [name for name, each in self._published.items() if each.is_over(topics)]:
            self._published.pop(name).close()
        for name, topic in self._published.items():
            topic.update(topics[name])
        for name in services.keys() - self._offered.keys():
            await self._offer(services[name])
        for name in topics.keys() - self._published.keys():
            self._publish(topics[name])

    async def _offer(self, found: ServiceEndpoint) -> None:
        try:
            type_name, text = await self.robot.definition(found.name)
            if not text:
                raise TaskRpcError(
                    f"this machine has no definition of {type_name}; build or install its package"
                )
            cls = srvgen.define(type_name, text)
            self._offered[found.name] = _Service(self, found, cls)
        except (TaskRpcError, srvgen.DefinitionError) as error:
            self.report("offer", found.name, error)
        else:
            self._reported.pop(found.name, None)
            log.info("offering %s [%s]", found.name, type_name)

    def _publish(self, found: RobotTopic) -> None:
        try:
            cls = srvgen.load(found.type_name)
            if found.type_hash not in ("", cls._HASH):
                raise TaskRpcError(f"the robot has another definition of {found.type_name}")
            self._published[found.name] = _Topic(self, found, cls)
        except (TaskRpcError, srvgen.DefinitionError) as error:
            self.report("offer", found.name, error)
        else:
            self._reported.pop(found.name, None)
            log.info("offering the topic %s [%s]", found.name, found.type_name)

    def report(self, what: str, name: str, error: Exception) -> None:
        """Log a problem with a service or topic, unless it was the last one that was logged."""
        problem = str(error)
        if self._reported.get(name) != problem:
            self._reported[name] = problem
            again = "; trying again" if isinstance(error, NameInUse) else ""
            log.warning("cannot %s %s: %s%s", what, name, problem, again)

    def close(self) -> None:
        """Withdraw everything."""
        for service in self._offered.values():
            service.close()
        for topic in self._published.values():
            topic.close()
        self._offered.clear()
        self._published.clear()


class _Service:
    """One service of the robot, as the lab sees it."""

    def __init__(self, gateway: Gateway, found: ServiceEndpoint, srv_type: Any) -> None:
        self._gateway = gateway
        self._found = found
        self._loop = asyncio.get_running_loop()
        self._client: Client[Any, Any] = gateway.robot.create_client(srv_type, found.name)
        try:
            self._service: DeferredService = gateway.lab.create_deferred_service(
                srv_type, found.name, self._called
            )
        except BaseException:
            self._client.destroy()
            raise

    def is_over(self, present: dict[str, ServiceEndpoint]) -> bool:
        """Whether the robot no longer has this service, or has another type of it."""
        now = present.get(self._found.name)
        return now is None or (now.type_name, now.type_hash) != (
            self._found.type_name,
            self._found.type_hash,
        )

    @property
    def calls_in_flight(self) -> int:
        """Its calls without a response."""
        status = self._service.status()
        return status.running + status.waiting

    def close(self) -> None:
        """Withdraw the service; calls to the robot go on to their end."""
        self._service.destroy()
        self._client.destroy()

    def _called(self, call: DeferredCall[Any, Any]) -> None:
        info, limits = call.info, self._gateway.limits
        # Without accounts, all callers have the same token: then each machine has its own limits.
        account = info.principal or info.machine
        began = self._loop.time()
        wait = limits.begin(account, began)
        if wait:
            problem = (
                f"the gateway passes at most {limits.rate:g} calls per second of one account on to"
                f" the robot, and {limits.in_flight} at a time"
            )
            call.fail(ServerBusy(problem, retry_after=wait))
            return
        left, most = info.time_left(), self._gateway.timeout
        sent = self._client.call_async(call.request, most if left is None else min(left, most))
        has_our_limit = left is None or left > most
        call.started()
        info.on_cancel = sent.cancel
        sent.add_done_callback(partial(self._done, call, account, began, has_our_limit))

    def _done(
        self,
        call: DeferredCall[Any, Any],
        account: str,
        began: float,
        has_our_limit: bool,
        sent: asyncio.Future[Any],
    ) -> None:
        end = partial(self._gateway.limits.end, account)
        if sent.cancelled() or isinstance(sent.exception(), DeadlineExceeded):
            # A ROS server still executes the call. If it did not count, one account could keep the
            # robot busy for ever with short deadlines.
            self._loop.call_at(began + self._gateway.timeout, end)
        else:
            end()
        if sent.cancelled():
            call.fail(TaskRpcError("cancelled by the caller"))
        elif (error := sent.exception()) is None:
            call.reply(sent.result())
        elif isinstance(error, DeadlineExceeded) and has_our_limit:
            limit = f"within {self._gateway.timeout:g} s, which is the gateway's --timeout"
            fate = "was not sent" if error.not_executed else "may have run"
            text = f"{self._found.name} did not respond {limit}; the call {fate}"
            call.fail(DeadlineExceeded(text, not_executed=error.not_executed))
        elif isinstance(error, TaskRpcError):
            if isinstance(error, TypeMismatch):  # all calls fail: the operator must know
                self._gateway.report("call", self._found.name, error)
            call.fail(error)
        else:
            log.error("the call to %s failed:", self._found.name, exc_info=error)
            call.fail(OutcomeUnknown(f"the gateway failed to call {self._found.name}"))


class _Topic:
    """One topic of the robot, as the lab sees it."""

    def __init__(self, gateway: Gateway, found: RobotTopic, msg_type: Any) -> None:
        self._found = found
        self._publisher: Publisher[Any] = gateway.lab.create_publisher(
            msg_type, found.name, found.offered
        )
        self._subscribe: Callable[..., Subscription[Any]] = partial(
            gateway.robot.create_subscription, msg_type, found.name, self._arrived
        )
        self._subscription: Subscription[Any] | None = None
        """None while no laptop subscribes: then the robot sends nothing."""
        self._publisher.on_matched = self._matched
        self._matched()

    def is_over(self, present: dict[str, RobotTopic]) -> bool:
        """Whether the robot no longer publishes this topic, or what to offer has changed."""
        now = present.get(self._found.name)
        found = self._found
        return now is None or (now.type_name, now.offered) != (found.type_name, found.offered)

    def update(self, found: RobotTopic) -> None:
        """Subscribe anew if the publishers need another quality of service."""
        changed = found.requested != self._found.requested
        self._found = found
        if changed:
            self._drop()
            self._matched()

    def close(self) -> None:
        """Publish it no more."""
        self._publisher.on_matched = _nothing
        self._publisher.destroy()
        self._drop()

    def _matched(self) -> None:
        offered = self._found.offered
        wanted = offered.is_latched or self._publisher.get_subscription_count() > 0
        if wanted and self._subscription is None:
            self._subscription = self._subscribe(self._found.requested)
        elif not wanted:
            self._drop()

    def _drop(self) -> None:
        if self._subscription is not None:
            self._subscription.destroy()
            self._subscription = None

    def _arrived(self, message: Any) -> None:
        self._publisher.publish(message)


def _nothing() -> None: ...
