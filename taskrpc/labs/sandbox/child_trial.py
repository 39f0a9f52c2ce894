"""A trial whose programs are child processes in a private discovery folder."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import secrets
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from taskrpc.labs.lab import NotMet
from taskrpc.labs.variants import Variant
from taskrpc.node import Node
from taskrpc.ros.process_tree import ProcessTree

_END = 1.0
"""Seconds that a program has to end after Ctrl-C."""


class ChildProgram:
    """A program of a submission in a process of its own."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._rest = {1: b"", 2: b""}
        self._news = asyncio.Event()
        self._tree: ProcessTree | None = None
        self._end: asyncio.Task[int] | None = None

    async def run(self, command: Sequence[str], folder: Path, env: dict[str, str]) -> None:
        """Start the process."""
        self._tree = await ProcessTree.start(command, self._written, cwd=str(folder), env=env)
        self._end = asyncio.ensure_future(self._tree.wait())

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
        assert self._tree is not None
        self._tree.send_signal(signal.SIGINT)

    async def stop(self) -> None:
        """End the program as Ctrl-C does, or at once if it does not react."""
        assert self._tree is not None
        if await self.finished(0.0) is None:
            await self.interrupt()
            if await self.finished(_END) is None:
                self._tree.kill()
        await self._tree.end_descendants()

    def _written(self, stream: int, data: bytes) -> None:
        *lines, self._rest[stream] = (self._rest[stream] + data).split(b"\n")
        self._lines += [line.decode(errors="replace").rstrip("\r") for line in lines]
        self._news.set()


class ChildTrial:
    """A trial in child processes; use `child_trial`."""

    def __init__(self, variant: Variant, node: Node, folder: Path) -> None:
        self._variant = variant
        self._node = node
        self._folder = folder
        self._programs: list[ChildProgram] = []

    @property
    def variant(self) -> Variant:
        """The variant of the lab that this student has."""
        return self._variant

    @property
    def node(self) -> Node:
        """The node of the checks."""
        return self._node

    @property
    def folder(self) -> Path:
        """The copy of the submission's folder in which its programs run."""
        return self._folder

    async def start(self, file: str, *arguments: str) -> ChildProgram:
        """Start a program of the submission; raises NotMet if the file is missing."""
        if not (self._folder / file).is_file():
            names = sorted(path.name for path in self._folder.glob("*.py"))
            raise NotMet(
                f"a file {file}",
                f"the folder has {' and '.join(names) or 'no program'}",
                "`taskrpc lab start` wrote it; save your program under this name",
            )
        program = ChildProgram()
        command = [sys.executable, "-m", "taskrpc", "run", file, *arguments]
        await program.run(command, self._folder, dict(os.environ))
        self._programs.append(program)
        return program

    def time(self) -> float:
        """Return the seconds since a moment in the past."""
        return time.monotonic()

    async def sleep(self, seconds: float) -> None:
        """Wait."""
        await asyncio.sleep(seconds)

    def unpredictable(self, lowest: int, highest: int) -> int:
        """Return a random integer."""
        return lowest + secrets.randbelow(highest - lowest + 1)

    async def close(self) -> None:
        """End all programs."""
        await asyncio.gather(*(program.stop() for program in self._programs))


@contextlib.asynccontextmanager
async def child_trial(submission: Path, variant: Variant) -> AsyncIterator[ChildTrial]:
    """Make a trial of a submission: a copy of its folder, and a node that sees only its programs.

    It changes the process's environment: a process runs one trial at a time.
    """
    with tempfile.TemporaryDirectory(prefix="taskrpc-lab-") as place:
        folder = Path(place, "submission")
        shutil.copytree(submission, folder, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        os.environ["XDG_RUNTIME_DIR"] = place
        os.environ.pop("TASKRPC_PEERS", None)
        async with Node("check") as node:
            trial = ChildTrial(variant, node, folder)
            try:
                yield trial
            finally:
                await trial.close()
