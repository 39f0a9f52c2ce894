"""Which callback runs on which thread: asked by what explains a deadlock."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, NamedTuple

from .entity import Entity

if TYPE_CHECKING:
    from ...executors import Executor


class Callback(NamedTuple):
    """A callback that is running now."""

    entity: Entity | None
    """What it belongs to; None for a task and a future's done callback."""
    executor: Executor
    since: float
    """When it began, on `time.monotonic()`'s clock."""


running: dict[int, Callback] = {}
"""The innermost callback of every thread that runs one, by the thread's identifier."""


def current_callback() -> Callback | None:
    """The callback that runs on this thread, if one does."""
    return running.get(threading.get_ident())


def is_busy(executor: Executor | None) -> bool:
    """Whether a callback of this executor runs on some thread."""
    return any(callback.executor is executor for callback in list(running.values()))


def started(entity: Entity | None, executor: Executor) -> Callback | None:
    """Note that a callback begins on this thread; what ran here before, for `ended`."""
    thread = threading.get_ident()
    before = running.get(thread)
    running[thread] = Callback(entity, executor, time.monotonic())
    return before


def ended(before: Callback | None) -> None:
    """Note that it has ended, or waits for something and lets the thread go."""
    thread = threading.get_ident()
    if before is None:
        running.pop(thread, None)
    else:
        running[thread] = before
