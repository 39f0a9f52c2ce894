"""The order of checks, and which are not run."""

import contextlib
from types import SimpleNamespace

import pytest

from taskrpc.course.labs.grading import findings, with_reason
from taskrpc.course.labs.lab import Check, Lab, NeedsCheck, NotMet


@contextlib.asynccontextmanager
async def no_trial():
    yield SimpleNamespace(programs=[])


async def passes(trial):
    pass


async def fails(trial):
    raise NotMet("sum=5", "sum=6", "the addition")


async def needs_offers(trial):
    raise NeedsCheck("offers")


def fails_first(times):
    """Return a check's run that fails so many times, and then passes."""

    async def run(trial):
        nonlocal times
        times -= 1
        if times >= 0:
            raise NotMet("a response", f"none, {times} failures left", "")

    return run


async def found(*checks, again=lambda: False):
    lab = Lab(1, "", 1, "", (), lambda variant: {}, checks)
    return [each async for each in findings(lab, no_trial, again)]


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


async def test_a_check_can_say_itself_that_it_needs_another_one():
    first, second = await found(
        Check("fields", 3, needs_offers), Check("adds", 3, passes, needs=("fields",))
    )
    assert (first.passed, first.problem, first.waits_for) == (False, None, "offers")
    assert second.waits_for == "fields"


async def test_the_second_run_of_a_failed_check_decides():
    first, second, third = await found(
        Check("a", 1, fails_first(1)),
        Check("b", 1, fails_first(2)),
        Check("c", 1, passes),
        again=lambda: True,
    )
    assert [each.passed for each in (first, second, third)] == [True, False, True]
    assert [each.runs for each in (first, second, third)] == [2, 2, 1]
    assert second.problem.happened == "none, 0 failures left"


async def test_a_check_that_passed_or_waits_for_another_one_is_not_run_again():
    asked = []
    await found(
        Check("a", 1, passes), Check("b", 1, needs_offers), again=lambda: asked.append("again")
    )
    assert asked == []


UNSPUN = (
    "[taskrpc] ROS 2 would never answer a request for /add: no thread spins /lab/adder; spin it"
)
UNSPUN_CALL = (
    "[taskrpc] ROS 2 would hang here for ever: no other thread spins /adder; use call_async"
)


@pytest.mark.parametrize(("line", "node"), [(UNSPUN, "/lab/adder"), (UNSPUN_CALL, "/adder")])
def test_a_node_that_is_not_spun_is_the_reason_and_gets_the_hint(line, node):
    programs = [SimpleNamespace(output=["ready"]), SimpleNamespace(output=["ready", line])]
    found = with_reason(NotMet("a response", "there was none", "see the callback"), programs)
    assert (found.expected, found.happened) == (
        "a response",
        f"there was none; no thread spins {node}",
    )
    assert found.look.startswith(f"which line lets the callbacks of {node} run")


@pytest.mark.parametrize(
    ("happened", "line"),
    [
        ("there was none", "ready"),
        ("there was none", "no thread spins /adder"),  # a program can write that, too
        (UNSPUN.removeprefix("[taskrpc] "), UNSPUN),
    ],
)
def test_another_problem_keeps_its_hint(happened, line):
    problem = NotMet("a response", happened, "see the callback")
    assert with_reason(problem, [SimpleNamespace(output=[line])]) is problem
