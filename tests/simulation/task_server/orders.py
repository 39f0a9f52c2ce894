"""The operator's orders, the responses to them, and their consequences.

Each order took effect at one instant between request and response. Without a response it took
effect later or never. A check must hold for every possible instant.
"""

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

    def may_concern(self, disk) -> bool:
        """Whether the order may have changed the tasks of a disk."""
        return self.done is not False and self.first_disk <= disk.number <= self.last_disk

    def surely_concerns(self, disk) -> bool:
        """Whether a response confirms that the order changed the tasks of a disk."""
        return self.done is True and self.first_disk == disk.number == self.last_disk


class Orders:
    """All orders of a run."""

    def __init__(self, ledger):
        self._ledger = ledger
        self._given: dict[int, Order] = {}

    def given(self, number, verb, task_id, priority, now, disk):
        self._given[number] = Order(verb, task_id, priority, now, disk)

    def told(self, number, done, now, disk):
        """Read a response; `done` is its result, None without a response."""
        order = self._given[number]
        order.done = done
        if done is not None:
            order.told, order.last_disk = now, disk
        if done:
            self._ledger.counts[f"{order.verb}s"] += 1

    def begins(self, disk, task, now):
        """The worker of a disk begins a task."""
        for order in self._given.values():
            if not order.surely_concerns(disk) or order.told >= now:
                continue
            if order.verb in HALTS and not self._undone(order, disk, "resume", now):
                self._ledger.broke("began while paused", task.task_id)
            is_off = order.verb in CALLS_OFF and order.task_id == task.task_id
            if is_off and not self._undone(order, disk, "requeue", now):
                self._ledger.broke("began although called off", task.task_id)

    def compare(self, disk):
        """Compare the orders with the tasks on a disk at the end."""
        for task in disk.tasks:
            mine = [each for each in self._given.values() if each.task_id == task.task_id]
            requeues = sum(each.verb == "requeue" and each.may_concern(disk) for each in mine)
            if disk.requeues[task.task_id] > requeues:
                self._ledger.broke("ran twice", f"task {task.task_id} was queued again unasked")
            moves = [each for each in mine if each.verb == "reprioritise"]
            moves = [each for each in moves if each.may_concern(disk)]
            sure = [each for each in moves if each.surely_concerns(disk)]
            possible = {
                each.priority
                for each in moves
                if not any(other.asked > each.told for other in sure)
            }
            if sure and task.priority not in possible:
                self._ledger.broke("lost", f"priority of {task.task_id}: not {task.priority}")

    def _undone(self, order, disk, verb, now):
        """Whether a later order may have undone this one."""
        return any(
            other.verb == verb
            and other.may_concern(disk)
            and other.told > order.asked
            and other.asked <= now
            and (verb == "resume" or other.task_id == order.task_id)
            for other in self._given.values()
        )
