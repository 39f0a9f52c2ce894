"""A running program of a submission, seen from the checks: its output, its end, its limits."""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
import signal
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from taskrpc.course.labs.sandbox import boot, speed
from taskrpc.course.labs.sandbox.child import Start, environment
from taskrpc.course.labs.sandbox.limits import LIMITS, MEGABYTE
from taskrpc.ros.process_tree import ProcessTree

_END = 5.0
"""Seconds that a program has to end after Ctrl-C."""
_LONGEST_LINE = 2000
_START = 30.0
"""Real seconds that a new Python may need to import taskrpc."""
_POLL = 0.01
_LOOK = 1.0
"""Seconds between two looks at what the programs use."""
_CPU_EXCEEDED = {-24, -9}  # SIGXCPU, SIGKILL

Written = Callable[[int, bytes], None]
"""Gets 1 or 2 for the stream, and what a program has written to it."""


class Process(Protocol):
    """A process that runs a program."""

    async def wait(self) -> int:
        """Wait for its end and its output; the exit code, negative after a signal."""

    def send_signal(self, number: int) -> None:
        """Send a signal to it and to its descendants, if there are any."""

    def kill(self) -> None:
        """End it and its descendants at once."""

    def write(self, data: bytes) -> None:
        """Write to its standard input; one that does not read is ended."""


class Starter(Protocol):
    """What starts processes for a trial."""

    async def start(self, start: Start, on_output: Written) -> Process:
        """Start a program."""

    def excess(self) -> str:
        """Return which limit the programs of the trial exceed together, "" if none."""


class ChildProgram:
    """A `trial.Program` in a process of its own.

    Args:
        on_message: gets each line of its first stream, if these are messages and not its output.
    """

    def __init__(self, on_message: Callable[[bytes], None] | None = None) -> None:
        self._on_message = on_message
        self._lines: list[str] = []
        self._rest = {1: b"", 2: b""}
        self._bytes = 0
        self._news = asyncio.Event()
        self._process: Process | None = None
        self._end: asyncio.Task[int] | None = None
        self._watching: asyncio.Task[None] | None = None
        self._is_ended_by_us = False

    async def run(self, starter: Starter, start: Start) -> None:
        """Start the process."""
        self._process = await starter.start(start, self._written)
        self._end = asyncio.ensure_future(self._wait(self._process))
        self._watching = asyncio.ensure_future(self._watch(starter))

    @property
    def output(self) -> Sequence[str]:
        """The lines that it has written so far."""
        return self._lines

    async def wait_for_line(self, pattern: str, timeout: float) -> re.Match[str] | None:
        """Wait for a line in which the regular expression is found."""
        wanted = re.compile(pattern)
        seen = 0
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while True:
                    self._news.clear()
                    for line in self._lines[seen:]:
                        if found := wanted.search(line):
                            return found
                    seen = len(self._lines)
                    await self._news.wait()
        return None

    def write(self, data: bytes) -> None:
        """Write to the standard input of the program."""
        assert self._process is not None
        self._process.write(data)

    def add_output(self, lines: Iterable[str]) -> None:
        """Add lines that came in messages to the output."""
        self._lines += [line[:_LONGEST_LINE] for line in lines]

    async def finished(self, timeout: float | None) -> int | None:
        """Wait for the end of the program; without a limit if there is no timeout."""
        assert self._end is not None
        await asyncio.wait([self._end], timeout=timeout)
        return self._end.result() if self._end.done() else None

    async def interrupt(self) -> None:
        """Press Ctrl-C."""
        assert self._process is not None
        self._process.send_signal(signal.SIGINT)

    async def stop(self) -> None:
        """End the program as Ctrl-C does, or at once if it does not react."""
        if await self.finished(0.0) is None:
            self._is_ended_by_us = True
            await self.interrupt()
            if await self.finished(_END) is None:
                await self.kill()

    async def kill(self) -> None:
        """End the program at once, and wait for its end."""
        assert self._process is not None
        assert self._end is not None
        if not self._end.done():
            self._is_ended_by_us = True
            self._process.kill()
        await asyncio.wait([self._end])
        if self._watching is not None:
            self._watching.cancel()

    async def _wait(self, process: Process) -> int:
        code = await process.wait()
        for stream, rest in self._rest.items():
            if rest:
                self._written(stream, b"\n")
        if code in _CPU_EXCEEDED and not self._is_ended_by_us:
            self._note(f"it computed for more than {LIMITS.cpu} s")
        return code

    def _written(self, stream: int, data: bytes) -> None:
        self._bytes += len(data)
        if self._bytes > LIMITS.output:
            if not self._is_ended_by_us:
                self._end_at_once(f"it wrote more than {LIMITS.output // MEGABYTE} MB of output")
            return
        *lines, self._rest[stream] = (self._rest[stream] + data).split(b"\n")
        if stream == 1 and self._on_message is not None:
            for line in lines:
                self._on_message(line)
        else:
            self.add_output(line.decode(errors="replace").rstrip("\r") for line in lines)
        self._news.set()

    async def _watch(self, starter: Starter) -> None:
        """End the program if the programs of the trial use too much."""
        while True:
            await asyncio.sleep(_LOOK)
            if reason := starter.excess():
                self._end_at_once(reason)
                return

    def _end_at_once(self, reason: str) -> None:
        assert self._process is not None
        self._is_ended_by_us = True
        self._process.kill()
        self._note(reason)

    def _note(self, reason: str) -> None:
        self._lines.append(f"taskrpc lab check ended this program: {reason}")
        self._news.set()


class SpawnStarter:
    """Starts each program as a new Python, where processes cannot be forked.

    Args:
        scratch: the folder of the trial, with the folder `submission`.
    """

    def __init__(self, scratch: Path) -> None:
        self._scratch = scratch

    def excess(self) -> str:
        """Return "": nothing is limited together."""
        return ""

    async def start(self, start: Start, on_output: Written) -> ProcessTree:
        """Start a program, and wait until Python has imported what most programs need.

        A start takes far longer than by forking. In accelerated time, it would take too long for
        the checks.
        """
        scratch = self._scratch
        folder, ready = str(scratch / "submission"), scratch / f"ready-{secrets.token_hex(4)}"
        start = msgspec.structs.replace(
            start, scratch=str(scratch), folder=folder, ready=str(ready)
        )
        module = "child" if start.plan is None else boot.SIMULATED
        command = boot.command(module, msgspec.json.encode(start).decode())
        tree = await ProcessTree.start(command, on_output, cwd=folder, env=environment(scratch))
        last = speed.real_monotonic() + _START
        while tree.returncode is None and speed.real_monotonic() < last:
            if ready.exists():
                break
            await asyncio.sleep(_POLL * speed.speed())
        return tree
