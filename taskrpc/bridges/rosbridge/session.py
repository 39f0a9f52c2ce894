"""One client of rosbridge: carries out its operations, and sends it responses and messages."""

from __future__ import annotations

import asyncio
import itertools
import logging
import math
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from typing import Any, Protocol, TypeAlias

import srvgen
from taskrpc.bridges.rosbridge import protocol
from taskrpc.bridges.rosbridge.actions import ActionClients, ClientGoals, OfferedAction
from taskrpc.bridges.rosbridge.graph import graph_of
from taskrpc.bridges.rosbridge.protocol import BadOperation, Id, Level, Operation
from taskrpc.bridges.rosbridge.rosapi import Rosapi
from taskrpc.bridges.rosbridge.services import OfferedService, ServiceClients
from taskrpc.bridges.rosbridge.topics import ClientPublisher, ClientSubscription
from taskrpc.bridges.rosbridge.values import to_json
from taskrpc.client import DEFAULT_TIMEOUT
from taskrpc.errors import (
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.node import Node
from taskrpc.spi import time_of_day_ns

log = logging.getLogger("taskrpc.rosbridge")

MAX_CALLS = 256
"""Calls of one client that may run at a time; a further one is refused."""
MAX_ROSAPI_CALLS = 4
"""Calls of rosapi that run at a time for one client; further ones wait. Some block for tens of
milliseconds, so many in one turn of the event loop would delay all programs."""
MAX_TOPICS = 256
"""Topics that one client may subscribe to, and topics that it may publish on."""
MAX_SERVICES = 64
"""Services that one client may offer."""
MAX_ACTIONS = 16
"""Actions that one client may offer."""
_MAX_TIMEOUT = 86_400.0
"""The longest deadline of a call, in seconds."""

_REMEMBERED = 10.0
"""Seconds for which the types of topics are remembered, as in rosbridge_suite."""

_REFUSALS = (TaskRpcError, srvgen.DefinitionError, srvgen.FieldError)
"""Errors whose text tells the client what is wrong."""
_ENDS = "the gateway ends"

_Handler: TypeAlias = Callable[[Any], Coroutine[Any, Any, None]]


class _Part(Protocol):
    """A service, action, subscription or publisher of the client."""

    def close(self) -> None: ...


class Bridge:
    """What all sessions share: the node, its clients of services, and rosapi."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.clients = ServiceClients(node)
        self.actions = ActionClients(node)
        self.rosapi = Rosapi(node, self.clients)
        self._advertised: dict[str, tuple[str, float]] = {}
        """The types of topics that clients advertised until they left, and when they left."""

    def remember_type(self, topic: str, type_name: str) -> None:
        """Keep the type of a topic whose client leaves: ros-mcp reconnects before it publishes."""
        self._advertised.pop(topic, None)
        self._advertised[topic] = type_name, asyncio.get_running_loop().time()
        while len(self._advertised) > MAX_TOPICS:
            del self._advertised[next(iter(self._advertised))]

    def remembered_type(self, topic: str) -> str:
        """Return the type with which a client advertised a topic shortly before it left, or ""."""
        type_name, left = self._advertised.get(topic, ("", -math.inf))
        return type_name if asyncio.get_running_loop().time() - left < _REMEMBERED else ""


class Session:
    """Serves one client.

    `send` sends a text to the client and returns at once. `is_behind` returns whether the client
    has much to read; call `drained` when it has read it. Call `end` before the gateway ends the
    connection, and `close` when the connection has ended.
    """

    def __init__(
        self, bridge: Bridge, send: Callable[[str], object], is_behind: Callable[[], bool]
    ) -> None:
        self._bridge = bridge
        self._send_text = send
        self._is_behind = is_behind
        self._loop = asyncio.get_running_loop()
        self._level: Level = "error"
        """The least severe statuses that the client gets."""
        self._fragments = protocol.Fragments()
        self._calls: dict[asyncio.Future[Any], protocol.CallService] = {}
        """The calls in flight, with what the client has sent."""
        self._is_ending = False
        self._rosapi_calls = asyncio.Semaphore(MAX_ROSAPI_CALLS)
        self._goals = ClientGoals(bridge.actions, send, is_behind, partial(self._report, "warning"))
        # By absolute name:
        self._subscriptions: dict[str, ClientSubscription] = {}
        self._publishers: dict[str, ClientPublisher] = {}
        self._services: dict[str, OfferedService] = {}
        self._actions: dict[str, OfferedAction] = {}
        self._numbers = itertools.count(1)
        """The numbers of the calls and goals that the client gets."""
        self._handlers: dict[type[Operation], _Handler] = {
            protocol.Advertise: self._advertise,
            protocol.Unadvertise: self._unadvertise,
            protocol.Publish: self._publish,
            protocol.Subscribe: self._subscribe,
            protocol.Unsubscribe: self._unsubscribe,
            protocol.CallService: self._call_service,
            protocol.AdvertiseService: self._advertise_service,
            protocol.UnadvertiseService: self._unadvertise_service,
            protocol.ServiceResponse: self._service_response,
            protocol.SendActionGoal: self._send_action_goal,
            protocol.CancelActionGoal: self._cancel_action_goal,
            protocol.AdvertiseAction: self._advertise_action,
            protocol.UnadvertiseAction: self._unadvertise_action,
            protocol.ActionFeedback: self._action_feedback,
            protocol.ActionResult: self._action_result,
            protocol.SetLevel: self._set_level,
        }

    async def receive(self, text: str | bytes) -> None:
        """Carry out the operation in a message; the client gets a status if it is wrong.

        Operations take effect in the order of these calls. Calls of services run on their own.
        """
        try:
            operation = protocol.parse(text)
            if isinstance(operation, protocol.Fragment):
                whole = self._fragments.add(operation, self._loop.time())
                if whole is None:
                    return
                operation = protocol.parse(whole)
            handle = self._handlers.get(type(operation))
            if handle is None:
                raise BadOperation("fragment: expected an operation, got a fragment", operation.id)
            await self._handle(operation, handle)
        except BadOperation as error:
            self._report("error", str(error), error.id)

    async def _handle(self, operation: Operation, handle: _Handler) -> None:
        name = operation.__struct_config__.tag
        try:
            await handle(operation)
        except _REFUSALS as error:
            raise BadOperation(f"{name}: {error}", operation.id) from None
        except BadOperation:
            raise
        except Exception:
            log.exception("the operation %s of a client failed", name)
            problem = f"{name}: the gateway failed to do it; see its log"
            raise BadOperation(problem, operation.id) from None

    def drained(self) -> None:
        """Continue with the topics, after the client has read what it had got."""
        for subscription in list(self._subscriptions.values()):
            subscription.drained()
        self._goals.drained()

    def end(self) -> None:
        """Respond to the calls in flight, because the gateway ends; refuse later ones."""
        self._is_ending = True
        for call in [call for call in self._calls if not call.done()]:
            operation = self._calls.pop(call)
            self._failed(operation, OutcomeUnknown(f"{_ENDS}; the call may have run"))
            call.cancel()
        self._goals.end(_ENDS)

    def close(self) -> None:
        """End everything that the client has begun."""
        for call in list(self._calls):
            call.cancel()
        self._goals.close()
        parts: list[_Part] = [*self._services.values(), *self._actions.values()]
        parts += self._subscriptions.values()
        for topic, publisher in self._publishers.items():
            self._bridge.remember_type(topic, publisher.type_name)
        for part in (*parts, *self._publishers.values()):
            part.close()
        self._services.clear()
        self._actions.clear()
        self._subscriptions.clear()
        self._publishers.clear()

    # Statuses

    def _send(self, operation: Mapping[str, Any]) -> None:
        self._send_text(protocol.encode(operation))

    def _report(self, level: Level, text: str, name: Id = None) -> None:
        if protocol.is_wanted(level, self._level):
            self._send(protocol.status(level, text, name))

    async def _set_level(self, operation: protocol.SetLevel) -> None:
        self._level = operation.level

    # Services that the client calls

    async def _call_service(self, operation: protocol.CallService) -> None:
        if self._is_ending:
            self._failed(operation, ServiceUnavailable(f"{_ENDS}; the call has not run"))
            return
        if len(self._calls) >= MAX_CALLS:
            problem = f"expected at most {MAX_CALLS} calls at a time"
            self._failed(operation, ServerBusy(problem))
            return
        if (verb := self._bridge.rosapi.verb_of(operation.service)) is not None:
            self._begin_task(operation, self._call_rosapi(verb, operation.args))
            return
        timeout = _timeout_of(operation)
        clients = self._bridge.clients
        try:
            call = clients.begin(operation.service, operation.args, timeout)
        except Exception as error:
            self._failed(operation, error)
            return
        if call is None:
            self._begin_task(operation, clients.call(operation.service, operation.args, timeout))
            return
        # No task of its own: that would cost the call two more turns of the event loop.
        deadline = None if timeout is None else self._loop.time() + timeout
        self._calls[call] = operation
        call.add_done_callback(partial(self._answered, operation, deadline))

    def _begin_task(
        self, operation: protocol.CallService, call: Coroutine[Any, Any, dict[str, Any]]
    ) -> None:
        task = self._loop.create_task(call)
        self._calls[task] = operation
        task.add_done_callback(partial(self._ended, operation))

    async def _call_rosapi(self, verb: str, args: object) -> dict[str, Any]:
        async with self._rosapi_calls:
            values = await self._bridge.rosapi.call(verb, args)
            await asyncio.sleep(0)  # gives other programs a turn before the next call
        return values

    def _answered(
        self, operation: protocol.CallService, deadline: float | None, call: asyncio.Future[Any]
    ) -> None:
        """End a call that was sent at once."""
        if call.cancelled() or not isinstance(call.exception(), TypeMismatch):
            self._ended(operation, call, to_json)
            return
        # A server with another definition has replaced the earlier one.
        self._calls.pop(call, None)
        left = None if deadline is None else deadline - self._loop.time()
        clients = self._bridge.clients
        self._begin_task(operation, clients.call(operation.service, operation.args, left))

    def _ended(
        self,
        operation: protocol.CallService,
        call: asyncio.Future[Any],
        convert: Callable[[Any], dict[str, Any]] = lambda values: values,
    ) -> None:
        is_open = self._calls.pop(call, None) is not None
        if call.cancelled():  # the client has left, or `end` has responded
            return
        error = call.exception()
        if not is_open:  # `end` has responded, but the call could not be cancelled
            return
        if error is None:
            self._respond(operation, convert(call.result()), result=True)
        else:
            self._failed(operation, error)

    def _failed(self, operation: protocol.CallService, error: BaseException) -> None:
        if not isinstance(error, _REFUSALS):
            log.error("a call of %s for a client failed", operation.service, exc_info=error)
        self._respond(operation, f"{type(error).__name__}: {error}", result=False)

    def _respond(self, operation: protocol.CallService, values: object, *, result: bool) -> None:
        response: dict[str, Any] = {"op": "service_response", "service": operation.service}
        if operation.id is not None:
            response["id"] = operation.id
        text = protocol.encode({**response, "values": values, "result": result})
        size = protocol.count_of(operation.fragment_size, 0, 2**31)
        for part in protocol.split(text, size, f"response:{operation.id}"):
            self._send_text(part)

    # Services that the client offers

    async def _advertise_service(self, operation: protocol.AdvertiseService) -> None:
        node = self._bridge.node
        name = node.resolve_service_name(operation.service)
        known = self._services.pop(name, None)
        if known is not None:  # a client that reconnects or reloads offers it again
            known.close()
        _check_room(self._services, MAX_SERVICES, "services")
        self._services[name] = OfferedService(node, operation, self._send, self._numbers)

    async def _unadvertise_service(self, operation: protocol.UnadvertiseService) -> None:
        name = self._bridge.node.resolve_service_name(operation.service)
        service = self._services.pop(name, None)
        if service is None:
            raise BadOperation(f"unadvertise_service: this client does not offer {name}")
        service.close()

    async def _service_response(self, operation: protocol.ServiceResponse) -> None:
        for service in self._services.values():
            if service.waits_for(operation):
                service.respond(operation)
                return
        # Its caller may have cancelled the call, so this is no mistake of the client.
        text = f"service_response: no call {operation.id!r} waits for a response"
        self._report("info", text, operation.id)

    # Actions

    async def _send_action_goal(self, operation: protocol.SendActionGoal) -> None:
        if self._is_ending:
            error = ServiceUnavailable(f"{_ENDS}; the goal has not been sent")
            self._goals.refuse(operation, error)
        else:
            self._goals.begin(operation)

    async def _cancel_action_goal(self, operation: protocol.CancelActionGoal) -> None:
        self._goals.cancel(operation)

    async def _advertise_action(self, operation: protocol.AdvertiseAction) -> None:
        node = self._bridge.node
        name = node.resolve_service_name(operation.action)
        known = self._actions.pop(name, None)
        if known is not None:  # a client that reconnects or reloads offers it again
            known.close()
        _check_room(self._actions, MAX_ACTIONS, "actions")
        self._actions[name] = OfferedAction(node, operation, self._send_text, self._numbers)

    async def _unadvertise_action(self, operation: protocol.UnadvertiseAction) -> None:
        name = self._bridge.node.resolve_service_name(operation.action)
        action = self._actions.pop(name, None)
        if action is None:
            raise BadOperation(f"unadvertise_action: this client does not offer {name}")
        action.close()

    async def _action_feedback(self, operation: protocol.ActionFeedback) -> None:
        for action in self._actions.values():
            if action.waits_for(operation):
                action.publish(operation)
                return
        self._no_goal(operation)

    async def _action_result(self, operation: protocol.ActionResult) -> None:
        for action in self._actions.values():
            if action.waits_for(operation):
                action.finish(operation)
                return
        self._no_goal(operation)

    def _no_goal(self, operation: protocol.ActionFeedback | protocol.ActionResult) -> None:
        # The goal may have ended just now, so this is no mistake of the client.
        name = operation.__struct_config__.tag
        self._report("info", f"{name}: no goal {operation.id!r} is executed", operation.id)

    # Topics

    async def _subscribe(self, operation: protocol.Subscribe) -> None:
        node = self._bridge.node
        topic = node.resolve_topic_name(operation.topic)
        if operation.compression not in (None, "", "none"):
            text = f"subscribe: no compression {operation.compression}; messages are sent as JSON"
            self._report("error", text, operation.id)
        known = self._subscriptions.get(topic)
        if known is not None:
            known.add(operation)
            return
        _check_room(self._subscriptions, MAX_TOPICS, "subscriptions")
        graph = await graph_of(node)
        if not operation.type and not graph.type_of(topic):
            problem = f"subscribe: no program has the topic {topic}; give its type"
            raise BadOperation(problem, operation.id)
        self._subscriptions[topic] = ClientSubscription(
            node,
            operation,
            graph,
            self._send_text,
            self._is_behind,
            lambda reason: self._mismatch("publisher", topic, reason),
        )

    async def _unsubscribe(self, operation: protocol.Unsubscribe) -> None:
        topic = self._bridge.node.resolve_topic_name(operation.topic)
        known = self._subscriptions.get(topic)
        if known is None:
            raise BadOperation(
                f"unsubscribe: this client has no subscription of {topic}", operation.id
            )
        if known.remove(operation.id):
            self._subscriptions.pop(topic).close()

    async def _advertise(self, operation: protocol.Advertise) -> None:
        node = self._bridge.node
        topic = node.resolve_topic_name(operation.topic)
        known = self._publishers.get(topic)
        if known is not None:
            known.add(operation)
            return
        _check_room(self._publishers, MAX_TOPICS, "publishers")
        self._publishers[topic] = ClientPublisher(
            node,
            operation,
            await graph_of(node),
            lambda reason: self._mismatch("subscription", topic, reason),
        )

    async def _unadvertise(self, operation: protocol.Unadvertise) -> None:
        topic = self._bridge.node.resolve_topic_name(operation.topic)
        known = self._publishers.get(topic)
        if known is None:
            raise BadOperation(f"unadvertise: this client does not advertise {topic}", operation.id)
        if known.remove(operation.id):
            self._publishers.pop(topic).close()

    async def _publish(self, operation: protocol.Publish) -> None:
        topic = self._bridge.node.resolve_topic_name(operation.topic)
        if topic not in self._publishers:
            type_name = (await graph_of(self._bridge.node)).type_of(topic)
            type_name = type_name or self._bridge.remembered_type(topic)
            if not type_name:
                problem = f"publish: the type of {topic} is unknown; advertise it first"
                raise BadOperation(problem, operation.id)
            await self._advertise(protocol.Advertise(topic=operation.topic, type=type_name))
        self._publishers[topic].publish(operation.msg, divmod(time_of_day_ns(), 10**9))

    def _mismatch(self, other: str, topic: str, reason: str) -> None:
        text = f"a {other} of {topic} does not match this client's: {reason.lower()}"
        self._report("error" if reason == "TYPE" else "warning", text)


def _timeout_of(operation: protocol.CallService) -> float | None:
    if operation.timeout is None:
        return DEFAULT_TIMEOUT
    return float(min(operation.timeout, _MAX_TIMEOUT)) if operation.timeout > 0 else None


def _check_room(found: Mapping[str, object], most: int, what: str) -> None:
    if len(found) >= most:
        raise ServerBusy(f"expected at most {most} {what} of one client")
