"""A client of a node with an observer, which learns what became of each call."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from taskrpc.client import UNSET, Client, Unset
from taskrpc.errors import Code, TaskRpcError
from taskrpc.observer import Observer, told
from taskrpc.retry import RetryPolicy
from taskrpc.transport.base import WaitingThread
from taskrpc.wire.status import code_of


class ObservedClient(Client):
    """Calls one service and tells its observer; all else is `Client`'s."""

    def __init__(self, observer: Observer, *settings: Any, **more: Any) -> None:
        super().__init__(*settings, **more)
        self._observer = observer

    async def call(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> Any:
        """Call the service; see `Client.call`."""
        tell = self._stopwatch()
        try:
            response = await super().call(request, timeout, retry, request_id)
        except BaseException as error:
            tell(_code(error))
            raise
        tell(Code.OK)
        return response

    def call_async(
        self,
        request: Any,
        timeout: float | Unset | None = UNSET,
        retry: RetryPolicy | Unset | None = UNSET,
        request_id: str = "",
    ) -> asyncio.Future[Any]:
        """Send the request now; see `Client.call_async`."""
        future = super().call_async(request, timeout, retry, request_id)
        future.add_done_callback(partial(_done, self._stopwatch()))
        return future

    def _send_in_thread(
        self,
        request: Any,
        timeout: float | Unset | None,
        retry: RetryPolicy | Unset | None,
    ) -> WaitingThread | None:
        return None  # the loop calls, on which the observer must be told

    def _stopwatch(self) -> Callable[[Code], None]:
        """Start it; to stop it is to tell the observer."""
        began = self._now()
        return lambda code: told(
            self._observer.request_ended, self.service_name, code, self._now() - began
        )


def _done(tell: Callable[[Code], None], future: asyncio.Future[Any]) -> None:
    error = asyncio.CancelledError() if future.cancelled() else future.exception()
    tell(Code.OK if error is None else _code(error))


def _code(error: BaseException) -> Code:
    if isinstance(error, TaskRpcError):
        return code_of(error)
    return Code.CANCELLED if isinstance(error, asyncio.CancelledError) else Code.UNKNOWN
