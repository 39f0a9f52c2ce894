"""Services of an AsyncNode."""

from __future__ import annotations

from .._impl.execution.async_entity import AsyncEntity
from ..service import Service, SrvRequestT, SrvResponseT


class AsyncService(AsyncEntity, Service[SrvRequestT, SrvResponseT]):
    """Answers requests on the event loop; `AsyncNode.create_service` creates it.

    While a callback awaits something, further requests wait.
    """

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()
