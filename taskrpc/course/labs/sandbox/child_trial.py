"""A trial whose programs are child processes: in a sandbox, or else beside the checks."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.sandbox import speed
from taskrpc.course.labs.sandbox.child import Start, environment
from taskrpc.course.labs.sandbox.program import ChildProgram, SpawnStarter, Starter
from taskrpc.course.labs.sandbox.simulated.conversation import Conversation
from taskrpc.course.labs.submission import remove
from taskrpc.course.labs.trial import Call, Service, Simulated
from taskrpc.course.labs.variants import Variant
from taskrpc.node import Node

_LONGEST_SOURCE = 2**20


class ChildTrial:
    """A trial in child processes; use `sandboxed_trial` or `spawned_trial`."""

    def __init__(self, variant: Variant, node: Node, folder: Path, starter: Starter) -> None:
        self._variant = variant
        self._node = node
        self._folder = folder
        self._starter = starter
        self._programs: list[ChildProgram] = []
        self.depends_on_time = False
        """Whether a program has run in time that passes, and not only in simulations."""

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
        """The submission as it was handed in; its programs cannot change these files."""
        return self._folder

    @property
    def programs(self) -> Sequence[ChildProgram]:
        """The programs that were started."""
        return self._programs

    async def start(self, file: str, *arguments: str, interleaved: bool = False) -> ChildProgram:
        """Start a program of the submission; raises NotMet if the file is missing or no Python."""
        self._check_file(file)
        self.depends_on_time = True
        program = ChildProgram()
        start = Start(
            file,
            arguments,
            speed=speed.speed(),
            wall=speed.wall_clock(),
            interleaved=interleaved,
        )
        await program.run(self._starter, start)
        self._programs.append(program)
        return program

    async def simulate(
        self,
        file: str,
        *arguments: str,
        duration: float,
        service: Service | None = None,
        calls: Sequence[Call] = (),
    ) -> Simulated:
        """Run a program in virtual time; raises NotMet if that is impossible."""
        self._check_file(file)
        conversation = Conversation(duration, service, calls)
        program = ChildProgram(conversation.received)
        conversation.send = program.write
        await program.run(self._starter, Start(file, arguments, plan=conversation.plan))
        self._programs.append(program)
        code = await program.finished(None)
        if conversation.error is not None:
            raise conversation.error
        if conversation.ended is None:
            last = next((line for line in reversed(program.output) if line.strip()), "nothing")
            raise NotMet(
                f"{file} to end as other programs do, or to go on",
                f"its process ended with {code} and wrote: {last.strip()}",
                "which line ends the process, or never lets it wait?",
            )
        if refused := conversation.ended.refused:
            raise NotMet(
                f"{file} to use only what its comments name, because the check simulates it",
                refused.partition(";")[0],
                "leave it out: rclpy, time and threads are enough",
            )
        found = conversation.result()
        program.add_output(found.output)
        return found

    def _check_file(self, file: str) -> None:
        """Raise NotMet if a file is missing or no Python."""
        path = self._folder / file
        if not path.is_file():
            names = sorted(each.name for each in self._folder.glob("*.py"))
            raise NotMet(
                f"a file {file}",
                f"the folder has {' and '.join(names) or 'no program'}",
                "`taskrpc lab start` wrote it; save your program under this name",
            )
        _check_syntax(path, file)

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
        """End all programs at once."""
        await asyncio.gather(*(program.kill() for program in self._programs))


def _check_syntax(path: Path, name: str) -> None:
    """Raise NotMet if a file is not Python; running it would say that with a traceback."""
    source = path.read_bytes() if path.stat().st_size <= _LONGEST_SOURCE else b""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            compile(source, name, "exec", dont_inherit=True)
    except SyntaxError as error:
        line = f", line {error.lineno}" if error.lineno else ""
        text = f": `{error.text.strip()}`" if error.text and error.text.strip() else ""
        raise NotMet(
            f"{name} to be a Python program",
            f"{name}{line}: {error.msg}{text}",
            "correct this line, or the one before it; your editor marks it too",
        ) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise NotMet(
            f"{name} to be a Python program", f"Python cannot read it: {error}", "write it anew"
        ) from None


if sys.platform != "win32":
    from taskrpc.course.labs.sandbox.box import Sandbox
    from taskrpc.course.labs.sandbox.network import TRANSPORT, network_of

    @contextlib.asynccontextmanager
    async def sandboxed_trial(
        root: Path, variant: Variant, sandbox: Sandbox
    ) -> AsyncIterator[ChildTrial]:
        """Make a trial in a sandbox, with a node that sees only its programs.

        Args:
            root: the folder of the submission; `submission.take` has made it.
            variant: of the lab, for this student.
            sandbox: with or without bubblewrap.
        """
        async with sandbox.check() as check:
            with network_of(check):
                async with Node("check", transport=TRANSPORT) as node:
                    trial = ChildTrial(variant, node, root, check)
                    try:
                        yield trial
                    finally:
                        await trial.close()


@contextlib.asynccontextmanager
async def spawned_trial(root: Path, variant: Variant, base: Path) -> AsyncIterator[ChildTrial]:
    """Make a trial where processes cannot be forked, in a private discovery folder.

    It changes the process's environment: a process runs one trial at a time.

    Args:
        root: the folder of the submission; its programs get a copy of it.
        variant: of the lab, for this student.
        base: where the trial makes a folder of its own.
    """
    scratch = Path(tempfile.mkdtemp(prefix="t", dir=base))
    try:
        shutil.copytree(root, scratch / "submission")
        os.environ.update(environment(scratch))
        async with Node("check") as node:
            trial = ChildTrial(variant, node, root, SpawnStarter(scratch))
            try:
                yield trial
            finally:
                await trial.close()
    finally:
        remove(scratch)
