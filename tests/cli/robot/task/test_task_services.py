"""The commands find the services of a task server, wait for them, and report their errors."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import json

import pytest

import srvgen
import taskrpc
from taskrpc.cli.robot.task.task_services import TaskRefused
from taskrpc.cli.shared.command import Exit, NotFound, OutputLost, exit_code
from taskrpc.errors import ServiceUnavailable, TypeMismatch
from tests.cli.robot.task.conftest import Lab, task


@pytest.mark.parametrize("verb", ["show", "watch"])
async def test_an_unknown_task_is_not_found(lab, verb):
    with pytest.raises(NotFound, match=r"^There is no task 99$"):
        await task(verb, 99)


@pytest.mark.parametrize("verb", ["cancel", "requeue", "drop"])
async def test_an_order_for_an_unknown_task_is_refused(lab, verb):
    with pytest.raises(TaskRefused, match=r"^There is no task 99$"):
        await task(verb, 99)


async def test_other_tasks_are_changed_if_the_server_refuses_one(lab, lines):
    await task("pause")
    await task("submit", "move", "dock")
    lines()
    with pytest.raises(TaskRefused, match=r"^There is no task 7\nThere is no task 8$"):
        await task("cancel", 7, 1, 8)
    assert lines() == ["Task 1 was cancelled"]
    await task("requeue", 1)
    assert lines() == ["Task queued: move (the queue is paused) (done in 0.1 s)"]
    await task("drop", 1, "--json")
    assert json.loads(lines()[0]) == {"success": True, "message": "Task 1 was cancelled"}


async def test_missing_server_is_reported_after_the_wait_with_a_hint(capsys):
    expected = r"^no server offers /robot_task \(waited 3 s\)"
    with pytest.raises(ServiceUnavailable, match=expected) as e:
        await task("list", "--timeout", 3)
    assert exit_code(e.value) == Exit.NOT_RUN
    assert "taskrpc-server" in e.value.__notes__[0]
    assert "taskrpc-server offers it" in capsys.readouterr().err


async def test_command_waits_for_a_server_that_starts_in_time(lines):
    lab = Lab()
    asyncio.get_running_loop().call_later(2, lambda: asyncio.ensure_future(lab.start()))
    assert await task("submit", "report", "dock") == Exit.DONE
    await lab.stop()


async def test_task_services_may_have_another_name(lines):
    lab = Lab(service_name="lab/robot")
    await lab.start()
    await task("submit", "report", "dock", "--service", "lab/robot")
    assert lines()[0].startswith("Task queued: report (task 1,")
    await lab.stop()


async def test_service_of_another_type_is_a_type_mismatch():
    trigger = srvgen.load("std_srvs/srv/Trigger")
    async with taskrpc.Node("other", transport="memory") as node:
        node.create_service(trigger, "robot_task", lambda _, response: response)
        with pytest.raises(TypeMismatch, match="/robot_task is offered as std_srvs/srv/Trigger"):
            await task("list")


class LostOutput(io.StringIO):
    """Standard output that cannot be written."""

    def __init__(self, error):
        super().__init__()
        self._error = error

    def write(self, text):
        raise self._error


def output_fails(error):
    return contextlib.redirect_stdout(LostOutput(error))


DISK_FULL = OSError(errno.ENOSPC, "No space left on device")
FULL = "but cannot write to standard output: No space left on device"


@pytest.mark.parametrize("options", [(), ("--json",)])
async def test_task_whose_answer_cannot_be_written_is_reported_as_submitted(lab, options):
    lost = f"^task 1 was submitted, {FULL}$"
    with output_fails(DISK_FULL), pytest.raises(OutputLost, match=lost) as caught:
        await task("submit", "move", "warehouse", *options)
    assert exit_code(caught.value) == Exit.ERROR
    assert len((await lab.store.load()).tasks) == 1


async def test_task_whose_end_cannot_be_written_is_reported_with_its_end(lab):
    lost = rf"^task 1 .*SUCCEEDED.*, {FULL}$"
    with output_fails(DISK_FULL), pytest.raises(OutputLost, match=lost):
        await task("submit", "move", "warehouse", "--wait")


async def test_every_task_is_cancelled_even_if_no_answer_can_be_written(lab):
    for _ in range(3):
        await task("submit", "move", "warehouse")
    with output_fails(DISK_FULL), pytest.raises(OutputLost) as lost:
        await task("cancel", 2, 3)
    assert str(lost.value).splitlines() == [f"Task {n} was cancelled, {FULL}" for n in (2, 3)]


async def test_every_task_is_cancelled_even_if_the_reader_of_the_output_has_gone(lab, lines):
    for _ in range(3):
        await task("submit", "move", "warehouse")
    with output_fails(BrokenPipeError(errno.EPIPE, "Broken pipe")):
        assert await task("cancel", 2, 3) == Exit.DONE
    lines()
    await task("cancel", 3)
    assert lines() == ["Task 3 is cancelled already"]
