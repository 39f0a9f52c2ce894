"""The operators' orders, the responses to them, and their consequences.

Each order took effect at one instant between request and response. Without a response it took
effect later or never. A check must hold for every possible instant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

HALTS, CALLS_OFF = ("pause", "stop"), ("cancel", "drop")


@dataclass
class Order:
    """One order; the numbers of disks limit the tasks that it may concern."""

    verb: str
    task_id: int
    priority: int
    asked: float
    first_disk: int
    told: float = math.inf
    last_disk: float = math.inf
    done: bool | None = None
    """The result in the response; None if the outcome is unknown."""

    def may_concern(self, disk: int) -> bool:
        """Whether the order may have changed the tasks of this disk."""
        return self.done is not False and self.first_disk <= disk <= self.last_disk

    def surely_concerns(self, disk: int) -> bool:
        """Whether a response confirms that the order changed the tasks of this disk."""
        return self.done is True and self.first_disk == disk == self.last_disk


class Orders:
    """All orders of a simulation."""

    def __init__(self, ledger):
        self._ledger = ledger
        self._given: list[Order] = []

    def given(self, verb, task_id, priority, now) -> Order:
        order = Order(verb, task_id, priority, now, self._newest_disk())
        self._given.append(order)
        self._ledger.note(f"order {verb} {task_id} {priority}")
        return order

    def told(self, order, done, now) -> None:
        """Record a response; `done` is its result, None without a response."""
        order.done = done
        if done is not None:
            order.told, order.last_disk = now, self._newest_disk()
        if done:
            self._ledger.counts[f"{order.verb}s"] += 1
        self._ledger.note(f"order {order.verb} {order.task_id} {done}")

    def begins(self, disk, task, now) -> None:
        """Record that the worker of a disk starts a task."""
        for order in self._given:
            if not order.surely_concerns(disk) or order.told >= now:
                continue
            if order.verb in HALTS and not self._undone(order, disk, "resume", now):
                self._ledger.broke("began while paused", task.task_id)
            is_off = order.verb in CALLS_OFF and order.task_id == task.task_id
            if is_off and not self._undone(order, disk, "requeue", now):
                self._ledger.broke("began although called off", task.task_id)

    def compare(self, disk, tasks) -> None:
        """Compare the orders with the tasks on a disk at the end."""
        for task in tasks:
            mine = [order for order in self._given if order.task_id == task.task_id]
            requeues = sum(o.verb == "requeue" and o.may_concern(disk.number) for o in mine)
            if disk.requeues[task.task_id] > requeues:
                self._ledger.broke("ran twice", f"task {task.task_id} was queued again unasked")
            moves = [o for o in mine if o.verb == "reprioritise" and o.may_concern(disk.number)]
            sure = [order for order in moves if order.surely_concerns(disk.number)]
            possible = {
                order.priority
                for order in moves
                if not any(other.asked > order.told for other in sure)
            }
            if sure and task.priority not in possible:
                self._ledger.broke("lost", f"priority of {task.task_id}: not {task.priority}")

    def _undone(self, order, disk, verb, now) -> bool:
        """Whether a later order may have undone this one."""
        return any(
            other.verb == verb
            and other.may_concern(disk)
            and other.told > order.asked
            and other.asked <= now
            and (verb == "resume" or other.task_id == order.task_id)
            for other in self._given
        )

    def _newest_disk(self) -> int:
        return len(self._ledger.disks) - 1
