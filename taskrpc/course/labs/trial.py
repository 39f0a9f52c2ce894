"""What a check may do with a submission; a child process or a browser tab carries it out."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from taskrpc.course.labs.variants import Variant
from taskrpc.message_types import Msg
from taskrpc.node import Node


class Ran(Protocol):
    """A program that runs, or has run, in real or in virtual time."""

    @property
    def output(self) -> Sequence[str]:
        """The lines that it has written so far to both streams, without their line ends."""


class Program(Ran, Protocol):
    """A program of the submission that was started; it ends with the check at the latest."""

    async def wait_for_line(self, pattern: str, timeout: float) -> re.Match[str] | None:
        """Wait for a line in which the regular expression is found; None after the timeout."""

    async def finished(self, timeout: float) -> int | None:
        """Wait for the end of the program; its exit code, or None after the timeout."""

    async def interrupt(self) -> None:
        """Press Ctrl-C; `finished` says whether the program reacts."""

    async def stop(self) -> None:
        """End the program as Ctrl-C does, or at once if it does not react."""


class Service(NamedTuple):
    """A service that a check offers to a simulated program."""

    type_name: str
    definition: str
    """The text of the definition."""
    name: str
    respond: Callable[[Msg, float], Msg | None]
    """Gets a request and its time; returns the response, None if it gets lost."""


class Call(NamedTuple):
    """A call that a check makes in a simulation."""

    type_name: str
    """Of a type that comes with taskrpc."""
    name: str
    request: Msg
    at: float
    """Seconds after the services of all calls are there."""


class Response(NamedTuple):
    """What came of a `Call`."""

    began: float
    """When it was sent."""
    time: float
    """When it got its response."""
    message: Msg | None
    """None: it has no response."""
    problem: str
    """Why it has none, "" if it was still waiting at the end."""


class Simulated(NamedTuple):
    """How a simulated program ran; all times are virtual seconds of the run."""

    output: Sequence[str]
    """The lines that it wrote."""
    times: Sequence[float]
    """When it wrote each of them."""
    code: int | None
    """Its exit code; None if it still ran at the end."""
    responses: Sequence[Response]
    """Of each call, in the order of the calls."""
    problem: str
    """What the simulation found: a deadlock, an exception, a wait without end; "" for nothing."""


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

    async def simulate(
        self,
        file: str,
        *arguments: str,
        duration: float,
        service: Service | None = None,
        calls: Sequence[Call] = (),
    ) -> Simulated:
        """Run a program of the submission in virtual time; raises NotMet if that is impossible.

        The result does not depend on how fast the machine is.

        Args:
            file: its path in the folder.
            arguments: of its command line.
            duration: virtual seconds after which the run ends, if nothing has ended it before.
            service: what the program can call.
            calls: what the check calls.
        """

    def time(self) -> float:
        """Return the seconds since a moment in the past."""

    async def sleep(self, seconds: float) -> None:
        """Wait."""

    def unpredictable(self, lowest: int, highest: int) -> int:
        """Return a random integer, so that a submission cannot contain its answers."""
