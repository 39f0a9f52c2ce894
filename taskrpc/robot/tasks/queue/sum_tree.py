"""A sorted sequence of weighted values with prefix sums in logarithmic time.

It is a tree whose nodes have a bounded number of children. A node stores the smallest number and
the weight of each child. A changed sum is computed again from its parts, never corrected, so that
rounding errors do not accumulate.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

_WIDTH = 64

_Value = TypeVar("_Value")


class _Node:
    """One node; its `parts` are nodes, in a leaf they are values."""

    __slots__ = ("is_leaf", "numbers", "parts", "weights")

    def __init__(
        self, is_leaf: bool, numbers: list[int], parts: list[Any], weights: list[float]
    ) -> None:
        self.is_leaf = is_leaf
        self.numbers = numbers
        self.parts = parts
        self.weights = weights

    def insert_at(self, at: int, number: int, part: Any, weight: float) -> None:
        self.numbers.insert(at, number)
        self.parts.insert(at, part)
        self.weights.insert(at, weight)

    def remove_at(self, at: int) -> None:
        del self.numbers[at], self.parts[at], self.weights[at]

    def update(self, at: int) -> None:
        """Update the number and weight of a part; remove it if it is empty, split it if full."""
        part = self.parts[at]
        if not part.parts:
            self.remove_at(at)
            return
        if len(part.parts) > _WIDTH:
            right = part.split()
            self.insert_at(at + 1, right.numbers[0], right, sum(right.weights))
        self.numbers[at] = part.numbers[0]
        self.weights[at] = sum(part.weights)

    def split(self) -> _Node:
        """Move the second half into a new node, and return that."""
        half = len(self.parts) // 2
        right = _Node(self.is_leaf, self.numbers[half:], self.parts[half:], self.weights[half:])
        del self.numbers[half:], self.parts[half:], self.weights[half:]
        return right


class SumTree(Generic[_Value]):
    """A sequence of values, sorted by their unique numbers, each with a weight."""

    def __init__(self) -> None:
        self._root = _Node(True, [], [], [])
        self.weight = 0.0
        """The sum of all weights."""
        self._highest = -math.inf
        """No number in the tree is higher. Nearly every task arrives behind all its equals, and
        then the tree needs no search."""

    def __bool__(self) -> bool:
        return bool(self._root.parts)

    def insert(self, number: int, value: _Value, weight: float) -> None:
        """Add a value; its number must be new."""
        if number > self._highest:  # noqa: PLR1730 (calling max costs more)
            self._highest = number
        leaf, path = self._leaf(number)
        leaf.insert_at(bisect_left(leaf.numbers, number), number, value, weight)
        self._update(path)

    def remove(self, number: int) -> _Value:
        """Remove and return a value; raises KeyError if its number is not there."""
        leaf, at, path = self._find(number)
        value: _Value = leaf.parts[at]
        leaf.remove_at(at)
        self._update(path)
        return value

    def weigh(self, number: int, weight: float) -> None:
        """Set the weight of a value; raises KeyError if its number is not there."""
        leaf, at, path = self._find(number)
        leaf.weights[at] = weight
        self._update(path)

    def before(self, number: int) -> _Value | None:
        """Return the last value with a smaller number, None if there is none."""
        if number > self._highest:
            return self.last() if self else None
        leaf, _ = self._leaf(number - 1)
        at = bisect_left(leaf.numbers, number)
        value: _Value | None = leaf.parts[at - 1] if at else None
        return value

    def last(self) -> _Value:
        """Return the last value; the tree must not be empty."""
        node = self._root
        while not node.is_leaf:
            node = node.parts[-1]
        value: _Value = node.parts[-1]
        return value

    def weight_through(self, number: int) -> float:
        """Return the weight of all values up to this number."""
        if number >= self._highest:
            return self.weight
        leaf, path = self._leaf(number)
        ahead = sum(sum(node.weights[:at]) for node, at in path)
        return ahead + sum(leaf.weights[: bisect_right(leaf.numbers, number)])

    def behind(self, number: float) -> Iterator[_Value]:
        """Iterate over the values with greater numbers; weights may change during the iteration."""
        if number >= self._highest:
            return
        leaf, path = self._leaf(number)
        yield from leaf.parts[bisect_right(leaf.numbers, number) :]
        for node, at in reversed(path):
            for part in node.parts[at + 1 :]:
                yield from _values(part)

    def _leaf(self, number: float) -> tuple[_Node, list[tuple[_Node, int]]]:
        """Return the leaf for a number, and the path to it from the root."""
        node, path = self._root, []
        while not node.is_leaf:
            at = bisect_right(node.numbers, number) - 1
            if at < 0:  # noqa: PLR1730 (calling max costs as much as the rest)
                at = 0
            path.append((node, at))
            node = node.parts[at]
        return node, path

    def _find(self, number: int) -> tuple[_Node, int, list[tuple[_Node, int]]]:
        leaf, path = self._leaf(number)
        at = bisect_left(leaf.numbers, number)
        if at == len(leaf.numbers) or leaf.numbers[at] != number:
            raise KeyError(number)
        return leaf, at, path

    def _update(self, path: list[tuple[_Node, int]]) -> None:
        for node, at in reversed(path):
            node.update(at)
        root = self._root
        if len(root.parts) > _WIDTH:
            above = _Node(False, [root.numbers[0]], [root], [0.0])
            above.update(0)
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
