"""The story of the demo: its tasks, its lines and its estimates, in virtual time."""

from __future__ import annotations

import pytest

import taskrpc
from taskrpc.cli.robot.demo import story
from taskrpc.cli.robot.demo.estimates import are_right, check_estimates
from taskrpc.cli.robot.demo.story import Cancel, Submit, open_stage, perform
from tests.cli.robot.demo.conftest import on_virtual_time


def test_the_story_takes_ten_to_fifteen_seconds(seen):
    assert 10 <= seen.took <= 15


def test_the_lectures_four_tasks_come_first_and_run_in_the_order_two_one_three_four(seen):
    begins = [line.text for line in seen.lines if " begins: " in line.text]
    order = [int(text.split()[1]) for text in begins]
    assert [task_id for task_id in order if task_id <= 4] == [2, 1, 3, 4]
    assert [task.target for task in seen.tasks[:4]] == "warehouse area_a station_1 central".split()


def test_priority_ten_runs_before_priority_one_although_it_came_later(seen):
    ten, one = (
        next(task for task in seen.tasks if task.priority == priority) for priority in (10, 1)
    )
    assert ten.task_id > one.task_id
    assert (ten.started.sec, ten.started.nanosec) < (one.started.sec, one.started.nanosec)


def test_all_three_clients_have_tasks_of_their_own(seen):
    assert {task.client for task in seen.tasks} == {"/client_1", "/client_2", "/client_3"}


def test_refusal_cancel_and_changed_estimates_are_reported(seen):
    told = [line.text for line in seen.lines]
    assert "fly moon 9 -> Invalid task: fly (expected move, scan or report)" in told
    assert any(text.startswith("cancel task 6 -> Task 6 was cancelled") for text in told)
    assert any(text.endswith(" s: task 7, priority 10, went ahead") for text in told)
    assert any(text.endswith(" s: task 6 was cancelled") for text in told)


def test_events_are_reported_in_order_of_time_in_ascii(seen):
    times = [line.at for line in seen.lines]
    assert times == sorted(times)
    assert all(line.text.isascii() for line in seen.lines)


def test_every_estimate_plus_its_named_changes_is_the_actual_time_within_ten_milliseconds(seen):
    rows = check_estimates(seen.tasks, story.SPEED)
    assert len([row for row in rows if row.turn]) == 6
    assert all(abs(row.difference) <= 0.010 for row in rows if row.turn)
    assert are_right(rows)


def test_estimate_checks_agree_with_the_times_of_the_lines(seen):
    for row in check_estimates(seen.tasks, story.SPEED):
        number = row.task.task_id
        asked = next(line.at for line in seen.lines if f"(task {number}," in line.text)
        ended = next(
            line.at
            for line in seen.lines
            if line.text.startswith(f"task {number} {row.task.state}")
        )
        assert ended - asked == pytest.approx(row.actual, abs=0.01)


@pytest.mark.parametrize("speed", [0.5, 20.0])
def test_estimates_are_right_at_every_allowed_speed(speed):
    async def main():
        async with open_stage(speed=speed) as stage:
            return check_estimates(await perform(stage), speed)

    assert are_right(on_virtual_time(main))


def test_a_script_that_ends_after_its_tasks_ends_too():
    script = [Submit(0, "client_1", "report", "dock", 1), Submit(9, "client_2", "fly", "x", 1)]

    async def main():
        async with open_stage(speed=1) as stage:
            return await perform(stage, script)

    assert [task.state for task in on_virtual_time(main)] == ["SUCCEEDED"]


def test_story_with_an_unexpected_refusal_does_not_hang():
    script = [Submit(0, "client_1", "report", "dock", 1), Cancel(5, "client_1")]

    async def main():
        async with open_stage(speed=1) as stage:
            await perform(stage, script)

    with pytest.raises(taskrpc.TaskRpcError, match="Task 1 is SUCCEEDED"):
        on_virtual_time(main)
