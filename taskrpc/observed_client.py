"""A client of a node with an observer, which learns what became of each call."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

from taskrpc.client import UNSET, Client, Unset
from taskrpc.errors import Code, TaskRpcError
from taskrpc.message_types import RequestT, ResponseT
from taskrpc.observer import Observer, told
from taskrpc.retry import RetryPolicy
from taskrpc.transport.base import Tell, WaitingThread
from taskrpc.wire.status import code_of

_span: ContextVar[bytes] = ContextVar("taskrpc_span", default=b"")
"""Of the call whose request is being sent, each time that it is."""


class ObservedClient(Client[RequestT, ResponseT]):
    """Calls one service and tells its observer; all else is `Client`'s."""

    def __init__(self, observer: Observer, *settings: Any, **more: Any) -> None:
        super().__init__(*settings, **more)
        self._observer = observer
        self._channel.span_of = _span.get

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
            with contextlib.suppress(ValueError):  # closed by the garbage collector, elsewhere
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

    def _send_in_thread(
        self,
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
    ) -> WaitingThread | None:
        return None  # the loop calls, on which the observer must be told

    def _tell_in_thread(self, request: Any, timeout: float | Unset | None, tell: Tell) -> None:
        return None

    def _begin(self) -> _Begun:
        return _Begun(self._observer, self.service_name, self._now)


class _Begun:
    """One call of which an observer is told."""

    def __init__(self, observer: Observer, service: str, now: Callable[[], float]) -> None:
        self._observer, self._service = observer, service
        self._now = now
        self._began = now()
        self._outgoing = told(observer.request_began, service)
        self.span = b"" if self._outgoing is None else self._outgoing.span

    def end(self, code: Code) -> None:
        seconds = self._now() - self._began
        if self._outgoing is not None:
            told(self._outgoing.ended, code, seconds)
        told(self._observer.request_ended, self._service, code, seconds)

    def done(self, future: asyncio.Future[Any]) -> None:
        error = asyncio.CancelledError() if future.cancelled() else future.exception()
        self.end(Code.OK if error is None else _code(error))


def _code(error: BaseException) -> Code:
    if isinstance(error, TaskRpcError):
        return code_of(error)
    return Code.CANCELLED if isinstance(error, asyncio.CancelledError) else Code.UNKNOWN
