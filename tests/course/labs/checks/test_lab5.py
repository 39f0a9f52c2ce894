"""What the checks of lab 5 say about orders and estimates."""

from types import SimpleNamespace

import pytest

from taskrpc.course.labs.checks.lab5 import Accepted, Desk, expect_estimates, expect_order, work_of
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.variants import Variant

SECONDS = {"move": 5.0, "scan": 3.0, "report": 1.0}


def accepted(id, priority, type="report", estimate=0.0, time=0.0):
    return Accepted(type, priority, id, estimate, time)


TASKS = [accepted(2, 3), accepted(3, 8), accepted(4, 3), accepted(5, 10)]


def test_the_highest_priority_comes_first_and_equal_ones_in_the_order_of_their_ids():
    expect_order(TASKS, [1, 5, 3, 2, 4])


@pytest.mark.parametrize(
    ("executed", "message"),
    [
        ([1, 2, 4, 3, 5], r"it did them in the order 2 \(priority 3\).*smallest tuple first"),
        ([1, 2, 3, 4, 5], "smallest tuple first"),
        ([1, 5, 3, 4, 2], "of two tasks of one priority, the one with the smaller id"),
        ([1, 5, 3, 2, 2], "of two tasks of one priority"),
    ],
)
def test_another_order_is_explained(executed, message):
    with pytest.raises(NotMet, match=message):
        expect_order(TASKS, executed)


def waiting(*estimates):
    """A move was sent at 10 s and runs; at 12 s a scan and a report of equal priority follow."""
    first, second = estimates
    return [accepted(2, 5, "scan", first, 12.0), accepted(3, 5, "report", second, 12.0)]


FIRST = accepted(1, 10, "move", 5.0, 10.0)


@pytest.mark.parametrize("estimates", [(6.0, 7.0), (8.0, 9.0), (5.7, 6.6)])
def test_an_estimate_may_count_the_running_task_in_full_or_its_rest(estimates):
    expect_estimates(SECONDS, 10.0, FIRST, waiting(*estimates))


@pytest.mark.parametrize(
    ("estimates", "message"),
    [
        ((3.0, 1.0), r"at least 6\.0 s for task 2: 3\.0 s of the running task, 0 s of waiting"),
        ((8.0, 99.0), r"at most 9 s for task 3 of priority 5: .*; estimated_time=99"),
        ((8.0, 6.0), r"at least 7\.0 s for task 3: .*3 s of waiting ones ahead of it, 1 s of its"),
    ],
)
def test_an_estimate_without_the_work_ahead_is_explained(estimates, message):
    with pytest.raises(NotMet, match=message):
        expect_estimates(SECONDS, 10.0, FIRST, waiting(*estimates))


def test_an_estimate_that_ignores_the_priority_is_explained():
    tasks = [accepted(2, 5, "scan", 6.0, 12.0), accepted(3, 9, "report", 7.0, 12.0)]
    with pytest.raises(NotMet, match=r"at most 6 s for task 3 of priority 9: less important"):
        expect_estimates(SECONDS, 10.0, FIRST, tasks)


def test_a_less_important_task_is_not_ahead():
    tasks = [accepted(2, 5, "scan", 6.0, 12.0), accepted(3, 9, "report", 4.0, 12.0)]
    expect_estimates(SECONDS, 10.0, FIRST, tasks)


@pytest.mark.parametrize("id", ["", "ada", "grace"])
def test_types_of_a_variant_have_different_lengths(id):
    work = work_of(Variant(id))
    lengths = [work.seconds[name] for name in work.types]
    assert sorted(set(lengths), reverse=True) == lengths
    assert len(set(work.targets)) == 3


@pytest.mark.parametrize(
    ("output", "words"),
    [
        (["Executing task 1: move - dock"], ""),
        (["  raise ValueError", "TypeError: x", "[INFO] ready"], "; it printed TypeError: x"),
    ],
)
def test_an_exception_of_the_worker_is_shown(output, words):
    trial = SimpleNamespace(variant=Variant())
    assert Desk(trial, SimpleNamespace(output=output), None).error() == words
