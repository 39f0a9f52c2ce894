"""The model of a lab: its files, its checks, and what a check says about a submission."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec

from taskrpc.course.labs.trial import Trial
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError
from taskrpc.spi import install_command


class NotMet(Exception):
    """A submission does not do what a check expects; the text is written for the student.

    Args:
        expected: what a correct program does: `the response of /add_two_ints to a=2 b=3 is sum=5`.
        happened: what this program did: `sum=6`.
        look: where the student should look, or what to try; never the solution.
    """

    def __init__(self, expected: str, happened: str, look: str) -> None:
        self.expected = expected
        self.happened = happened
        self.look = look
        super().__init__(f"expected {expected}; {happened}; {look}")


class NeedsCheck(Exception):
    """A check cannot say anything until another one passes; the submission shows it as it runs.

    Args:
        title: of the other check.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        super().__init__(f"runs when this passes: {title}")


@dataclass(frozen=True)
class Check:
    """One thing that a submission must do.

    Attributes:
        title: a statement about a correct program: `the server adds`.
        points: its share of the lab's 10 points.
        run: raises NotMet if the submission does something else.
        needs: titles of checks without which this one would only repeat their message.
    """

    title: str
    points: float
    run: Callable[[Trial], Awaitable[None]] = field(repr=False)
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Lab:
    """A lab of the course.

    Attributes:
        number: 1 to 6.
        title: what it is about.
        minutes: how long a student needs.
        goal: one sentence: what the student can do afterwards.
        files: the starter files, as paths below `files/labN`; the student changes them.
        values: the texts that replace `@NAME@` in the starter files, for a variant.
        checks: in the order in which they run.
        speed: how many times faster time passes while the lab is checked: programs, checks and
            their timeouts. Below 10, so that a busy machine causes no failures.
        is_simulated: whether some checks run programs in virtual time.
    """

    number: int
    title: str
    minutes: int
    goal: str
    files: tuple[str, ...]
    values: Callable[[Variant], Mapping[str, str]] = field(repr=False)
    checks: tuple[Check, ...] = field(repr=False)
    speed: float = 5.0
    is_simulated: bool = False

    def check_installed(self) -> None:
        """Raise TaskRpcError if a package is missing that the checks need."""
        if self.is_simulated and find_spec("greenlet") is None:
            raise TaskRpcError(
                f"lab {self.number} is checked in virtual time, which needs greenlet, and that is"
                f" not installed; {install_command('simulate', 'greenlet')}"
            )
