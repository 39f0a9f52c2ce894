"""Clients of an AsyncNode."""

from __future__ import annotations

import asyncio
from functools import partial

from .._impl.execution.async_entity import AsyncEntity
from ..client import Client, SrvRequestT, SrvResponseT
from ..task import Future


class AsyncClient(AsyncEntity, Client[SrvRequestT, SrvResponseT]):
    """Calls one service; `AsyncNode.create_client` creates it."""

    async def call(  # type: ignore[override]  # as in ROS, it has the name of the blocking method
        self, request: SrvRequestT
    ) -> SrvResponseT:
        """Send a request and wait for the response; for a timeout, use `asyncio.timeout`.

        The node must run. While the service has no server, the request waits for one. `destroy`
        cancels the call. Raises RuntimeError after `destroy`, TypeError for a request of another
        type, InvalidRequest for a value that does not fit its field, HandlerFailed when the
        callback of the service raised an exception.
        """
        if not self.handle.valid:
            raise RuntimeError("Calling a destroyed client is forbidden")
        response: asyncio.Future[SrvResponseT] = asyncio.get_running_loop().create_future()
        sent = self.call_async(request)
        sent.when_done(partial(_pass_on, sent, response))
        try:
            return await response
        finally:
            sent.cancel()  # does nothing after the response

    async def wait_for_service(  # type: ignore[override]
        self, *, check_interval: float = 0.1
    ) -> None:
        """Wait for a server of the service; looks for one every `check_interval` seconds."""
        while not self.service_is_ready():  # noqa: ASYNC110 - no Event of this loop tells
            await asyncio.sleep(check_interval)

    def destroy(self) -> None:
        """Cancel the calls and release the service; a second call does nothing."""
        for pending in self.pending_futures:
            pending.cancel()
        super().destroy()

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()


def _pass_on(sent: Future[SrvResponseT], response: asyncio.Future[SrvResponseT]) -> None:
    """Complete the future of asyncio as the call ended; on the thread of the event loop."""
    if response.done():
        return
    if sent.cancelled():
        response.cancel()
    elif (error := sent.exception()) is not None:
        response.set_exception(error)
    else:
        response.set_result(sent.result())  # type: ignore[arg-type]  # None only while pending
