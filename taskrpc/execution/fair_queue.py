"""Who is next: callers take turns, and what each of them wants is done in order."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

_Item = TypeVar("_Item")


class Turns(Generic[_Item]):
    """Items that wait, each caller's in a lane of its own.

    A caller with a thousand items delays another's first one by one item, not by a thousand.
    """

    __slots__ = ("_lanes", "count")

    def __init__(self) -> None:
        self.count = 0
        """How many items wait."""
        self._lanes: OrderedDict[Hashable, deque[_Item]] = OrderedDict()

    def add(self, lane: Hashable, item: _Item) -> None:
        """Let an item wait behind its lane's others."""
        self.count += 1
        waiting = self._lanes.get(lane)
        if waiting is None:
            self._lanes[lane] = deque((item,))
        else:
            waiting.append(item)

    def take(self) -> _Item:
        """The next item; the lane whose it is goes behind the others."""
        self.count -= 1
        lane, waiting = next(iter(self._lanes.items()))
        item = waiting.popleft()
        if waiting:
            self._lanes.move_to_end(lane)
        else:
            del self._lanes[lane]
        return item

    def take_surplus(self, lane: Hashable) -> _Item | None:
        """The newest item of the longest lane; None if that is no longer than `lane` would be."""
        waiting = max(self._lanes.values(), key=len, default=deque[_Item]())
        if len(waiting) <= len(self._lanes.get(lane, ())) + 1:
            return None
        self.count -= 1
        return waiting.pop()

    def remove(self, lane: Hashable, item: _Item) -> None:
        """An item waits no more."""
        self._lanes[lane].remove(item)
        self.count -= 1
        if not self._lanes[lane]:
            del self._lanes[lane]

    def remove_all(self, lane: Hashable, unwanted: Callable[[_Item], bool]) -> list[_Item]:
        """Remove a lane's unwanted items, and return them in order."""
        removed = [item for item in self._lanes.get(lane, ()) if unwanted(item)]
        for item in removed:
            self.remove(lane, item)
        return removed
