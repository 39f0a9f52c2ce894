"""A trial whose programs are child processes in a private discovery folder."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import shutil
import tempfile
import time
import warnings
from collections.abc import AsyncIterator
from pathlib import Path

from taskrpc.labs.lab import NotMet
from taskrpc.labs.sandbox import linux, speed
from taskrpc.labs.sandbox.child import Start, environment
from taskrpc.labs.sandbox.program import ChildProgram, SpawnStarter, Starter
from taskrpc.labs.submission import remove
from taskrpc.labs.variants import Variant
from taskrpc.node import Node

_LONGEST_SOURCE = 2**20


class ChildTrial:
    """A trial in child processes; use `child_trial`."""

    def __init__(self, variant: Variant, node: Node, place: Path, starter: Starter) -> None:
        self._variant = variant
        self._node = node
        self._place = place
        self._folder = place / "submission"
        self._starter = starter
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
        """Start a program of the submission; raises NotMet if the file is missing or no Python."""
        path = self._folder / file
        if not path.is_file():
            names = sorted(each.name for each in self._folder.glob("*.py"))
            raise NotMet(
                f"a file {file}",
                f"the folder has {' and '.join(names) or 'no program'}",
                "`taskrpc lab start` wrote it; save your program under this name",
            )
        _check_syntax(path, file)
        program = ChildProgram(self._place)
        start = Start(file, arguments, str(self._place), speed.speed(), speed.wall_clock())
        await program.run(self._starter, start)
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


@contextlib.asynccontextmanager
async def child_trial(
    root: Path, variant: Variant, base: Path | None = None, starter: Starter | None = None
) -> AsyncIterator[ChildTrial]:
    """Make a trial of a submission: a copy of its folder, and a node that sees only its programs.

    It changes the process's environment: a process runs one trial at a time.

    Args:
        root: the folder of the submission; `submission.take` has made it.
        variant: of the lab, for this student.
        base: where the trial makes a folder of its own; None for the system's temporary folder.
        starter: what starts the programs; None to start a Python for each.
    """
    place = Path(tempfile.mkdtemp(prefix="taskrpc-lab-" if base is None else "t", dir=base))
    try:
        shutil.copytree(root, place / "submission")
        os.environ.update(environment(place))
        # A confined program has Unix sockets only.
        async with Node("check", listen="unix:" if linux.can_confine() else None) as node:
            trial = ChildTrial(variant, node, place, starter or SpawnStarter())
            registry = [each for each in (place / "run").rglob("*") if each.is_dir()]
            try:
                yield trial
            finally:
                await trial.close()
                for each in registry:  # a program may have removed it; the node needs it to end
                    each.mkdir(mode=0o700, parents=True, exist_ok=True)
    finally:
        remove(place)
