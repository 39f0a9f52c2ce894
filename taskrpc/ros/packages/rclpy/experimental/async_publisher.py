"""Publishers of an AsyncNode."""

from __future__ import annotations

from collections.abc import Callable

from .._impl.execution.async_entity import no_action
from ..publisher import MsgT, Publisher


class AsyncPublisher(Publisher[MsgT]):
    """Publishes messages; `AsyncNode.create_publisher` creates it."""

    forget: Callable[[], object] = staticmethod(no_action)
    """Removes it from its node."""

    def destroy(self) -> None:
        """Stop publishing; a second call does nothing."""
        super().destroy()
        self.forget()

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()
