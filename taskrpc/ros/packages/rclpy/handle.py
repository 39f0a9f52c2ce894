"""Handles of nodes, clients, services and others; a handle is invalid after the destruction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

from .exceptions import InvalidHandle


class Handle:
    """Stands for the object that ROS keeps behind a Python object; `with` checks its validity."""

    def __init__(self, owner: Any = None) -> None:
        self.owner = owner
        self.valid = True
        """Whether it was not destroyed. An attribute: executors read it often."""

    @property
    def pointer(self) -> int:
        """A number that identifies the handle while it exists."""
        return id(self)

    def destroy_when_not_in_use(self) -> None:
        """Make it invalid: entering it later raises InvalidHandle."""
        self.valid = False

    def check(self) -> None:
        """Raise InvalidHandle when it was destroyed."""
        if not self.valid:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")

    def __enter__(self) -> Self:
        self.check()
        return self

    def __exit__(self, *exc_info: object) -> None:
        """Do nothing: there is nothing to release."""


class ArrivalHandle(Handle):
    """A handle that reports arriving items to a callback at once."""

    def __init__(self, owner: Any = None) -> None:
        super().__init__(owner)
        self._on_new: Callable[[int], object] | None = None
        self._unreported = 0

    def item_arrived(self) -> None:
        """Report one more item; on the thread that received it."""
        if self._on_new is not None:
            self._on_new(1)
        else:
            self._unreported += 1

    def set_on_new_callback(self, callback: Callable[[int], object]) -> None:
        """Call this with the number of new items, on the thread that received them.

        Items that were not reported yet are reported at once.
        """
        self._on_new = callback
        if self._unreported:
            count, self._unreported = self._unreported, 0
            callback(count)

    def clear_on_new_callback(self) -> None:
        """Remove the callback for new items."""
        self._on_new = None
