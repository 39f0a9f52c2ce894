"""The accounts of the demo: which estimates were right, and why others were not."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.cli.robot.demo import story
from taskrpc.cli.robot.demo.estimates import EstimateCheck, are_right, check_estimates, summary


def test_wrong_estimate_is_reported_as_wrong():
    rows = check_estimates([ended(1, promised=10.0, actual=10.6), ended(2)], speed=2)
    assert not are_right(rows)
    assert "These estimates were wrong by more than 5 %: task 1 by +0.60 s." in summary(rows)


def test_estimate_with_late_timers_is_not_reported_as_right():
    rows = check_estimates([ended(1, promised=10.0, actual=10.2), ended(2)], speed=2)
    assert are_right(rows), "the plan was right"
    text = "\n".join(summary(rows))
    assert "Task 1 is off most, by +1.96 %: this computer is busy" in text
    assert "were right" not in text


@pytest.mark.parametrize("excuse", ["task 1 took longer than planned", "the task server was late"])
def test_task_that_took_longer_than_planned_has_a_wrong_estimate(excuse):
    rows = check_estimates([ended(1, promised=10.0, actual=15.0, changes=[(5.0, excuse)])], speed=2)
    assert not are_right(rows)


def test_estimate_that_changed_without_a_named_cause_is_wrong():
    named = ended(promised=10.0, actual=15.0, changes=[(5.0, "task 2, priority 10, went ahead")])
    assert are_right(check_estimates([named], speed=2))
    assert not are_right(check_estimates([ended(promised=10.0, actual=15.0)], speed=2))


@given(st.floats(0.1, 1000), st.floats(-0.05, 0.05))
def test_right_means_within_one_percent_or_ten_milliseconds(actual, share):
    row = EstimateCheck(ended(promised=actual * (1 - share)), 1, actual)
    off = abs(share) * actual
    if abs(off - max(0.01, 0.01 * actual)) > 1e-6:
        assert row.is_right == (off <= max(0.01, 0.01 * actual))


def test_failed_task_fails_the_demo():
    rows = check_estimates([ended(1), ended(2, state="FAILED")], speed=2)
    assert not are_right(rows)
    assert any(line.startswith("Task 2 ended FAILED") for line in summary(rows))


def test_demo_without_a_task_that_ran_fails():
    rows = check_estimates([ended(state="CANCELED", started=0.0)], speed=2)
    assert not are_right(rows)
    assert "No task ran." in summary(rows)


def test_the_summary_fits_a_terminal_of_eighty_columns(seen):
    lines = summary(check_estimates(seen.tasks, story.SPEED))
    assert all(len(line) <= 80 and line.isascii() for line in lines)
    assert lines[-2].startswith("All 6 estimates were right")


TASK_INFO = srvgen.load("taskrpc_interfaces/msg/TaskInfo")


CHANGE = srvgen.load("taskrpc_interfaces/msg/EstimateChange")


TIME = srvgen.load("builtin_interfaces/msg/Time")


def ended(task_id=1, *, promised=10.0, actual=10.0, changes=(), state="SUCCEEDED", started=1.0):
    def stamp(seconds):
        return TIME(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))

    return TASK_INFO(
        task_id=task_id,
        task_type="move",
        target="dock",
        priority=5,
        client="/client_1",
        state=state,
        accepted_estimate=promised,
        submitted=stamp(1.0),
        started=stamp(started),
        ended=stamp(1.0 + actual / 2),
        estimate_changes=[CHANGE(seconds=seconds, cause=cause) for seconds, cause in changes],
    )
