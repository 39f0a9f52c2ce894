"""Clients: calls of a service, with a deadline, and with retries that are safe."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Generic

from taskrpc.core.attempts import Attempts
from taskrpc.core.transport.base import DEFAULT_TIMEOUT as DEFAULT_TIMEOUT  # noqa: PLC0414
from taskrpc.core.transport.base import OnDone
from taskrpc.core.transport.channel import RemoteChannel
from taskrpc.core.transport.codec import ServiceType
from taskrpc.core.transport.connection.client_side import time_left
from taskrpc.core.transport.connection.client_threads import CallbackWaiter, Waiter
from taskrpc.core.transport.connection.deadline_timer import clock_of
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.wire.status import code_of
from taskrpc.errors import Code, InvalidRequest, TaskRpcError
from taskrpc.message_types import RequestT, ResponseT
from taskrpc.retry import RetryBudget, RetryPolicy

if TYPE_CHECKING:
    from taskrpc.core.observer import Observer


class Unset(Enum):
    """The default of an argument for which None has a meaning of its own."""

    UNSET = "UNSET"

    def __repr__(self) -> str:
        return "UNSET"


UNSET: Final = Unset.UNSET


class Client(Generic[RequestT, ResponseT]):
    """Calls one service; made by `Node.create_client`.

    `timeout` (seconds, None for no deadline) and `retry` are the defaults of its calls. `destroy`
    calls `forget`. If no server offers the service, the client calls the first of `otherwise`
    that a server offers.
    """

    def __init__(
        self,
        transport: Endpoint,
        srv_type: ServiceType,
        name: str,
        node: str,
        *,
        timeout: float | None = DEFAULT_TIMEOUT,
        retry: RetryPolicy | None = None,
        forget: Callable[[Client[Any, Any]], object] = lambda _: None,
        otherwise: Sequence[str] = (),
    ) -> None:
        self.srv_type = srv_type
        self.service_name = name
        self._timeout = checked_timeout(timeout)
        self._left = 0 if timeout is None else time_left(timeout, 0.0)
        """Milliseconds until the deadline of a call without a timeout of its own."""
        self._retry = retry
        self._budget = RetryBudget()
        self._loop = asyncio.get_running_loop()
        self._now = clock_of(self._loop)
        self._forget = forget
        self._channel = transport.channel(name, srv_type, node, otherwise=otherwise)
        # Other threads may not read a clock that belongs to the event loop.
        self._thread_channel = self._channel if self._now is time.monotonic else None
        """The channel for other threads; None if only the event loop can send."""

    @property
    def channel(self) -> RemoteChannel:
        """The channel to the service, for the layers above."""
        return self._channel

    def service_is_ready(self) -> bool:
        """Whether a server of the service is known."""
        return self._channel.offered

    async def wait_for_service(self, timeout: float | None = None) -> bool:
        """Wait until a server offers the service; False if none does within `timeout` seconds.

        Raises TaskRpcError after `destroy`, so that a loop of a thread ends with the node.
        """
        self._channel.refuse_if_closed()
        timeout = checked_timeout(timeout, "wait_for_service: timeout")
        deadline = None if timeout is None else self._loop.time() + timeout
        return await self._channel.wait(deadline)

    async def call(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> ResponseT:
        """Call the service; `await` yields the response.

        `timeout` is in seconds and covers everything: finding the service, waiting, retries.
        Nothing is sent before the call is awaited. A call of an exactly-once service is repeated
        until its deadline if its connection is lost. `request_id` is the id of its request:
        requests with the same id run once, even if another program sends one of them.

        Raises:
            ServiceUnavailable: no server offers the service; with `retry`, none did until the
                deadline.
            DeadlineExceeded: no response in time; the client has cancelled the call at the server.
            InvalidRequest: a value does not fit its field, or `retry` has an `attempt_timeout` and
                the service is neither idempotent nor exactly-once.
            TypeMismatch, ServerBusy, HandlerFailed, OutcomeUnknown, …: see `taskrpc.errors`.
        """
        seconds, left = self._timeout, self._left  # as in `_deadline`
        if timeout is not UNSET:
            seconds, left = checked_timeout(timeout), 0
        deadline = None if seconds is None else self._now() + seconds
        policy = self._retry if retry is UNSET else retry
        channel, call = self._channel, None
        response: ResponseT
        if policy is None and not request_id:
            call = channel.send(request, deadline, None, left)
        if call is None:
            response = await self._attempts(request, deadline, policy, request_id).result()
            return response
        # The fast path does the same as the first attempt of `Attempts`, whose coroutine would cost
        # a tenth of the call. A test compares both.
        if (counter := call.counter) is None:
            try:
                response = await call.future
            except asyncio.CancelledError:
                call.cancel()
                raise
            return response
        try:
            response = await call.future
        except asyncio.CancelledError:
            call.cancel()
            raise
        except TaskRpcError:
            response = await self._attempts(request, deadline, policy, request_id).result(call)
            return response
        finally:
            if (sequence := call.sequence) == counter.first and not counter.settled:
                counter.first = sequence + 1  # as `settle` does, without a call
            else:
                counter.settle(sequence)
        if self._budget.spent:
            self._budget.earn()
        return response

    def call_async(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> asyncio.Future[ResponseT]:
        """Send the request now; returns a future of the response, with the errors of `call`.

        Cancelling the future cancels the call.
        """
        deadline = self._deadline(timeout)
        policy = self._retry if retry is UNSET else retry
        channel = self._channel
        try:
            # A call of an exactly-once service needs `Attempts`, which settles its request id.
            is_plain = policy is None and not request_id and not channel.store_id
            call = channel.send(request, deadline) if is_plain else None
        except InvalidRequest as error:
            failed = self._loop.create_future()
            failed.set_exception(error)
            return failed
        if call is None:
            attempts = self._attempts(request, deadline, policy, request_id)
            return self._loop.create_task(attempts.result())
        future: asyncio.Future[ResponseT] = call.future
        future.add_done_callback(call.cancel)
        return future

    @property
    def retries(self) -> int:
        """The number of retries of all calls so far."""
        return self._budget.booked

    def destroy(self) -> None:
        """Close the channel; calls in flight still get their responses."""
        self._channel.close()
        self._forget(self)

    def _attempts(
        self,
        request: Any,
        deadline: float | None,
        policy: RetryPolicy | None,
        request_id: str,
    ) -> Attempts:
        return Attempts(
            self._channel, request, deadline, policy, self._budget, self._now, request_id
        )

    def _deadline(self, timeout: float | Unset | None) -> float | None:
        seconds = self._timeout if timeout is UNSET else checked_timeout(timeout)
        return None if seconds is None else self._now() + seconds


def send_in_thread(
    client: Client[Any, Any],
    request: Any,
    timeout: float | Unset | None,
    retry: RetryPolicy | Unset | None,
) -> Waiter | None:
    """Send the request from another thread than the event loop's, for `taskrpc.sync`.

    Returns None if only the event loop can make the call.
    """
    channel = client._thread_channel
    policy = client._retry if retry is UNSET else retry
    if channel is None or policy is not None:
        return None
    left = client._left if timeout is UNSET else 0
    return channel.send_in_thread(request, client._deadline(timeout), left)


def send_in_thread_then(
    client: Client[Any, Any], request: Any, timeout: float | Unset | None, on_done: OnDone
) -> CallbackWaiter | None:
    """Do as `send_in_thread`, but call `on_done(response, error)` at the end instead of waiting."""
    channel = client._thread_channel
    if channel is None or client._retry is not None:
        return None
    left = client._left if timeout is UNSET else 0
    return channel.send_in_thread_then(request, client._deadline(timeout), on_done, left)


def checked_timeout(timeout: float | None, what: str = "timeout") -> float | None:
    """Return a timeout. Raises ValueError if it is neither finite seconds nor None."""
    if timeout is None:
        return None
    try:
        finite = math.isfinite(timeout)
    except TypeError:
        finite = False
    if not finite:
        raise ValueError(f"{what}: expected seconds, or None for no deadline, got {timeout!r}")
    return timeout


_span: ContextVar[bytes] = ContextVar("taskrpc_span", default=b"")
"""The trace span of the call whose request is being sent."""


class ObservedClient(Client[RequestT, ResponseT]):
    """A client that reports each call to its node's observer."""

    def __init__(self, observer: Observer, *settings: Any, **more: Any) -> None:
        super().__init__(*settings, **more)
        self._observer = observer
        self._channel.span_of = _span.get
        self._thread_channel = None  # observers are called on the event loop

    async def call(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> ResponseT:
        """Call the service; see `Client.call`."""
        began = self._begin()
        token = _span.set(began.span)
        try:
            response = await super().call(request, timeout, retry, request_id)
        except BaseException as error:
            began.end(_code(error))
            raise
        finally:
            with contextlib.suppress(ValueError):  # garbage collection uses another context
                _span.reset(token)
        began.end(Code.OK)
        return response

    def call_async(
        self,
        request: RequestT,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> asyncio.Future[ResponseT]:
        """Send the request now; see `Client.call_async`."""
        began = self._begin()
        token = _span.set(began.span)
        try:
            future = super().call_async(request, timeout, retry, request_id)
        finally:
            _span.reset(token)
        future.add_done_callback(began.done)
        return future

    def _begin(self) -> _ObservedCall:
        return _ObservedCall(self._observer, self.service_name, self._now)


class _ObservedCall:
    """One call that is reported to an observer."""

    def __init__(self, observer: Observer, service: str, now: Callable[[], float]) -> None:
        self._observer, self._service = observer, service
        self._now = now
        self._began = now()
        from taskrpc.core.observer import call_observer  # only nodes with an observer need it

        self._call_observer = call_observer
        self._outgoing = call_observer(observer.request_began, service)
        self.span = b"" if self._outgoing is None else self._outgoing.span

    def end(self, code: Code) -> None:
        seconds = self._now() - self._began
        if self._outgoing is not None:
            self._call_observer(self._outgoing.ended, code, seconds)
        self._call_observer(self._observer.request_ended, self._service, code, seconds)

    def done(self, future: asyncio.Future[Any]) -> None:
        error = asyncio.CancelledError() if future.cancelled() else future.exception()
        self.end(Code.OK if error is None else _code(error))


def _code(error: BaseException) -> Code:
    if isinstance(error, TaskRpcError):
        return code_of(error)
    return Code.CANCELLED if isinstance(error, asyncio.CancelledError) else Code.UNKNOWN
