"""Timers of an AsyncNode."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from .._impl.execution.async_entity import AsyncEntity
from ..timer import Timer, TimerInfo


class AsyncTimer(AsyncEntity, Timer):
    """Calls its callback once a period on the event loop; `AsyncNode.create_timer` creates it.

    Periods that pass while a callback awaits something are skipped.
    """

    @property
    def callback(self) -> Callable[..., Any] | None:
        """The callback, without a parameter, or with one for the TimerInfo.

        Setting it raises RuntimeError for a callback with another number of parameters.
        """
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any] | None) -> None:
        self._takes_info = value is not None and _takes_info(value)
        self._callback = value

    def _with_info(self, callback: Callable[..., Any]) -> Callable[[TimerInfo], Any] | None:
        return callback if self._takes_info else None

    def seconds_until_due(self) -> float | None:
        """The time until it is due; None while it is cancelled, and with simulated time."""
        left = self.nanoseconds_until_due()
        return None if left is None else max(0.0, left * 1e-9)

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()


def _takes_info(callback: Callable[..., Any]) -> bool:
    """Whether a callback needs one argument; raises RuntimeError if it needs more."""
    signature = inspect.signature(callback)
    for arguments in ((), (None,)):
        try:
            signature.bind(*arguments)
        except TypeError:
            continue
        return bool(arguments)
    raise RuntimeError("Timer callback must accept zero arguments or one argument (TimerInfo)")
