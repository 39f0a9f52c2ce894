"""Decides which messages of several queues belong together, by their times in nanoseconds.

A queue is a dict from the time of a message to the message.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, TypeAlias

Queue: TypeAlias = dict[int, Any]


def put(queue: Queue, time: int, message: Any, size: int) -> None:
    """Add a message; the oldest ones leave a queue of more than `size` messages."""
    queue[time] = message
    while len(queue) > size:
        del queue[min(queue)]


def take_equal(queues: Sequence[Queue]) -> Iterator[tuple[Any, ...]]:
    """Take the messages whose time occurs in all queues, the oldest set first."""
    for time in sorted(set.intersection(*map(set, queues))):
        yield tuple(queue.pop(time) for queue in queues)


def take_near(queues: Sequence[Queue], time: int, index: int, slop: int) -> tuple[Any, ...]:
    """Take the messages nearest to a new one; () if no set of messages is near enough.

    Args:
        time: the time of the new message, which is in the queue `index`.
        slop: the messages of a set differ by less than this.
    """
    near = [
        [time] if one == index else _nearest(queue, time, slop) for one, queue in enumerate(queues)
    ]
    for times in product(*near):
        if max(times) - min(times) < slop:
            return tuple(queue.pop(each) for queue, each in zip(queues, times, strict=True))
    return ()


def _nearest(queue: Queue, time: int, slop: int) -> list[int]:
    """The times in a queue within the slop, the nearest first."""
    within = [each for each in queue if abs(each - time) <= slop]
    return sorted(within, key=lambda each: abs(each - time))
