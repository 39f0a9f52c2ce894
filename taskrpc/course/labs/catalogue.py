"""All labs by their numbers."""

from __future__ import annotations

from taskrpc.course.labs.checks import lab1, lab2, lab3, lab4, lab5, lab6
from taskrpc.course.labs.lab import Lab
from taskrpc.errors import TaskRpcError

LABS: tuple[Lab, ...] = (lab1.LAB, lab2.LAB, lab3.LAB, lab4.LAB, lab5.LAB, lab6.LAB)


def lab(number: int) -> Lab:
    """Return a lab; raises TaskRpcError if there is no such number."""
    for each in LABS:
        if each.number == number:
            return each
    titles = ", ".join(f"{each.number} ({each.title})" for each in LABS)
    raise TaskRpcError(f"there is no lab {number}; expected one of {titles}")
