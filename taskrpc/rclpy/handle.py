"""What `.handle` of a node, client, service … is: a name for it that ends with it."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from .exceptions import InvalidHandle


class Handle:
    """Stands for what ROS keeps behind a Python object; `with` checks that it is still there."""

    def __init__(self, owner: Any = None) -> None:
        self._destroyed = False
        self.owner = owner

    @property
    def pointer(self) -> int:
        """A number that no other handle has while this one lives."""
        return id(self)

    @property
    def valid(self) -> bool:
        """Whether it was not destroyed."""
        return not self._destroyed

    def destroy_when_not_in_use(self) -> None:
        """End it: who enters it later is refused."""
        self._destroyed = True

    def check(self) -> None:
        """Raise InvalidHandle when it was destroyed."""
        if self._destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")

    def __enter__(self) -> Self:
        self.check()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Nothing to give back."""


class ArrivalHandle(Handle):
    """A handle of something that things arrive at, which tells a callback so at once."""

    def __init__(self, owner: Any = None) -> None:
        super().__init__(owner)
        self._on_new: Callable[[int], object] | None = None
        self._untold = 0

    def item_arrived(self) -> None:
        """One more has arrived; on the thread that received it."""
        if self._on_new is not None:
            self._on_new(1)
        else:
            self._untold += 1

    def set_on_new_callback(self, callback: Callable[[int], object] | None) -> None:
        """Call this from now on with how many arrived, first with those before it; None: nobody."""
        self._on_new = callback
        if callback is not None and self._untold:
            untold, self._untold = self._untold, 0
            callback(untold)
