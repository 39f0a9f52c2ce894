"""The same nodes and clients for programs that block: no async, no await.

The event loop runs in a thread of its own, one a process. Calls may come from any thread; service
callbacks run in threads, so that they may block and call other services.
"""

from __future__ import annotations

import asyncio
import atexit
import inspect
import os
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as WaitTimeout
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from taskrpc import client as _client
from taskrpc import node as _node
from taskrpc import platform
from taskrpc.access import Accounts, Role
from taskrpc.client import DEFAULT_TIMEOUT, UNSET, Unset
from taskrpc.deferred import DeferredService, Take
from taskrpc.errors import WouldDeadlock
from taskrpc.retry import RetryPolicy
from taskrpc.service import Callback, Service
from taskrpc.sync_topics import Publisher, Subscription, SyncTopics, Timer
from taskrpc.transport.base import Tell
from taskrpc.transport.entries import Entry
from taskrpc.transport.tls import Tls

if TYPE_CHECKING:
    from taskrpc.observer import NodeStatus, Observer
from taskrpc.wire.once import CompletionStore

_Result = TypeVar("_Result")

_SLICE = 0.1
"""Seconds of one wait on a lock: on Windows Ctrl-C does not reach a longer one before its end."""

_ENDED = 0
"""Instead of a process id, once the loop is told to stop."""


class Node(SyncTopics):
    """A node for blocking programs; arguments and methods are those of `taskrpc.Node`.

    Use it as `with taskrpc.sync.Node("name") as node:`.
    """

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "",
        transport: str = "tcp",
        listen: str | None = None,
        peers: Sequence[str] | None = None,
        tls: Tls | None = None,
        token: str | None = None,
        accounts: Accounts | str | Path | None = None,
        keepalive: str | None = None,
        observer: Observer | None = None,
    ) -> None:
        self._loop: _LoopThread = _LoopThread.shared()
        self._node = _Node(
            name,
            namespace=namespace,
            transport=transport,
            listen=listen,
            peers=peers,
            tls=tls,
            token=token,
            accounts=accounts,
            keepalive=keepalive,
            observer=observer,
        )

    def __enter__(self) -> Self:
        self._loop.run(self._node.start(), "entering a node")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
        """Where it takes calls: `HOST:PORT` or `unix:/path`, "" before it offers anything."""
        return self._node.address

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callback,
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
                threaded=threaded and not inspect.iscoroutinefunction(callback),
                idempotent=idempotent,
                exactly_once=exactly_once,
                join=join,
                role=role,
            ),
            "create_service()",
        )

    def create_deferred_service(
        self,
        srv_type: Any,
        srv_name: str,
        take: Take,
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
        srv_type: Any,
        srv_name: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
    ) -> Client:
        """A client of a service; as `taskrpc.Node.create_client`."""
        inner = self._loop.do(
            lambda: self._node.create_client(srv_type, srv_name, timeout=timeout, retry=retry),
            "create_client()",
        )
        return Client(self._loop, inner)

    def status(self) -> NodeStatus:
        """What this node has to do now, and what it has done since it started."""
        return self._loop.do(self._node.status, "status()")

    def graph(self) -> list[Entry]:
        """Every process that this node can see: its nodes, and what they have."""
        return self._loop.run(self._node.graph(), "graph()")

    def spin(self) -> None:
        """Serve until Ctrl-C or SIGTERM, then finish the calls in flight; a second signal ends
        the program at once.
        """
        stopped = threading.Event()

        def stop(number: int) -> None:
            if stopped.is_set():
                os._exit(128 + number)
            stopped.set()

        with platform.stop_signals(stop):
            while not stopped.wait(_SLICE):
                pass
            self._loop.run(self._node.drain(), "spin()")

    def destroy(self) -> None:
        """Withdraw all that it has and leave the network; `with` does it."""
        self._loop.run(self._node.destroy(), "destroy()")


class Client:
    """Calls one service and waits; may be used from several threads at once."""

    def __init__(self, loop: _LoopThread, inner: _client.Client) -> None:
        self._loop = loop
        self._inner = inner
        self._behind: deque[Future[Any]] = deque()
        """Calls that the loop is yet to send."""
        self.srv_type = inner.srv_type
        self.service_name = inner.service_name

    def service_is_ready(self) -> bool:
        """Whether the service can be called without looking for it first."""
        return self._inner.service_is_ready()

    def wait_for_service(self, timeout: float | None = None) -> bool:
        """Wait until the service is there; False when it is not within `timeout` seconds."""
        return self._loop.run(self._inner.wait_for_service(timeout), "wait_for_service()")

    def call(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> Any:
        """Call the service and return the response; errors as in `taskrpc.Client.call`.

        Raises WouldDeadlock when called on the event loop's own thread.
        """
        self._loop.refuse_own_thread("call()")
        if not request_id:
            sent = self._inner._send_in_thread(request, timeout, retry)
            if sent is not None:
                return sent.wait()
        return _wait(self.call_async(request, timeout, retry, request_id))

    def call_async(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> Future[Any]:
        """Send the request now; returns a `concurrent.futures.Future` of the response.

        Cancelling the future cancels the call.
        """
        self._loop.refuse_without_loop("call_async()")
        outer: Future[Any] = Future()
        self._loop.soon(lambda: self._begin(outer, request, timeout, retry, request_id))
        return outer

    def call_then(
        self, request: Any, tell: Tell, timeout: float | Unset | None = UNSET
    ) -> Callable[[], object]:
        """Send the request now and have `tell(response, error)` called at its end.

        One of the two is None. It is called on the event loop's thread and must not block.
        Returns a function that gives the call up; `tell` is not called then.

        Raises InvalidRequest for a request that cannot be sent.
        """
        self._loop.refuse_without_loop("call_then()")
        if not self._behind:
            sent = self._inner._tell_in_thread(request, timeout, tell)
            if sent is not None:
                return sent.give_up
        # What was handed over before must be sent before.
        future: Future[Any] = Future()
        future.add_done_callback(lambda done: _told(done, tell))
        self._behind.append(future)
        self._loop.soon(lambda: self._catch_up(request, timeout))
        return future.cancel

    def _catch_up(self, request: Any, timeout: float | Unset | None) -> None:
        self._begin(self._behind.popleft(), request, timeout, UNSET, "")

    def destroy(self) -> None:
        """Forget the service."""
        self._loop.do(self._inner.destroy, "destroy()")

    def _begin(
        self,
        outer: Future[Any],
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
        request_id: str,
    ) -> None:
        """Begin a call on the loop and tie its future to the caller's."""
        if outer.cancelled():
            outer.set_running_or_notify_cancel()  # wakes who waits for several futures
            return
        try:
            inner = self._inner.call_async(request, timeout, retry, request_id)
        except Exception as error:
            outer.set_exception(error)
            return
        inner.add_done_callback(lambda done: _copy(done, outer))
        outer.add_done_callback(lambda _: self._loop.soon(inner.cancel))


class _Node(_node.Node):
    """The node that lives on the loop, and is used by other threads."""

    _threads = True


class _LoopThread:
    """The event loop of this process's blocking nodes, in a thread of its own."""

    _instance: _LoopThread | None = None
    _guard = threading.Lock()

    def __init__(self) -> None:
        self._started: Future[asyncio.AbstractEventLoop] = Future()
        self._thread = threading.Thread(target=self._main, name="taskrpc", daemon=True)
        self._thread.start()
        self._loop = self._started.result()
        self._pid = os.getpid()
        atexit.register(self._stop)

    @classmethod
    def shared(cls) -> _LoopThread:
        """The process's loop thread, started for the first who asks (again after a fork)."""
        with cls._guard:
            if cls._instance is None or cls._instance._pid != os.getpid():
                cls._instance = cls()
            return cls._instance

    def run(self, coroutine: Coroutine[Any, Any, _Result], what: str) -> _Result:
        """Run a coroutine on the loop and wait for its result."""
        try:
            self.refuse_own_thread(what)
        except WouldDeadlock:
            coroutine.close()
            raise
        return _wait(asyncio.run_coroutine_threadsafe(coroutine, self._loop))

    def do(self, action: Callable[[], _Result], what: str) -> _Result:
        """Run a plain function on the loop and wait for its result."""

        async def run() -> _Result:
            return action()

        return self.run(run(), what)

    def soon(self, action: Callable[[], object]) -> None:
        """Run a plain function on the loop without waiting."""
        self._loop.call_soon_threadsafe(action)

    def refuse_without_loop(self, what: str) -> None:
        """Raise WouldDeadlock where nobody would answer: after a fork, and at the program's end."""
        if self._pid == _ENDED:
            raise WouldDeadlock(
                f"{what} would wait for ever: the program is ending, its event loop has stopped;"
                " what atexit is to call must be registered after the first node was made"
            )
        if self._pid != os.getpid():
            raise WouldDeadlock(f"{what}: this node belongs to the parent process; make one here")

    def refuse_own_thread(self, what: str) -> None:
        """Raise WouldDeadlock on the loop's own thread, which would wait for itself."""
        if self._pid != os.getpid():  # asked first: this is on every call's path
            self.refuse_without_loop(what)
        if threading.current_thread() is self._thread:
            raise WouldDeadlock(
                f"{what} would wait for ever: it was called on the event loop's own thread, by an"
                " async callback or one with threaded=False; use a plain callback, which runs in"
                " a thread, or taskrpc.Node with `await`"
            )

    def _main(self) -> None:
        with asyncio.Runner(loop_factory=_node.fast_loop()) as runner:
            loop = runner.get_loop()
            self._started.set_result(loop)
            loop.run_forever()

    def _stop(self) -> None:
        if self._pid == os.getpid():
            self._pid = _ENDED
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(2.0)


def _wait(future: Future[_Result]) -> _Result:
    try:
        while True:
            try:
                return future.result(_SLICE)
            except WaitTimeout:
                # Our own DeadlineExceeded is a TimeoutError too; only an unfinished wait goes on.
                if future.done():
                    return future.result()
    except (KeyboardInterrupt, SystemExit):
        future.cancel()
        raise


def _told(done: Future[Any], tell: Tell) -> None:
    if not done.cancelled():
        error = done.exception()
        tell(None if error else done.result(), error)


def _copy(inner: asyncio.Future[Any], outer: Future[Any]) -> None:
    if inner.cancelled():
        outer.cancel()
    if not outer.set_running_or_notify_cancel():
        return
    if (error := inner.exception()) is not None:
        outer.set_exception(error)
    else:
        outer.set_result(inner.result())


__all__ = ["Client", "Node", "Publisher", "Subscription", "Timer"]
