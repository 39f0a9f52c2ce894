"""Simulated processes: what runs in one can be made to vanish, as by `kill -9`."""

from __future__ import annotations

import asyncio
from contextvars import ContextVar

from taskrpc.tasks.store import MemoryStore
from taskrpc.transport.shared import _endpoints

_inside: ContextVar[Process | None] = ContextVar("process", default=None)


class Process:
    """Everything that is started inside `enter` belongs to it, and so do the tasks of these."""

    def __init__(self, name):
        self.name = name
        self.is_dead = False
        self._tasks = []

    def run(self, coroutine):
        """Start a coroutine as this process's."""
        token = _inside.set(self)
        try:
            return asyncio.ensure_future(coroutine)
        finally:
            _inside.reset(token)

    def kill(self, endpoint):
        """Vanish: connections end without a word, nothing that ran goes on."""
        self.is_dead = True
        if endpoint is not None:
            # Nobody is told, and nothing is withdrawn in order: the system does that for the dead.
            endpoint.network._hub.listeners.pop(endpoint.address, None)
            endpoint.network._hub.rosters.pop(endpoint.network, None)
            endpoint.network._hub.changed()
            for connection in endpoint._connections():
                if connection.transport is not None:
                    connection.transport.abort()
            endpoint._closed = True
        for task in self._tasks:
            task.cancel()

    def joined(self, task):
        """A task was begun here."""
        self._tasks.append(task)


def task_factory(loop, coroutine, **options):
    """Notes to which process a task belongs."""
    task = asyncio.Task(coroutine, loop=loop, **options)
    process = _inside.get()
    if process is not None:
        process.joined(task)
    return task


def endpoint_of(token):
    """The endpoint of the nodes that were made with this token."""
    endpoints = _endpoints.get(asyncio.get_running_loop(), {})
    return next((each for key, each in endpoints.items() if key[4] == token), None)


class Disk:
    """What survives: a store that takes its time, and is torn from the hands of the dead."""

    def __init__(self, chance, counts):
        self.kept = MemoryStore()
        self._chance = chance
        self._counts = counts

    def opened_by(self, process):
        """The store as a process sees it."""
        return _Opened(self, process)

    async def take_time(self):
        await asyncio.sleep(self._chance.choice((0.0, 0.001, 0.02, 0.1)))


class _Opened:
    """A process's hand on a disk."""

    def __init__(self, disk, process):
        self._disk = disk
        self._process = process

    async def load(self):
        return await self._disk.kept.load()

    async def apply(self, *change):
        await self._change(lambda: self._disk.kept.apply(*change))

    async def remember_pause(self, paused):
        await self._change(lambda: self._disk.kept.remember_pause(paused))

    async def clear(self):
        await self._change(self._disk.kept.clear)

    async def close(self):
        pass

    async def _change(self, change):
        disk, counts = self._disk, self._disk._counts
        await disk.take_time()
        if self._process.is_dead:
            counts["crashes before a commit"] += 1
            raise asyncio.CancelledError
        await change()
        await disk.take_time()
        if self._process.is_dead:
            counts["crashes after a commit"] += 1
            raise asyncio.CancelledError
