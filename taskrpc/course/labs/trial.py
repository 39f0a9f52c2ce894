"""What a check may do with a submission; a child process or a browser tab carries it out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from taskrpc.course.labs.variants import Variant
from taskrpc.node import Node


class Program(Protocol):
    """A program of the submission that was started; it ends with the check at the latest."""

    @property
    def output(self) -> Sequence[str]:
        """The lines that it has written so far to both streams, without their line ends."""

    async def wait_for_line(self, pattern: str, timeout: float) -> re.Match[str] | None:
        """Wait for a line in which the regular expression is found; None after the timeout."""

    async def finished(self, timeout: float) -> int | None:
        """Wait for the end of the program; its exit code, or None after the timeout."""

    async def interrupt(self) -> None:
        """Press Ctrl-C; `finished` says whether the program reacts."""

    async def stop(self) -> None:
        """End the program as Ctrl-C does, or at once if it does not react."""


class Trial(Protocol):
    """A submission under test. All times are seconds of the clock that its programs see."""

    @property
    def variant(self) -> Variant:
        """The variant of the lab that this student has."""

    @property
    def node(self) -> Node:
        """The node of the checks; it and the submission's programs see only each other."""

    @property
    def folder(self) -> Path:
        """The folder of the submission; a check may read it and must not change it."""

    @property
    def programs(self) -> Sequence[Program]:
        """The programs that were started."""

    async def start(self, file: str, *arguments: str, interleaved: bool = False) -> Program:
        """Start a program of the submission; raises NotMet if the file is missing.

        Args:
            file: its path in the folder.
            arguments: of its command line.
            interleaved: whether callbacks that run at the same time in several threads take turns
                at each step, so that a missing lock shows.
        """

    def time(self) -> float:
        """Return the seconds since a moment in the past."""

    async def sleep(self, seconds: float) -> None:
        """Wait."""

    def unpredictable(self, lowest: int, highest: int) -> int:
        """Return a random integer, so that a submission cannot contain its answers."""
