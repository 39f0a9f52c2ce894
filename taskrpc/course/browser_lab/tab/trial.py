"""Carries out the checks of a lab in the tab: the submission is what the editor contains."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import random
import time
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from taskrpc.course.browser_lab.tab.programs import FOLDER, Program, Programs
from taskrpc.course.labs.grading import NewTrial
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.trial import Call, Service, Simulated
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.spi import current_program

_DOMAIN = "ROS_DOMAIN_ID"
_domains = itertools.cycle(range(1, 233))
"""Each trial has a domain of its own, so it sees neither the robot nor an earlier trial."""


class TabTrial:
    """A `Trial`: its programs run in the tab; its clock is the browser's."""

    def __init__(self, programs: Programs, variant: Variant, node: Node) -> None:
        self.variant = variant
        self.node = node
        self.folder: Path = FOLDER
        self._programs = programs
        self.programs: list[Program] = []
        """The programs that were started."""

    async def start(self, file: str, *arguments: str, interleaved: bool = False) -> Program:
        """Start a program of the submission; raises NotMet if the file is missing.

        Threads of a tab never interrupt each other, so `interleaved` changes nothing.
        """
        if not (FOLDER / file).is_file():
            raise NotMet(f"a file {file}", "there is none", "does it have another name?")
        program = self._programs.start(file, *arguments)
        self.programs.append(program)
        return program

    async def simulate(
        self,
        file: str,
        *arguments: str,
        duration: float,
        service: Service | None = None,
        calls: Sequence[Call] = (),
    ) -> Simulated:
        """Raise TaskRpcError: no lab of the tab is checked in virtual time."""
        raise TaskRpcError(f"{file} cannot be simulated in a browser")

    def time(self) -> float:
        """Return the seconds since a moment in the past."""
        return time.monotonic()

    async def sleep(self, seconds: float) -> None:
        """Wait."""
        await asyncio.sleep(seconds)

    def unpredictable(self, lowest: int, highest: int) -> int:
        """Return a random integer."""
        return random.randint(lowest, highest)

    async def end(self) -> None:
        """Stop its programs."""
        await asyncio.gather(*(program.stop() for program in self.programs))


def trials(programs: Programs, variant: Variant) -> NewTrial:
    """Return what makes the trial of each check."""

    @contextlib.asynccontextmanager
    async def new_trial() -> AsyncIterator[TabTrial]:
        domain = next(_domains)
        before, os.environ[_DOMAIN] = os.environ.get(_DOMAIN), str(domain)
        name = current_program.set(f"check {domain}")
        try:
            async with Node("checks", transport="memory") as node:
                trial = TabTrial(programs, variant, node)
                try:
                    yield trial
                finally:
                    await trial.end()
        finally:
            current_program.reset(name)
            if before is None:
                del os.environ[_DOMAIN]
            else:
                os.environ[_DOMAIN] = before

    return new_trial
