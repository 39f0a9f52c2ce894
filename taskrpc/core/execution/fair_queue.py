"""A fair queue: the callers take turns, and the calls of one caller keep their order."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

_Item = TypeVar("_Item")


class FairQueue(Generic[_Item]):
    """Waiting items in flows, one flow for each caller; `take` serves the flows in turn.

    A caller with a thousand items delays another caller's first item by one item, not by a
    thousand.
    """

    __slots__ = ("_flows", "count")

    def __init__(self) -> None:
        self.count = 0
        """How many items wait."""
        self._flows: OrderedDict[Hashable, deque[_Item]] = OrderedDict()
        """The waiting items by flow; the flow to serve next is the first."""

    def add(self, flow: Hashable, item: _Item) -> None:
        """Add an item at the end of its flow."""
        self.count += 1
        waiting = self._flows.get(flow)
        if waiting is None:
            self._flows[flow] = deque((item,))
        else:
            waiting.append(item)

    def take(self) -> _Item:
        """Remove and return the next item; its flow is then the last to be served."""
        self.count -= 1
        flow, waiting = next(iter(self._flows.items()))
        item = waiting.popleft()
        if waiting:
            self._flows.move_to_end(flow)
        else:
            del self._flows[flow]
        return item

    def take_surplus(self, flow: Hashable) -> _Item | None:
        """Remove and return the newest item of the longest flow.

        Returns None if that is not longer than `flow` would be with one more item.
        """
        waiting = max(self._flows.values(), key=len, default=deque[_Item]())
        if len(waiting) <= len(self._flows.get(flow, ())) + 1:
            return None
        self.count -= 1
        return waiting.pop()

    def remove(self, flow: Hashable, item: _Item) -> None:
        """Remove a waiting item."""
        self._flows[flow].remove(item)
        self.count -= 1
        if not self._flows[flow]:
            del self._flows[flow]

    def remove_all(self, flow: Hashable, unwanted: Callable[[_Item], bool]) -> list[_Item]:
        """Remove a flow's unwanted items, and return them in order."""
        removed = [item for item in self._flows.get(flow, ()) if unwanted(item)]
        for item in removed:
            self.remove(flow, item)
        return removed
