"""What programs want to know of the quality of a topic's service; taken, and never reported here.

Deadlines, leases and matches are not watched by this layer; a program that asks for them runs as
on a network where nothing of the kind happens, and is told so once in its log.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from .exceptions import UnsupportedEventTypeError

Callback = Callable[[Any], Any] | None


@dataclasses.dataclass(kw_only=True)
class SubscriptionEventCallbacks:
    """Callbacks for events of a subscription."""

    deadline: Callback = None
    incompatible_qos: Callback = None
    liveliness: Callback = None
    message_lost: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


@dataclasses.dataclass(kw_only=True)
class PublisherEventCallbacks:
    """Callbacks for events of a publisher."""

    deadline: Callback = None
    liveliness: Callback = None
    incompatible_qos: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


def wanted(callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks | None) -> list[str]:
    """The names of the events that a program asks for."""
    if callbacks is None:
        return []
    asked = dataclasses.asdict(callbacks)
    return [name for name, callback in asked.items() if callable(callback)]


__all__ = [
    "PublisherEventCallbacks",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
    "wanted",
]
