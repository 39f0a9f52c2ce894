"""The blocking node and client: no async, no await.

One event loop for the process runs in a thread of its own. Any thread may call; service callbacks
run in threads, so that they may block and call other services.
"""

from __future__ import annotations

import asyncio
import inspect
import os
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial, wraps
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Concatenate, Generic, ParamSpec, Self

from srvgen import excepthook
from taskrpc import client as _client
from taskrpc import node as _node
from taskrpc.client import DEFAULT_TIMEOUT, UNSET, Unset
from taskrpc.core.request_ids.ids import CompletionStore
from taskrpc.core.security.roles import Role
from taskrpc.core.system import signals
from taskrpc.core.transport.base import OnDone, OnMismatch, ProgramStatistics
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.deferred import DeferredService, Take
from taskrpc.errors import TaskRpcError
from taskrpc.message_types import (
    Action,
    FeedbackT,
    GoalT,
    MsgT,
    RequestT,
    ResponseT,
    ResultT,
    Srv,
)
from taskrpc.qos import QoS
from taskrpc.retry import RetryPolicy
from taskrpc.service import Callback, Service
from taskrpc.sync.actions import ActionClient
from taskrpc.sync.loop_thread import SLICE, LoopThread, wait
from taskrpc.sync.topics import Publisher, Subscription, Timer

if TYPE_CHECKING:
    from taskrpc.actions.server import ActionServer
    from taskrpc.actions.server_goal import AcceptCancel, AcceptGoal, Execute
    from taskrpc.core.introspection import IntrospectionState
    from taskrpc.core.observer import NodeStatus


_AT_ONCE = 1.0
"""Seconds: a node that ends earlier, and has callbacks, was meant to live longer."""

_Settings = ParamSpec("_Settings")


def _with_settings_of(
    node: Callable[Concatenate[Any, _Settings], None],
) -> Callable[[Callable[..., None]], Callable[Concatenate[Any, _Settings], None]]:
    """Give a constructor the signature of another one, for type checkers and `inspect`."""
    return wraps(node)


class Node:
    """A node for blocking programs; arguments and methods are those of `taskrpc.Node`.

    Use it as `with taskrpc.sync.Node("name") as node:`. In a notebook or at the prompt, call
    `start()` at the beginning and `close()` at the end instead.
    """

    _has_waited: ClassVar[bool] = False
    """Whether the program calls or publishes itself, or has waited in `spin`."""

    @_with_settings_of(_node.Node.__init__)
    def __init__(self, *args: Any, **settings: Any) -> None:
        self._loop: LoopThread = LoopThread.shared()
        self._node = _Node(*args, **settings)
        self._began = time.monotonic()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        excepthook.explain(error)
        lived = time.monotonic() - self._began
        if error is None and lived < _AT_ONCE and not Node._has_waited:
            self._node.warn_unspun()
        self.destroy()

    if not TYPE_CHECKING:  # type checkers report `async with`; programs get a better message

        def __aenter__(self):
            raise TaskRpcError(
                "taskrpc.sync.Node is blocking: write `with taskrpc.sync.Node(...) as node:`,"
                " or `async with taskrpc.Node(...) as node:` in an async function"
            )

        def __aexit__(self, *_):
            """Never called: `async with` looks it up before it calls `__aenter__`."""

    @property
    def async_node(self) -> _node.Node:
        """The asynchronous node behind this one; use it only on the loop's thread."""
        return self._node

    @property
    def loop_thread(self) -> LoopThread:
        """The thread with the event loop on which the asynchronous node lives."""
        return self._loop

    def start(self) -> Self:
        """Join the network and return the node itself; `with` calls this."""
        self._loop.run(self._node.start(), "start()")
        return self

    def close(self) -> None:
        """Withdraw its services and topics and leave the network, as `destroy` does."""
        self.destroy()

    def get_name(self) -> str:
        """The node's name, without its namespace."""
        return self._node.get_name()

    def get_namespace(self) -> str:
        """The node's namespace, which begins with `/`."""
        return self._node.get_namespace()

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""
        return self._node.get_fully_qualified_name()

    @property
    def address(self) -> str:
        """The address for calls: `HOST:PORT` or `unix:/path`, "" before it offers anything."""
        return self._node.address

    def create_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        callback: Callback[RequestT, ResponseT],
        *,
        concurrency: int | None = None,
        threaded: bool = True,
        idempotent: bool = False,
        exactly_once: CompletionStore | None = None,
        join: bool = False,
        role: Role = Role.SUBMIT,
    ) -> Service:
        """Offer a service; as `taskrpc.Node.create_service`, but plain callbacks run in threads."""
        return self._loop.do(
            lambda: self._node.create_service(
                srv_type,
                srv_name,
                callback,
                concurrency=concurrency,
                threaded=_in_thread(callback, threaded),
                idempotent=idempotent,
                exactly_once=exactly_once,
                join=join,
                role=role,
            ),
            "create_service()",
        )

    def create_deferred_service(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        take: Take[RequestT, ResponseT],
        *,
        join: bool = False,
        role: Role = Role.SUBMIT,
    ) -> DeferredService:
        """Offer a service; as `taskrpc.Node.create_deferred_service`.

        `take(call)` is called on the event loop's thread and must not block.
        """
        return self._loop.do(
            lambda: self._node.create_deferred_service(
                srv_type, srv_name, take, join=join, role=role
            ),
            "create_deferred_service()",
        )

    def create_client(
        self,
        srv_type: type[Srv[RequestT, ResponseT]],
        srv_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
    ) -> Client[RequestT, ResponseT]:
        """A client of a service; as `taskrpc.Node.create_client`."""
        inner = self._loop.do(
            lambda: self._node.create_client(srv_type, srv_name, timeout=timeout, retry=retry),
            "create_client()",
        )
        Node._has_waited = True
        return Client(self._loop, inner)

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos: QoS | int = 10,
        *,
        role: Role = Role.OBSERVE,
        on_mismatch: OnMismatch | None = None,
    ) -> Publisher[MsgT]:
        """Publish messages of a type on a topic; as `taskrpc.Node.create_publisher`."""
        inner = self._loop.do(
            lambda: self._node.create_publisher(
                msg_type, topic, qos, role=role, on_mismatch=on_mismatch
            ),
            "create_publisher()",
        )
        Node._has_waited = True
        return Publisher(self._loop, inner)

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: Callable[[MsgT], object],
        qos: QoS | int = 10,
        *,
        threaded: bool = True,
        on_mismatch: OnMismatch | None = None,
    ) -> Subscription[MsgT]:
        """Call `callback(message)` for each message of a topic.

        As `taskrpc.Node.create_subscription`, but plain callbacks run in a thread.
        """
        inner = self._loop.do(
            lambda: self._node.create_subscription(
                msg_type,
                topic,
                callback,
                qos,
                threaded=_in_thread(callback, threaded),
                on_mismatch=on_mismatch,
            ),
            "create_subscription()",
        )
        return Subscription(self._loop, inner)

    def create_action_server(
        self,
        act_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        execute: Execute[GoalT, ResultT, FeedbackT],
        *,
        goal: AcceptGoal[GoalT] | None = None,
        cancel: AcceptCancel[GoalT, ResultT, FeedbackT] | None = None,
        concurrency: int = 1,
        threaded: bool = True,
        result_timeout: float = 900.0,
        role: Role = Role.SUBMIT,
    ) -> ActionServer:
        """Offer an action; as `taskrpc.Node.create_action_server`.

        A plain `execute` runs in a thread. `goal` and `cancel` run on the event loop's thread and
        must not block.
        """
        return self._loop.do(
            lambda: self._node.create_action_server(
                act_type,
                action_name,
                execute,
                goal=goal,
                cancel=cancel,
                concurrency=concurrency,
                threaded=_in_thread(execute, threaded),
                result_timeout=result_timeout,
                role=role,
            ),
            "create_action_server()",
        )

    def create_action_client(
        self,
        act_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        feedback_depth: int = 16,
    ) -> ActionClient[GoalT, ResultT, FeedbackT]:
        """A client of an action; as `taskrpc.Node.create_action_client`."""
        inner = self._loop.do(
            lambda: self._node.create_action_client(
                act_type, action_name, timeout=timeout, feedback_depth=feedback_depth
            ),
            "create_action_client()",
        )
        Node._has_waited = True
        return ActionClient(self._loop, inner)

    def configure_introspection(
        self, service: Service, state: IntrospectionState, qos: QoS | int = 100
    ) -> None:
        """Publish the calls of a service; as `taskrpc.Node.configure_introspection`."""
        self._loop.do(
            lambda: self._node.configure_introspection(service, state, qos),
            "configure_introspection()",
        )

    def create_timer(
        self, period: float, callback: Callable[[], object], *, threaded: bool = True
    ) -> Timer:
        """Call `callback()` every `period` seconds, in a thread if it is plain."""
        inner = self._loop.do(
            lambda: self._node.create_timer(
                period, callback, threaded=_in_thread(callback, threaded)
            ),
            "create_timer()",
        )
        return Timer(self._loop, inner)

    def status(self) -> NodeStatus:
        """Return the present load of this node, and its counts since it started."""
        return self._loop.do(self._node.status, "status()")

    def graph(self) -> list[RegistryEntry]:
        """Return every process that this node can see, with its nodes, services and topics."""
        return self._loop.run(self._node.graph(), "graph()")

    def statistics(self, timeout: float = 2.0) -> list[ProgramStatistics]:
        """Return the calls of every other program that this node can see, as `taskrpc top` does.

        The programs measure their calls from now on, until this node disconnects from them.
        """
        return self._loop.run(self._node.statistics(timeout), "statistics()")

    def spin(self) -> None:
        """Serve until Ctrl-C or SIGTERM; then finish the calls in flight, as `taskrpc.Node.spin`.

        A second signal ends the program at once.
        """
        Node._has_waited = True
        is_stopped = False

        def stop(number: int) -> None:
            nonlocal is_stopped
            if is_stopped:
                os._exit(128 + number)
            is_stopped = True

        with signals.stop_signals(stop):
            # Not an Event: a signal may come while this thread holds the lock that `set` needs.
            while not is_stopped:
                time.sleep(SLICE)
            self._loop.run(self._node.finish(), "spin()")

    def destroy(self) -> None:
        """Withdraw its services and topics and leave the network; `with` does it."""
        self._loop.run(self._node.destroy(), "destroy()")


class Client(Generic[RequestT, ResponseT]):
    """Calls one service and waits; may be used from several threads at once."""

    def __init__(self, loop: LoopThread, inner: _client.Client[RequestT, ResponseT]) -> None:
        self._loop = loop
        self._inner = inner
        self._handed_off: set[Future[Any]] = set()
        """Calls of `call_then` that the event loop sends and that have not ended."""
        self.srv_type = inner.srv_type
        self.service_name = inner.service_name

    @property
    def async_client(self) -> _client.Client[RequestT, ResponseT]:
        """The asynchronous client behind this one; use it only on the loop's thread."""
        return self._inner

    def service_is_ready(self) -> bool:
        """Whether the service can be called without looking for it first."""
        return self._inner.service_is_ready()

    def wait_for_service(self, timeout: float | None = None) -> bool:
        """Wait until a server offers the service; False if none does within `timeout` seconds."""
        return self._loop.run(self._inner.wait_for_service(timeout), "wait_for_service()")

    def call(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> ResponseT:
        """Call the service and return the response; errors as in `taskrpc.Client.call`.

        Raises WouldDeadlock when called on the event loop's own thread.
        """
        self._loop.refuse_own_thread("call()")
        if not request_id:
            sent = _client.send_in_thread(self._inner, request, timeout, retry)
            if sent is not None:
                response: ResponseT = sent.wait()
                return response
        return wait(self.call_async(request, timeout, retry, request_id))

    def call_async(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> Future[ResponseT]:
        """Send the request now; returns a `concurrent.futures.Future` of the response.

        Cancelling the future cancels the call.
        """
        self._loop.refuse_without_loop("call_async()")
        outer: Future[ResponseT] = Future()
        call = partial(self._inner.call_async, request, timeout, retry, request_id)
        self._loop.soon(lambda: self._begin(outer, call))
        return outer

    def call_then(
        self, request: RequestT, tell: OnDone, timeout: float | Unset | None = UNSET
    ) -> Callable[[], object]:
        """Send the request now, and call `tell(response, error)` at the end of the call.

        One of the two is None. `tell` runs on the event loop's thread and must not block.
        Returns a function that cancels the call; `tell` is not called then.

        Raises InvalidRequest for a request that cannot be sent.
        """
        self._loop.refuse_without_loop("call_then()")
        if not self._handed_off:
            sent = _client.send_in_thread_then(self._inner, request, timeout, tell)
            if sent is not None:
                return sent.cancel
        # Keep the order: earlier calls that the event loop sends go first, and end first.
        future: Future[ResponseT] = Future()
        future.add_done_callback(lambda done: self._ended(done, tell))
        self._handed_off.add(future)
        call = partial(self._call_in_task, request, timeout)
        self._loop.soon(lambda: self._begin(future, call))
        return future.cancel

    def _ended(self, done: Future[ResponseT], tell: OnDone) -> None:
        self._handed_off.discard(done)  # when none is left, the caller's thread may send again
        if not done.cancelled():
            error = done.exception()
            tell(None if error else done.result(), error)

    def destroy(self) -> None:
        """Forget the service."""
        self._loop.do(self._inner.destroy, "destroy()")

    def _call_in_task(
        self, request: RequestT, timeout: float | Unset | None
    ) -> asyncio.Task[ResponseT]:
        """Call in a task, even where `call_async` would need none.

        Every response then takes the same number of loop iterations to its caller. One that took
        fewer would overtake the responses that arrived with it.
        """
        return asyncio.get_running_loop().create_task(self._inner.call(request, timeout))

    def _begin(
        self, outer: Future[ResponseT], call: Callable[[], asyncio.Future[ResponseT]]
    ) -> None:
        """Begin a call on the event loop and connect its future to the caller's."""
        if outer.cancelled():
            outer.set_running_or_notify_cancel()  # wakes programs that wait for several futures
            return
        try:
            inner = call()
        except Exception as error:
            outer.set_exception(error)
            return
        inner.add_done_callback(lambda done: _copy(done, outer))
        outer.add_done_callback(lambda _: self._loop.soon(inner.cancel))


class _Node(_node.Node):
    """The asynchronous node on the event loop, which other threads use."""

    _threads = True

    async def finish(self) -> None:
        """Finish the calls in flight, and cancel the goals."""
        await self._finish()

    def warn_unspun(self) -> None:
        """Say that the program ends at once, if the node has callbacks."""
        if self._can_run_callbacks is not None:
            self._warn_unspun("node.spin()")


def _copy(inner: asyncio.Future[Any], outer: Future[Any]) -> None:
    if inner.cancelled():
        outer.cancel()
    if not outer.set_running_or_notify_cancel():
        return
    if (error := inner.exception()) is not None:
        outer.set_exception(error)
    else:
        outer.set_result(inner.result())


def _in_thread(callback: Callable[..., object], threaded: bool) -> bool:
    return threaded and not inspect.iscoroutinefunction(callback)
