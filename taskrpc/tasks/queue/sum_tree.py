"""Values in the order of their numbers, each with a weight; every question takes logarithmic time.

A tree of nodes with a bounded number of parts; a node knows the least number and the weight of each
part. Sums are made anew from their parts, never corrected, so that no rounding error piles up.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

_WIDTH = 64

_Value = TypeVar("_Value")


class _Node:
    """`parts` are nodes, in a leaf values."""

    __slots__ = ("is_leaf", "numbers", "parts", "weights")

    def __init__(
        self, is_leaf: bool, numbers: list[int], parts: list[Any], weights: list[float]
    ) -> None:
        self.is_leaf = is_leaf
        self.numbers = numbers
        self.parts = parts
        self.weights = weights

    def put(self, at: int, number: int, part: Any, weight: float) -> None:
        self.numbers.insert(at, number)
        self.parts.insert(at, part)
        self.weights.insert(at, weight)

    def drop(self, at: int) -> None:
        del self.numbers[at], self.parts[at], self.weights[at]

    def renew(self, at: int) -> None:
        """Bring what is known of a part up to date; an empty one goes, a full one splits."""
        part = self.parts[at]
        if not part.parts:
            self.drop(at)
            return
        if len(part.parts) > _WIDTH:
            right = part.split()
            self.put(at + 1, right.numbers[0], right, sum(right.weights))
        self.numbers[at] = part.numbers[0]
        self.weights[at] = sum(part.weights)

    def split(self) -> _Node:
        """Give the second half away."""
        half = len(self.parts) // 2
        right = _Node(self.is_leaf, self.numbers[half:], self.parts[half:], self.weights[half:])
        del self.numbers[half:], self.parts[half:], self.weights[half:]
        return right


class SumTree(Generic[_Value]):
    """A sorted sequence of values; `number` is a value's place in the order and its name."""

    def __init__(self) -> None:
        self._root = _Node(True, [], [], [])
        self.weight = 0.0
        """The weight of all."""
        self._highest = -math.inf
        """No number that is there is higher: nearly every task comes behind all its equals, and
        then needs no search."""

    def __bool__(self) -> bool:
        return bool(self._root.parts)

    def insert(self, number: int, value: _Value, weight: float) -> None:
        """Add a value whose number is not there."""
        if number > self._highest:  # noqa: PLR1730 (calling max costs more)
            self._highest = number
        leaf, way = self._leaf(number)
        leaf.put(bisect_left(leaf.numbers, number), number, value, weight)
        self._renew(way)

    def remove(self, number: int) -> _Value:
        """Take a value out. Raises KeyError."""
        leaf, at, way = self._found(number)
        value: _Value = leaf.parts[at]
        leaf.drop(at)
        self._renew(way)
        return value

    def weigh(self, number: int, weight: float) -> None:
        """Give a value another weight. Raises KeyError."""
        leaf, at, way = self._found(number)
        leaf.weights[at] = weight
        self._renew(way)

    def before(self, number: int) -> _Value | None:
        """The last value whose number is smaller, None if there is none."""
        if number > self._highest:
            return self.last() if self else None
        leaf, _ = self._leaf(number - 1)
        at = bisect_left(leaf.numbers, number)
        value: _Value | None = leaf.parts[at - 1] if at else None
        return value

    def last(self) -> _Value:
        """The last value of a sequence that has one."""
        node = self._root
        while not node.is_leaf:
            node = node.parts[-1]
        value: _Value = node.parts[-1]
        return value

    def weight_through(self, number: int) -> float:
        """The weight of all values up to this number."""
        if number >= self._highest:
            return self.weight
        leaf, way = self._leaf(number)
        ahead = sum(sum(node.weights[:at]) for node, at in way)
        return ahead + sum(leaf.weights[: bisect_right(leaf.numbers, number)])

    def behind(self, number: int) -> Iterator[_Value]:
        """Iterate over the values whose numbers are greater; weights may change meanwhile."""
        if number >= self._highest:
            return
        leaf, way = self._leaf(number)
        yield from leaf.parts[bisect_right(leaf.numbers, number) :]
        for node, at in reversed(way):
            for part in node.parts[at + 1 :]:
                yield from _values(part)

    def _leaf(self, number: int) -> tuple[_Node, list[tuple[_Node, int]]]:
        """The leaf that a number belongs to, and the way to it from the root."""
        node, way = self._root, []
        while not node.is_leaf:
            at = bisect_right(node.numbers, number) - 1
            if at < 0:  # noqa: PLR1730 (calling max costs as much as the rest)
                at = 0
            way.append((node, at))
            node = node.parts[at]
        return node, way

    def _found(self, number: int) -> tuple[_Node, int, list[tuple[_Node, int]]]:
        leaf, way = self._leaf(number)
        at = bisect_left(leaf.numbers, number)
        if at == len(leaf.numbers) or leaf.numbers[at] != number:
            raise KeyError(number)
        return leaf, at, way

    def _renew(self, way: list[tuple[_Node, int]]) -> None:
        for node, at in reversed(way):
            node.renew(at)
        root = self._root
        if len(root.parts) > _WIDTH:
            above = _Node(False, [root.numbers[0]], [root], [0.0])
            above.renew(0)
            self._root = above
        while not root.is_leaf and len(root.parts) <= 1:
            root = self._root = root.parts[0] if root.parts else _Node(True, [], [], [])
        self.weight = sum(self._root.weights)


def _values(node: _Node) -> Iterator[Any]:
    if node.is_leaf:
        yield from node.parts
    else:
        for part in node.parts:
            yield from _values(part)
