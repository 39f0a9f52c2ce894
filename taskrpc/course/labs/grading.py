"""Runs the checks of a lab over a trial, one after another, and collects what they say."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AbstractAsyncContextManager

import msgspec

from taskrpc.course.labs.lab import Check, Lab, NeedsCheck, NotMet
from taskrpc.course.labs.trial import Program, Trial

_UNSPUN = re.compile(r"\[taskrpc\] ROS 2 would .*: .*no (?:other )?thread spins ([\w/]+)")
"""What taskrpc reports of a node that is not spun."""

NewTrial = Callable[[], AbstractAsyncContextManager[Trial]]
"""Makes the trial of one check: a fresh node, and programs that end with it."""


class Finding(msgspec.Struct, frozen=True):
    """What a check found.

    Attributes:
        problem: why the check did not pass; None if it passed or did not run.
        waits_for: the title of the failed check that this one needs, "" if it ran.
        runs: how often the check ran; the last run decides.
    """

    check: Check
    problem: NotMet | None = None
    waits_for: str = ""
    runs: int = 1

    @property
    def passed(self) -> bool:
        """Whether the submission does what the check expects."""
        return self.problem is None and not self.waits_for

    @property
    def points(self) -> float:
        """The points that the submission gets for the check."""
        return self.check.points if self.passed else 0.0


async def findings(
    lab: Lab, new_trial: NewTrial, again: Callable[[], bool] = lambda: False
) -> AsyncIterator[Finding]:
    """Run the checks of a lab and yield what each one found, in their order.

    Args:
        lab: the lab.
        new_trial: makes the trial of each run of a check.
        again: called after a check that did not pass; returns whether to run it a second time, for
            example because a busy machine may be the reason.
    """
    failed: set[str] = set()
    for check in lab.checks:
        missing = next((title for title in check.needs if title in failed), "")
        if missing:
            finding = Finding(check, waits_for=missing, runs=0)
        else:
            finding = await _run(check, new_trial)
            if finding.problem is not None and again():
                finding = msgspec.structs.replace(await _run(check, new_trial), runs=2)
        if not finding.passed:
            failed.add(check.title)
        yield finding


async def _run(check: Check, new_trial: NewTrial) -> Finding:
    try:
        async with new_trial() as trial:
            try:
                await check.run(trial)
            except NotMet as problem:
                return Finding(check, with_reason(problem, trial.programs))
    except NotMet as problem:
        return Finding(check, problem)
    except NeedsCheck as needed:
        return Finding(check, waits_for=needed.title)
    return Finding(check)


def with_reason(problem: NotMet, programs: Iterable[Program]) -> NotMet:
    """Return the problem, with the reason and a hint if no thread spins a node of the programs."""
    for line in (line for program in programs for line in program.output):
        node = _UNSPUN.search(line)
        if node is not None and "thread spins" not in problem.happened:
            return NotMet(
                problem.expected,
                f"{problem.happened}; no thread spins {node[1]}",
                f"which line lets the callbacks of {node[1]} run, and takes its responses?"
                " See rclpy.spin and rclpy.spin_until_future_complete",
            )
    return problem
