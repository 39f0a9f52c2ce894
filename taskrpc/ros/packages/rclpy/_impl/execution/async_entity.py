"""Entities of an AsyncNode: a task of asyncio runs their callbacks, without an executor."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
from collections.abc import Awaitable, Callable
from typing import Any

from .entity import Entity


def no_action() -> None:
    """Do nothing."""


class AsyncEntity(Entity):
    """A mixin before a class of entities: runs their callbacks on an event loop of asyncio.

    It ends with `destroy`, with the exception of a callback, and with the task group of its node.
    """

    concurrent = False
    """Whether a callback may begin while another one of this entity awaits something."""

    forget: Callable[[], object] = staticmethod(no_action)
    """Removes the entity from its node."""

    _task: asyncio.Task[None] | None = None
    _loop: asyncio.AbstractEventLoop | None = None
    _arrived: asyncio.Event

    def start(self, group: asyncio.TaskGroup) -> None:
        """Run the callbacks from now on, in a task of this group."""
        self._arrived = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._task = group.create_task(self._run())

    def notify_executor(self) -> None:
        """Wake the task; from any thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._arrived.set)

    def destroy(self) -> None:
        """Cancel the callbacks and withdraw the entity; a second call does nothing."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
        entity: Any = super()  # the class after this mixin
        entity.destroy()
        self.forget()

    async def _run(self) -> None:
        try:
            if self.concurrent:
                async with asyncio.TaskGroup() as running:
                    await self._take_all(lambda call: _created(running, call))
            else:
                await self._take_all(_finished)
        finally:
            self._task = None
            self.destroy()

    async def _take_all(self, run: Callable[[Callable[[], Any]], Awaitable[object]]) -> None:
        """Run all items in the order of their arrival, until the entity is destroyed."""
        entity: Any = self
        while entity.handle.valid:
            if not self.has_work():
                await self._until_notified()
            elif (call := self.take_work()) is not None:
                await run(call)
                await asyncio.sleep(0)  # other tasks run although more items wait

    async def _until_notified(self) -> None:
        """Wait for an item or another change, and for a timer until it is due."""
        self._arrived.clear()
        if self.has_work():  # it arrived before `clear`
            return
        left = self.seconds_until_due()
        loop = asyncio.get_running_loop()
        alarm = None if left is None else loop.call_later(left, self._arrived.set)
        try:
            await self._arrived.wait()
        finally:
            if alarm is not None:
                alarm.cancel()

    def seconds_until_due(self) -> float | None:
        """For a timer: the time until it is due; None if nothing but a change makes it due."""
        return None


async def _finished(call: Callable[[], Any]) -> None:
    """Call a function, and await its result if it is a coroutine function."""
    result = call()
    if inspect.isawaitable(result):
        await result


async def _created(running: asyncio.TaskGroup, call: Callable[[], Any]) -> None:
    running.create_task(_finished(call))
