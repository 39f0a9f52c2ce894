"""A trial whose programs are coroutines with nodes in memory: a check runs on virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import random
import re

from taskrpc import Node
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.variants import Variant

_LOOK = 0.05


class MemoryProgram:
    """A coroutine function that plays a program of a submission: `async def f(program, *args)`."""

    def __init__(self, function, arguments):
        self.output = []
        self._task = asyncio.ensure_future(self._run(function, arguments))

    async def _run(self, function, arguments):
        try:
            await function(self, *arguments)
        except SystemExit as end:
            return end.code or 0
        return 0

    async def wait_for_line(self, pattern, timeout):
        for _ in range(int(timeout / _LOOK)):
            found = (re.search(pattern, line) for line in self.output)
            if line := next(filter(None, found), None):
                return line
            await asyncio.sleep(_LOOK)
        return None

    async def finished(self, timeout):
        await asyncio.wait([self._task], timeout=timeout)
        return self._task.result() if self._task.done() else None

    async def stop(self):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task


class MemoryTrial:
    """A trial; its programs are given by the names of their files."""

    def __init__(self, node, folder, programs, variant):
        self.node = node
        self.folder = folder
        self.variant = variant
        self._functions = programs
        self.programs = []

    async def start(self, file, *arguments, interleaved=False):
        if file not in self._functions:
            raise NotMet(f"a file {file}", "there is none", "did you rename it?")
        self.programs.append(MemoryProgram(self._functions[file], arguments))
        return self.programs[-1]

    async def sleep(self, seconds):
        await asyncio.sleep(seconds)

    def unpredictable(self, lowest, highest):
        return random.randint(lowest, highest)


@contextlib.asynccontextmanager
async def memory_trial(folder, programs, variant=None):
    """Make a trial; its programs end with it."""
    async with Node("check", transport="memory") as node:
        trial = MemoryTrial(node, folder, programs, variant or Variant())
        try:
            yield trial
        finally:
            for program in trial.programs:
                await program.stop()


def check_of(lab, title):
    """Return what runs the check of a title."""
    return next(check.run for check in lab.checks if check.title == title)
