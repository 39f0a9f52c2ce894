"""The order of checks, and which are not run."""

import contextlib

from taskrpc.labs.grading import findings
from taskrpc.labs.lab import Check, Lab, NotMet


@contextlib.asynccontextmanager
async def no_trial():
    yield None


async def passes(trial):
    pass


async def fails(trial):
    raise NotMet("sum=5", "sum=6", "the addition")


async def found(*checks):
    lab = Lab(1, "", 1, "", (), lambda variant: {}, checks)
    return [each async for each in findings(lab, no_trial)]


async def test_a_check_that_needs_a_failed_one_is_not_run():
    first, second, third, last = await found(
        Check("offers", 2, fails),
        Check("adds", 3, passes, needs=("offers",)),
        Check("logs", 3, passes, needs=("adds",)),
        Check("prints", 1, passes),
    )
    assert (first.problem.expected, first.problem.happened) == ("sum=5", "sum=6")
    assert (second.waits_for, third.waits_for) == ("offers", "adds")
    assert [each.points for each in (first, second, third, last)] == [0, 0, 0, 1]


async def test_all_checks_of_a_correct_submission_pass():
    assert all(each.passed for each in await found(Check("a", 1, passes), Check("b", 2, passes)))
