"""Subscriptions of an AsyncNode."""

from __future__ import annotations

from .._impl.execution.async_entity import AsyncEntity
from ..subscription import MsgT, Subscription


class AsyncSubscription(AsyncEntity, Subscription[MsgT]):
    """Receives messages on the event loop; `AsyncNode.create_subscription` creates it.

    While a callback awaits something, further messages wait, as many as the depth of the profile.
    """

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()
