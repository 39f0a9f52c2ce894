"""`taskrpc task` against a task server in memory and virtual time."""

from __future__ import annotations

import asyncio
import json

import pytest

from taskrpc.cli.robot.task.task_services import TaskRefused, TaskServices
from taskrpc.cli.shared.command import Exit, UsageError, exit_code
from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import OutcomeUnknown
from tests.cli.robot.task.conftest import parsed, task

KEYS = {"task_id", "task_type", "target", "priority", "state", "estimated_time"}


async def test_submit_prints_the_response_of_the_lecture(lab, lines):
    assert await task("submit", "move", "warehouse", 8) == Exit.DONE
    assert lines() == ["Task queued: move (task 1, done in 9.8 s)"]


async def test_refused_task_is_an_error_with_the_text_of_the_server(lab):
    with pytest.raises(TaskRefused, match=r"^Invalid task: fly \(expected move, scan or report\)$"):
        await task("submit", "fly", "moon")
    assert exit_code(TaskRefused("no")) == Exit.ERROR


async def test_list_has_the_running_task_first_and_then_the_queue_in_order(lab, lines):
    for argv in (("move", "warehouse", 8), ("scan", "area_a", 9), ("report", " central ", 3)):
        await task("submit", *argv)
    await asyncio.sleep(1)
    await task("submit", "move", "3 3", 10)
    lines()
    await task("list")
    head, *rows = lines()
    assert head.split() == ["task", "what", "priority", "state", "done", "in", "client"]
    assert [row.split()[0] for row in rows] == ["2", "4", "1", "3"]
    assert rows[0].split()[4] == "RUNNING"
    await task("list", "--json")
    found = json.loads(lines()[0])
    assert [row["task_id"] for row in found] == [2, 4, 1, 3]
    assert all(row.keys() >= KEYS for row in found)
    assert found[3]["target"] == " central "
    times = [row["estimated_time"] for row in found]
    assert times == sorted(times)


async def test_ended_tasks_are_listed_last_and_only_on_request(lab, lines):
    await task("submit", "report", "dock")
    await asyncio.sleep(5)
    await task("submit", "move", "warehouse")
    lines()
    await task("list", "--json")
    assert [row["task_id"] for row in json.loads(lines()[0])] == [2]
    await task("list", "--json", "--all")
    found = json.loads(lines()[0])
    assert [(row["task_id"], row["state"]) for row in found] == [(2, "QUEUED"), (1, "SUCCEEDED")]


async def test_a_list_longer_than_a_page_is_complete_and_has_each_task_once(lab, lines):
    await task("pause")
    async with Remote().node() as node:
        services = TaskServices(node)
        for _ in range(450):
            await services.submit("report", "dock", 5)
    lines()
    await task("list", "--json")
    assert [row["task_id"] for row in json.loads(lines()[0])] == list(range(1, 451))


async def test_empty_list_is_a_line_on_stderr_and_an_empty_json_array(lab, capsys):
    await task("list")
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == (
        "",
        "no task runs or waits; --all lists those that ended\n",
    )
    await task("list", "--json")
    assert capsys.readouterr().out == "[]\n"


async def test_a_shown_scan_has_its_ranges_as_a_list_of_numbers(lab, lines):
    assert await task("submit", "scan", "area_a", "--wait") == Exit.DONE
    lines()
    await task("show", 1, "--json")
    shown = json.loads(lines()[0])
    assert len(shown["result"]["ranges"]) == 360
    assert shown["result"]["pose"]["x"] == pytest.approx(1.8)
    await task("show", 1)
    nearest, furthest = min(shown["result"]["ranges"]), max(shown["result"]["ranges"])
    assert f"  ranges:    360 values from {nearest:g} to {furthest:g}" in lines()


async def test_a_shown_report_has_pose_battery_and_odometer(lab, lines):
    await task("submit", "report", "central", "--wait")
    lines()
    await task("show", 1, "--json")
    shown = json.loads(lines()[0])
    assert shown["result"].keys() == {"pose", "battery", "odometer"}
    assert shown["started"] <= shown["ended"]


async def test_each_change_of_an_estimate_is_a_line_with_its_cause(lab, lines):
    await task("pause")
    await task("submit", "move", "warehouse", 2)
    await task("submit", "move", "station_1", 10)
    lines()
    await task("show", 1, "--json")
    (change,) = json.loads(lines()[0])["estimate_changes"]
    assert change["cause"] == "task 2, priority 10, went ahead"
    await task("show", 1)
    assert f"    +{change['seconds']:.1f} s: task 2, priority 10, went ahead" in lines()


@pytest.mark.parametrize("verb", ["reprioritise", "reprioritize"])
async def test_a_queued_task_moves_to_another_priority_in_either_spelling(lab, lines, verb):
    await task("pause")
    await task("submit", "move", "warehouse", 2)
    await task("submit", "move", "dock", 3)
    lines()
    await task(verb, 1, 9)
    assert lines()[0].startswith("Task 1 has priority 9 (done in ")
    await task("list", "--json")
    assert [row["task_id"] for row in json.loads(lines()[0])] == [1, 2]
    with pytest.raises(TaskRefused, match=r"^Invalid priority: 11 "):
        await task(verb, 1, 11)


async def test_pause_resume_and_stop_report_the_state_of_the_robot(lab, lines):
    await task("submit", "move", "warehouse")
    await asyncio.sleep(1)
    for verb in ("pause", "resume", "stop"):
        await task(verb)
    assert lines()[1:] == [
        "The queue is paused",
        "The queue is resumed",
        "The robot is stopped and the queue is paused; task 1 was cancelled"
        " (taskrpc task requeue 1 runs it again)",
    ]


async def test_submit_wait_prints_the_states_and_ends_with_the_task(lab, capsys):
    assert await task("submit", "move", "warehouse", "--wait") == Exit.DONE
    printed = capsys.readouterr()
    assert printed.out == "task 1  move warehouse  priority 5  SUCCEEDED\n"
    assert [line.split("  ")[3] for line in printed.err.splitlines()] == ["QUEUED", "RUNNING"]


async def test_submit_wait_fails_if_the_task_is_cancelled(lab, lines):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait"))
    await asyncio.sleep(1)
    await task("cancel", 1)
    assert await waiting == Exit.ERROR
    assert lines()[-1].startswith("task 1  move warehouse  priority 5  CANCELED  cancelled by ")


async def test_interrupted_wait_reports_that_the_task_continues(lab, capsys):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait"))
    await asyncio.sleep(1)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert capsys.readouterr().err.endswith(
        "task 1 continues; to cancel it: taskrpc task cancel 1\n"
    )
    await asyncio.sleep(20)
    await task("show", 1)
    assert "  state:     SUCCEEDED" in capsys.readouterr().out.splitlines()


async def test_submit_wait_continues_after_a_restart_and_reports_the_interruption(lab, capsys):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait"))
    await asyncio.sleep(1)
    await lab.stop()
    await asyncio.sleep(1)
    await lab.start()
    assert await waiting == Exit.ERROR
    printed = capsys.readouterr()
    assert "INTERRUPTED  the server ended while it ran" in printed.out
    assert "the task server has ended; waiting for its next start...\n" in printed.err


async def test_submit_wait_ends_if_the_server_does_not_restart_in_time(lab):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait", "--timeout", 3))
    await asyncio.sleep(1)
    await lab.stop()
    with pytest.raises(OutcomeUnknown, match="did not come back within 3 s"):
        await waiting


async def test_watch_prints_each_state_once_and_continues_after_a_restart(lab, capsys):
    watching = asyncio.create_task(task("watch"))
    await asyncio.sleep(1)
    await task("submit", "report", "dock")
    await asyncio.sleep(5)
    await task("submit", "move", "warehouse")
    await asyncio.sleep(1)
    await lab.stop()
    await asyncio.sleep(60)
    await lab.start()
    await asyncio.sleep(1)
    await task("pause")
    await asyncio.sleep(1)
    watching.cancel()
    printed = capsys.readouterr()
    told = [line[10:] for line in printed.out.splitlines() if "Task" not in line]
    states = [line.split("  ")[3] for line in told if line.startswith("task")]
    assert states[:2] == ["QUEUED", "RUNNING"]
    assert states.count("SUCCEEDED") == 1
    assert states[-1] == "INTERRUPTED"
    assert told[-1] == "the queue is paused"
    assert printed.err.splitlines() == [
        "the task server has ended; waiting for its next start...",
        "the task server is back",
    ]


async def test_watch_of_one_task_prints_no_other_task(lab, lines):
    await task("submit", "report", "dock")
    watching = asyncio.create_task(task("watch", 1, "--json"))
    await asyncio.sleep(5)
    await task("submit", "move", "warehouse")
    await asyncio.sleep(30)
    watching.cancel()
    told = [json.loads(line) for line in lines() if line.startswith("{")]
    assert {each["task_id"] for each in told} == {1}
    assert told[-1]["state"] == "SUCCEEDED"


@pytest.mark.parametrize(
    "argv",
    [
        ("submit", "move"),
        ("submit", "move", "dock", "high"),
        ("show",),
        ("show", "one"),
        ("cancel",),
        ("reprioritise", "1"),
        ("list", "--timeout", "0"),
        ("list", "--timeout", "soon"),
        ("fly",),
    ],
)
def test_invalid_command_line_is_refused_with_the_usage(argv):
    with pytest.raises(UsageError) as error:
        parsed(*argv)
    assert error.value.usage.startswith("usage: taskrpc task")
