"""An event of the live page with its time, as recordings contain it."""

from typing import Any

import msgspec


class TimedEvent(msgspec.Struct, frozen=True):
    """An event of the live page, with its time."""

    t: float
    """Seconds since 1970."""
    event: str
    """Its name, such as `tasks`."""
    data: dict[str, Any]
