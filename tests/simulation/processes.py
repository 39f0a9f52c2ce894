"""Processes inside one event loop; each can be killed between two iterations."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import inspect
import logging

from taskrpc.testing import VirtualTimeLoop

PROCESS: contextvars.ContextVar[int] = contextvars.ContextVar("process", default=0)
"""0 for the simulation around the processes."""


class SimulatedLoop(VirtualTimeLoop):
    """Knows the process of each callback and task; a killed process never runs again."""

    def __init__(self):
        self._killed: set[int] = set()
        self._buried: list[asyncio.Task] = []
        self._owners: dict[asyncio.Task, int] = {}
        self._processes = 0
        self._is_over = False
        super().__init__()
        self.set_task_factory(self._make_task)

    def start(self, coroutine) -> tuple[int, asyncio.Task]:
        """Run a coroutine as a separate process."""
        self._processes += 1
        context = contextvars.copy_context()
        context.run(PROCESS.set, self._processes)
        return self._processes, self.create_task(coroutine, context=context)

    def kill(self, process: int) -> None:
        """Kill a process: none of its code runs any more, not even `finally`."""
        self._killed.add(process)
        for task, owner in self._owners.items():
            if owner == process:
                task._log_destroy_pending = False
                asyncio.tasks._unregister_task(task)  # a dead process cancels no tasks
                self._buried.append(task)  # else the collector of garbage would run its `finally`
        for handle in [*self._ready, *self._scheduled]:
            self._forget_if_killed(handle)

    def bury(self) -> None:
        """Release the killed processes; anything they still do has no effect."""
        self._is_over = True
        logging.disable(logging.CRITICAL)
        for task in self._buried:
            _close(task.get_coro())
        self._buried.clear()
        self._owners.clear()
        logging.disable(logging.NOTSET)
        self._is_over = False

    def tasks_of_the_living(self) -> list[asyncio.Task]:
        """The pending tasks, without those of the simulation."""
        return [
            task
            for task, owner in self._owners.items()
            if owner and owner not in self._killed and not task.done()
        ]

    def timers_of_the_living(self) -> list[asyncio.TimerHandle]:
        """The scheduled callbacks, without those of the simulation."""
        return [
            handle
            for handle in self._scheduled
            if not handle.cancelled() and handle._context.get(PROCESS, 0)
        ]

    def call_soon(self, callback, *args, context=None):
        return self._forget_if_killed(super().call_soon(callback, *args, context=context))

    def call_at(self, when, callback, *args, context=None):
        return self._forget_if_killed(super().call_at(when, callback, *args, context=context))

    def _forget_if_killed(self, handle):
        if self._is_over or handle._context.get(PROCESS, 0) in self._killed:
            handle.cancel()
        return handle

    def _make_task(self, loop, coroutine, **options):
        context = options.get("context")
        owner = PROCESS.get() if context is None else context.get(PROCESS, 0)
        task = asyncio.Task(coroutine, loop=loop, **options)
        if self._is_over:
            task._log_destroy_pending = False
            asyncio.tasks._unregister_task(task)
            coroutine.close()
        self._owners[task] = owner
        task.add_done_callback(lambda done: self._owners.pop(done, None))
        return task


def _close(coroutine) -> None:
    """End a coroutine now; each `finally` that awaits something is cancelled once more."""
    while inspect.getcoroutinestate(coroutine) != inspect.CORO_CLOSED:
        with contextlib.suppress(BaseException):
            coroutine.close()
