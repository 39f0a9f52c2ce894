"""Runs the checks of a lab over a trial, one after another, and collects what they say."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

from taskrpc.labs.lab import Check, Lab, NotMet
from taskrpc.labs.trial import Trial

NewTrial = Callable[[], AbstractAsyncContextManager[Trial]]
"""Makes the trial of one check: a fresh node, and programs that end with it."""


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes:
        problem: why the check did not pass; None if it passed or did not run.
        waits_for: the title of the failed check that this one needs, "" if it ran.
    """

    check: Check
    problem: NotMet | None = None
    waits_for: str = ""

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
        new_trial: makes the trial of each check.
        again: called after a check that did not pass; returns whether to run it once more, for
            example because the machine was too busy.
    """
    failed: set[str] = set()
    for check in lab.checks:
        missing = next((title for title in check.needs if title in failed), "")
        finding = Finding(check, waits_for=missing)
        if not missing:
            while problem := await _problem(check, new_trial):
                finding = Finding(check, problem)
                if not again():
                    break
            else:
                finding = Finding(check)
        if not finding.passed:
            failed.add(check.title)
        yield finding


async def _problem(check: Check, new_trial: NewTrial) -> NotMet | None:
    try:
        async with new_trial() as trial:
            await check.run(trial)
    except NotMet as problem:
        return problem
    return None
