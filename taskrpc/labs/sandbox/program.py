"""A running program of a submission, seen from the checks: its output, its end, its limits."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import secrets
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from taskrpc.labs.sandbox import boot, fork_server, speed
from taskrpc.labs.sandbox.child import Start, environment
from taskrpc.labs.sandbox.limits import LIMITS, MEGABYTE
from taskrpc.ros.process_tree import ProcessTree

_END = 5.0
"""Seconds that a program has to end after Ctrl-C."""
_LONGEST_LINE = 2000
_START = 30.0
"""Real seconds that a new Python may need to import taskrpc."""
_POLL = 0.01
_LOOK = 1.0
"""Seconds between two looks at the size of a program's folder."""
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


class Starter(Protocol):
    """What starts processes for a trial."""

    async def start(self, start: Start, on_output: Written) -> Process:
        """Start a program."""


class ChildProgram:
    """A `trial.Program` in a process of its own."""

    def __init__(self, folder: Path) -> None:
        """`folder` contains all folders that the program may change."""
        self._folder = folder
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
        self._watching = asyncio.ensure_future(self._watch())

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

    async def finished(self, timeout: float) -> int | None:
        """Wait for the end of the program."""
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
        for line in lines:
            text = line.decode(errors="replace").rstrip("\r")
            self._lines.append(text[:_LONGEST_LINE])
        self._news.set()

    async def _watch(self) -> None:
        """End the program if its folder becomes too large."""
        while True:
            await asyncio.sleep(_LOOK)
            size, count = usage(self._folder, LIMITS.files)
            if size > LIMITS.folder or count > LIMITS.files:
                self._end_at_once(
                    f"its folders have more than {LIMITS.folder // MEGABYTE} MB"
                    f" or {LIMITS.files} files"
                )
                return

    def _end_at_once(self, reason: str) -> None:
        assert self._process is not None
        self._is_ended_by_us = True
        self._process.kill()
        self._note(reason)

    def _note(self, reason: str) -> None:
        self._lines.append(f"taskrpc lab check ended this program: {reason}")
        self._news.set()


def usage(folder: Path, most: int) -> tuple[int, int]:
    """Return the bytes and the number of the files below a folder; stops after `most` files."""
    size = count = 0
    waiting = [folder]
    while waiting and count <= most:
        with contextlib.suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                count += 1
                if count > most:
                    break
                with contextlib.suppress(OSError):
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(Path(entry.path))
                    else:
                        size += entry.stat(follow_symlinks=False).st_size
    return size, count


class SpawnStarter:
    """Starts each program as a new Python, where processes cannot be forked."""

    async def start(self, start: Start, on_output: Written) -> ProcessTree:
        """Start a program, and wait until Python has imported what most programs need.

        A start takes far longer than by forking. In accelerated time, it would take too long for
        the checks.
        """
        place = Path(start.place)
        ready = place / f"ready-{secrets.token_hex(4)}"
        start = msgspec.structs.replace(start, ready=str(ready))
        command = boot.command("child", msgspec.json.encode(start).decode())
        tree = await ProcessTree.start(
            command, on_output, cwd=str(place / "submission"), env=environment(place)
        )
        last = speed.real_monotonic() + _START
        while tree.returncode is None and speed.real_monotonic() < last:
            if ready.exists():
                break
            await asyncio.sleep(_POLL * speed.speed())
        return tree


if sys.platform != "win32":

    class ForkStarter:
        """Starts programs through `fork_server`; create it in the event loop."""

        def __init__(self, server: socket.socket) -> None:
            self._server = server
            self._received = b""
            self._started: list[asyncio.Future[int]] = []
            self._ends: dict[int, asyncio.Future[int]] = {}
            asyncio.get_running_loop().add_reader(server, self._read)

        async def start(self, start: Start, on_output: Written) -> ForkedProcess:
            """Start a program."""
            outer, inner = zip(*(os.pipe() for _ in range(2)), strict=True)
            stdin, keep_open = os.pipe()  # standard input waits, as in ROS, and gets no end
            started = asyncio.get_running_loop().create_future()
            self._started.append(started)
            request = msgspec.json.encode(fork_server.Request(start)) + b"\n"
            socket.send_fds(self._server, [request], [stdin, *inner])
            for each in (stdin, *inner):
                os.close(each)
            pid = await started
            return ForkedProcess(self, pid, self._ends[pid], list(outer), keep_open, on_output)

        def send_signal(self, pid: int, number: int) -> None:
            """Send a signal to a program, if it still runs."""
            request = fork_server.Request(signal=number, pid=pid)
            self._server.send(msgspec.json.encode(request) + b"\n")

        def _read(self) -> None:
            data = self._server.recv(fork_server.LONGEST)
            if not data:
                raise SystemExit("the process that starts the programs has ended")
            *lines, self._received = (self._received + data).split(b"\n")
            for line in lines:
                report = msgspec.json.decode(line, type=fork_server.Report)
                if report.pid:
                    self._ends[report.pid] = asyncio.get_running_loop().create_future()
                    self._started.pop(0).set_result(report.pid)
                else:
                    self._ends.pop(report.ended).set_result(report.code)

    class ForkedProcess:
        """A program that `fork_server` has started."""

        def __init__(
            self,
            starter: ForkStarter,
            pid: int,
            end: asyncio.Future[int],
            outputs: list[int],
            keep_open: int,
            on_output: Written,
        ) -> None:
            self._starter = starter
            self._pid = pid
            self._end = end
            self._keep_open = keep_open
            self._outputs = dict(enumerate(outputs, start=1))
            self._on_output = on_output
            for stream, output in self._outputs.items():
                os.set_blocking(output, False)
                asyncio.get_running_loop().add_reader(output, self._read, stream)

        async def wait(self) -> int:
            """Wait for its end and its output."""
            code = await asyncio.shield(self._end)
            # Its whole group has been killed, so nothing can write any more.
            for stream in list(self._outputs):
                while stream in self._outputs and self._read(stream):
                    continue
                self._close(stream)
            os.close(self._keep_open)
            return code

        def send_signal(self, number: int) -> None:
            """Send a signal to it."""
            self._starter.send_signal(self._pid, number)

        def kill(self) -> None:
            """End it at once."""
            self.send_signal(signal.SIGKILL)

        def _read(self, stream: int) -> bool:
            """Read what there is; returns whether there was something."""
            try:
                data = os.read(self._outputs[stream], 2**16)
            except BlockingIOError:
                return False
            if data:
                self._on_output(stream, data)
            else:
                self._close(stream)
            return bool(data)

        def _close(self, stream: int) -> None:
            if (output := self._outputs.pop(stream, None)) is not None:
                asyncio.get_running_loop().remove_reader(output)
                os.close(output)
