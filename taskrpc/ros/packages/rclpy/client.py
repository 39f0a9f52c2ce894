"""Clients: call a service and wait, or receive the response while a thread spins the node."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from taskrpc.errors import InvalidRequest, TaskRpcError, TypeMismatch
from taskrpc.spi import gid_of

from ._impl.bridge import detached
from ._impl.diagnostics.deadlocks import call_ended, check_call
from ._impl.diagnostics.explain import (
    call_failed,
    call_unspun,
    like_ros,
    loses_failed_calls,
    type_mismatch,
)
from ._impl.diagnostics.limits import wrapped_or_refused
from ._impl.execution.entity import Entity, is_busy, node_name
from ._impl.execution.outbox import OnResponse, Outbox
from ._impl.execution.scheduler import ExternalShutdownException
from ._impl.node_interface import NodeInterface
from ._impl.reexports import names_of
from .callback_groups import CallbackGroup
from .handle import ArrivalHandle
from .service_introspection import Introspection, ServiceIntrospectionState
from .task import Future, set_executor

if TYPE_CHECKING:
    from .clock import Clock
    from .qos import QoSProfile

SrvRequestT = TypeVar("SrvRequestT")
SrvResponseT = TypeVar("SrvResponseT")

_UNCHECKED = "failed to check service availability"
_SLICE = 0.1
"""Seconds of one wait: on Windows, Ctrl-C cannot interrupt a wait."""

_GRACE = 1.0
"""Seconds that a response may wait before we conclude that no thread spins the node."""

_LONG_GRACE = 5.0
"""The same while a callback runs in a pool: the spinning thread may be busy elsewhere."""

_FOR_OTHERS = 1.0
"""With `--like-ros`: the longest wait until all servers of the name have the request."""


class Client(Entity, Generic[SrvRequestT, SrvResponseT]):
    """Calls one service; `Node.create_client` creates it.

    Responses complete the futures only while a thread spins the node.
    """

    def __init__(
        self,
        node: NodeInterface,
        srv_type: Any,
        srv_name: str,
        qos_profile: Any,
        callback_group: CallbackGroup,
    ) -> None:
        self.parent_node = node
        self.context = node.context
        self.context.check("failed to create client")
        self.srv_type = srv_type
        self._full_name = self.srv_name = srv_name
        self.qos_profile = qos_profile
        self.callback_group = callback_group
        self.handle = ClientHandle(self)
        self._native = node.handle.bridge.client(srv_type, srv_name)
        # A type mismatch is explained in the words of ROS; other refusals are logged as before.
        self._warn = self._native.channel.on_refusal
        self._native.channel.on_refusal = self._refused
        self._outbox = Outbox(self._native, srv_type)
        self._responses: deque[tuple[int, Any, BaseException | None]] = deque()
        """Responses that wait for the spin: call number, response, error."""
        self._pending: dict[int, Future[Any]] = {}
        """The futures of the calls without a response, by call number."""
        self._numbers = 0
        """The number of the last call."""
        self._introspection = Introspection(node, srv_type, srv_name)
        self._gid = gid_of(node.get_fully_qualified_name())
        self._lock = threading.Lock()
        self._waited_for, self._waited_since = 0, 0.0
        """The oldest response that `call` has seen waiting, and since when."""

    @property
    def service_name(self) -> str:
        """The absolute name of the service."""
        return self._full_name

    @property
    def logger_name(self) -> str:
        """The name of the logger of its node."""
        self.handle.check()
        return str(self.parent_node.get_logger().name)

    @property
    def pending_futures(self) -> list[Future[Any]]:
        """The futures of the calls that have no response yet."""
        return list(self._pending.values())

    @property
    def waits_for_server(self) -> bool:
        """Whether requests wait because no server of the service is known."""
        return self._outbox.waits and not self._native.is_known()

    def oldest_response(self) -> tuple[int, Future[Any]]:
        """The call number and the future of the oldest response that waits to be taken.

        Raises LookupError when no response waits or nothing waits for the response.
        """
        number = self._responses[0][0]
        return number, self._pending[number]

    def call(self, request: SrvRequestT, timeout_sec: float | None = None) -> SrvResponseT | None:
        """Call the service and wait for the response, while another thread spins the node.

        Raises TimeoutError after `timeout_sec` seconds (`--like-ros` returns None, as Jazzy does),
        TypeError for a request of another type, WouldDeadlock in a callback that prevents the
        response from being taken, ExternalShutdownException some seconds after the shutdown.
        """
        callback = check_call(self, timeout_sec)
        try:
            return self._call(request, timeout_sec)
        finally:
            call_ended(callback)

    def _call(self, request: SrvRequestT, timeout_sec: float | None) -> SrvResponseT | None:
        future = self.call_async(request)
        done = threading.Event()
        future.when_done(done.set)
        end = None if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        over = math.inf
        while not done.is_set():
            over = self._over(over)
            left = _SLICE if end is None else min(_SLICE, end - time.monotonic())
            if left <= 0:
                self.remove_pending_request(future)
                if like_ros():
                    return None
                raise TimeoutError
            if not done.wait(left) and self._responses:
                self._take_unspun()
        return future.result()

    def _over(self, over: float) -> float:
        """The instant at which `call` stops waiting after the shutdown of the context.

        Raises ExternalShutdownException at that instant; ROS would wait for ever. `--like-ros` does
        so too, except after a signal: nobody wants a program that only SIGKILL ends.
        """
        context = self.parent_node.context
        if over == math.inf:
            return over if context.ok() else time.monotonic() + _LONG_GRACE
        if time.monotonic() >= over and (context.was_interrupted or not like_ros()):
            raise ExternalShutdownException
        return over

    def call_async(self, request: SrvRequestT) -> Future[SrvResponseT]:
        """Send a request and return the future of its response.

        While the service has no server, the request waits for one. Raises TypeError
        for a request of another type, InvalidRequest for a value that does not fit its field.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(self._expected(request))
        self.handle.check()
        request = detached(request)
        future: Future[SrvResponseT] = Future()
        with self._lock:
            self._numbers += 1
            number = self._numbers
            self._pending[number] = future

        def on_response(response: Any, error: BaseException | None) -> None:
            self._responses.append((number, *self._as_in_ros(response, error)))
            self.notify_executor()
            self.handle.item_arrived()

        try:
            cancel = self._send(request, on_response)
        except BaseException:
            self._pending.pop(number, None)
            raise
        future.when_done(partial(self._ended, number, future, cancel))
        if self._introspection.is_on:
            self._introspection.publish("REQUEST_SENT", self._gid, number, request=request)
        return future

    def _send(self, request: SrvRequestT, on_response: OnResponse) -> Callable[[], object]:
        try:
            cancel = self._outbox.send(request, on_response)
        except InvalidRequest as error:
            request = wrapped_or_refused(request, self._full_name, error)
            cancel = self._outbox.send(request, on_response)
        if like_ros():
            self._send_to_others(request, on_response)
        return cancel

    def _as_in_ros(
        self, response: Any, error: BaseException | None
    ) -> tuple[Any, BaseException | None]:
        """Return the response and the error that the program gets."""
        return response, error

    def _send_to_others(self, request: SrvRequestT, on_response: OnResponse) -> None:
        channel = self._native.channel
        sent = channel.send_to_others(request, lambda found: on_response(found, None))
        with contextlib.suppress(TimeoutError):  # a program may end right after its call
            sent.result(_FOR_OTHERS)

    def get_pending_request(self, sequence_number: int) -> Future[SrvResponseT]:
        """The future of a request that has no response yet; raises KeyError for any other."""
        return self._pending[sequence_number]

    def remove_pending_request(self, future: Future[SrvResponseT]) -> None:
        """Stop waiting for a response; the future stays as it is."""
        with self._lock:
            for number, known in list(self._pending.items()):
                if known is future:
                    del self._pending[number]

    def service_is_ready(self) -> bool:
        """Whether a server of the service is known; raises RCLError after the shutdown."""
        self._check()
        return self._native.is_known()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server of the service, at most `timeout_sec` seconds; False without one.

        Raises RCLError when a signal has shut the context down, InvalidHandle when the program has.
        """
        self._check()
        endless = timeout_sec is None or timeout_sec < 0
        end = time.monotonic() + (0.0 if timeout_sec is None else timeout_sec)
        while self.context.ok():
            left = _SLICE if endless else min(_SLICE, end - time.monotonic())
            if left <= 0:
                break
            if self._native.wait(left):
                return True
        self._check()
        if not self.context.ok():  # another thread is shutting it down
            self.context.refuse(_UNCHECKED)
        return self._native.connected or self._native.is_known()

    def _check(self) -> None:
        """Raise InvalidHandle after `destroy`, RCLError after the shutdown."""
        self.handle.check()
        self.context.check(_UNCHECKED)

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Publish the introspection events of the calls on `SERVICE/_service_event`, or stop."""
        self.handle.check()
        self._introspection.configure(clock, service_event_qos_profile, introspection_state)

    def destroy(self) -> None:
        """Release the service; requests that wait are sent first if their server is known.

        Use it through `Node.destroy_client`, or `with`.
        """
        if self.handle.valid:
            self.handle.destroy_when_not_in_use()
            self._outbox.close()
            self._introspection.close()
            self._native.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.parent_node.destroy_client(self)

    def _refused(self, error: TaskRpcError) -> None:
        if isinstance(error, TypeMismatch):
            type_mismatch(self._full_name, self.srv_type._TYPE, error)
        else:
            self._warn(error)

    def _expected(self, request: Any) -> str:
        kind = type(request).__name__
        if isinstance(request, type):
            kind = f"the class {request.__name__} (write `{self.srv_type.__name__}.Request()`)"
        return f"expected a {self.srv_type.Request.__name__} for {self._full_name}, got {kind}"

    def _ended(
        self, number: int, future: Future[SrvResponseT], cancel: Callable[[], object]
    ) -> None:
        self._pending.pop(number, None)
        if future.cancelled():
            cancel()

    def has_work(self) -> bool:
        """Whether a response waits to be taken."""
        return bool(self._responses)

    def take_work(self) -> Callable[[], Any] | None:
        """Take the oldest response and return the function that completes its future."""
        self.handle.check()
        try:
            number, response, error = self._responses.popleft()
        except IndexError:  # another thread took it
            return None
        if self._introspection.is_on and error is None:
            self._introspection.publish("RESPONSE_RECEIVED", self._gid, number, response=response)
        future = self._pending.get(number)
        if future is None:
            return None
        if error is not None:
            if loses_failed_calls():
                return None
            call_failed(self._full_name, error)
        return lambda: self._complete(future, response, error)

    def _take_unspun(self) -> None:
        """Take the response of `call` on this thread when it has waited too long for a spin."""
        number = self._responses[0][0]
        if self._waited_for != number:
            self._waited_for, self._waited_since = number, time.monotonic()
            return
        executor, grace = self.parent_node.executor, _GRACE
        if executor is not None and is_busy(executor):
            grace = _LONG_GRACE if executor.is_unattended else math.inf
        late = time.monotonic() - self._waited_since >= grace
        if late and not like_ros() and (complete := self.take_work()) is not None:
            call_unspun(self._full_name, node_name(self.parent_node))
            complete()

    def _complete(
        self, future: Future[SrvResponseT], response: Any, error: BaseException | None
    ) -> None:
        if (executor := self.parent_node.executor) is not None:
            set_executor(future, executor)
        if error is None:
            future.set_result(response)
        else:
            future.set_exception(error)
            future.exception()  # marks it as retrieved: `take_work` has reported the error


class ClientHandle(ArrivalHandle):
    """`Client.handle`: reports each response when it arrives."""

    set_on_new_response_callback = ArrivalHandle.set_on_new_callback
    clear_on_new_response_callback = ArrivalHandle.clear_on_new_callback


__getattr__ = names_of(
    __name__,
    __package__,
    {
        ".type_support": "SrvType SrvTypeRequest SrvTypeResponse",
        ".context": "Context",
        ".qos": "QoSProfile",
    },
)
