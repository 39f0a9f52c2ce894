"""What the checks of lab 4 say about measured waits and about the tasks that ran."""

from types import SimpleNamespace

import pytest

from taskrpc.course.labs.checks.lab4 import Retry, expect_one_line, expect_one_run, expect_waits
from taskrpc.course.labs.lab import NotMet

RETRY = Retry(attempts=4, timeout=1.0, first_wait=1.0)


def test_the_client_gives_up_after_all_timeouts_and_waits():
    assert [RETRY.wait(number) for number in (1, 2, 3)] == [1, 2, 4]
    assert RETRY.total == 4 * 1 + 1 + 2 + 4


@pytest.mark.parametrize("waits", [[1, 2, 4], [1.1, 2.1, 4.1], [0.9, 1.9, 3.9]])
def test_waits_that_double_are_accepted(waits):
    expect_waits(waits, RETRY)


@pytest.mark.parametrize(
    "waits",
    [
        [],
        [1, 2],
        [1, 1, 1],
        [1, 2, 3],
        [2, 4, 8],
        [0.5, 1, 2],
        [0, 1, 2],
        [1.3, 2.3, 4.3],
        [1, 4, 9],
    ],
)
def test_other_waits_are_refused(waits):
    with pytest.raises(NotMet, match=r"expected waits of 1\.0, 2\.0, 4\.0 s"):
        expect_waits(waits, RETRY)


def robot(requests, runs):
    sent = [SimpleNamespace(target=target, request_id=id) for target, id in requests]
    return SimpleNamespace(requests=sent, runs=runs)


def test_an_id_made_of_the_target_is_refused():
    sent = [("a", "a"), ("b", "b"), ("a", "a")]
    with pytest.raises(NotMet, match="ran a 1 time: two tasks had the same request_id"):
        expect_one_run(robot(sent, ["a", "b"]), ["a", "b", "a"])


def test_one_id_for_each_task_is_accepted():
    expect_one_run(robot([("a", "1"), ("a", "1"), ("b", "2")], ["a", "b"]), ["a", "b"])


@pytest.mark.parametrize(
    ("requests", "runs", "message"),
    [
        (
            [("a", ""), ("a", "")],
            ["a", "a"],
            "ran 2 times for 1 task.*requests had no request_id",
        ),
        (
            [("a", "1"), ("a", "2")],
            ["a", "a"],
            "ran 2 times for 1 task.*another request_id",
        ),
        ([("a", "1"), ("b", "1")], ["a"], "ran b 0 times: two tasks had the same request_id"),
    ],
)
def test_a_task_that_runs_twice_or_never_is_explained(requests, runs, message):
    with pytest.raises(NotMet, match=message):
        expect_one_run(robot(requests, runs), ["a", "b"])


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (["all failed"], "there was none"),
        (["[ERROR] [1.4] [client]: dock: 3 attempts"], "the line is: dock: 3 attempts"),
        (["[ERROR] [1.4] [client]: failed 4 times"], "the line is: failed 4 times"),
        (["[ERROR] [4]: dock 4", "[ERROR] [5]: dock 4"], "there were 2: dock 4 / dock 4"),
        (["Traceback (most recent call last):", "TypeError: None"], "a traceback"),
    ],
)
def test_giving_up_takes_one_line_with_target_and_attempts(output, message):
    expect_one_line(SimpleNamespace(output=["[ERROR] dock: none in 4 attempts"]), 0, "dock", RETRY)
    with pytest.raises(NotMet, match=message):
        expect_one_line(SimpleNamespace(output=output), 0, "dock", RETRY)
