"""`taskrpc task` against a task server in memory and virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import json

import pytest
from rich.console import Console

import srvgen
import taskrpc
from taskrpc.cli.shared.command import Exit, NotFound, OutputLost, UsageError, exit_code
from taskrpc.cli.shared.parsing import Parser
from taskrpc.cli.shared.remote import Remote
from taskrpc.cli.task import progress
from taskrpc.cli.task.command_line import configure, perform
from taskrpc.cli.task.progress import ProgressBar
from taskrpc.cli.task.task_services import TaskRefused, TaskServices
from taskrpc.cli.task.view import aligned, as_object, details, news, printable
from taskrpc.errors import OutcomeUnknown, ServiceUnavailable, TypeMismatch
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.tasks import MemoryStore, TaskServer

TASK_INFO = srvgen.load("taskrpc_interfaces/msg/TaskInfo")
KEYS = {"task_id", "task_type", "target", "priority", "state", "estimated_time"}


@pytest.fixture(autouse=True)
def _in_memory(monkeypatch):
    monkeypatch.setattr(Remote, "node", lambda self: taskrpc.Node("_cli", transport="memory"))


class Lab:
    """A task server that can be ended and started again over the same store."""

    def __init__(self, **settings):
        self.store = MemoryStore()
        self._settings = settings
        self._node = self._server = None

    async def start(self):
        # A token of its own: a client's connection ends with this server, as between programs.
        self._node = taskrpc.Node("task_server", transport="memory", token="server")
        await self._node.start()
        robot = KinematicRobot(default_world())
        # Virtual like all other time: servers that follow each other must not share an instant.
        clock = asyncio.get_running_loop().time
        self._server = TaskServer(
            self._node,
            robot,
            self.store,
            wall_clock=lambda: 1_700_000_000 + clock(),
            **self._settings,
        )
        await self._server.start()

    async def stop(self):
        if self._node:
            await self._server.close()
            await self._node.destroy()
            self._node = None


@pytest.fixture
async def lab():
    lab = Lab()
    await lab.start()
    yield lab
    await lab.stop()


def parsed(*argv):
    parser = Parser(prog="taskrpc task")
    configure(parser)
    return parser.parse_args(argv)


async def task(*argv):
    return await perform(parsed(*map(str, argv)))


@pytest.fixture
def lines(capsys):
    """What was printed to stdout since the last look, line by line."""
    return lambda: capsys.readouterr().out.splitlines()


async def test_a_submitted_task_is_answered_in_the_lectures_words(lab, lines):
    assert await task("submit", "move", "warehouse", 8) == Exit.DONE
    assert lines() == ["Task queued: move (task 1, done in 9.8 s)"]


async def test_a_refused_task_is_an_error_in_the_servers_own_words(lab):
    with pytest.raises(TaskRefused, match=r"^Invalid task: fly \(expected move, scan or report\)$"):
        await task("submit", "fly", "moon")
    assert exit_code(TaskRefused("no")) == Exit.ERROR


async def test_the_list_has_what_runs_first_and_then_the_queue_in_the_order_of_run(lab, lines):
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


async def test_what_has_ended_is_listed_only_on_request_and_last(lab, lines):
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


async def test_an_empty_list_says_so_on_stderr_and_is_an_empty_array_in_json(lab, capsys):
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


@pytest.mark.parametrize("verb", ["show", "watch"])
async def test_an_unknown_task_is_not_found(lab, verb):
    with pytest.raises(NotFound, match=r"^There is no task 99$"):
        await task(verb, 99)


@pytest.mark.parametrize("verb", ["cancel", "requeue", "drop"])
async def test_an_order_for_an_unknown_task_is_refused(lab, verb):
    with pytest.raises(TaskRefused, match=r"^There is no task 99$"):
        await task(verb, 99)


async def test_one_refused_order_does_not_keep_the_others_from_being_done(lab, lines):
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


async def test_pause_resume_and_stop_say_what_became_of_the_robot(lab, lines):
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


async def test_waiting_for_a_task_tells_its_states_and_ends_with_its_end(lab, capsys):
    assert await task("submit", "move", "warehouse", "--wait") == Exit.DONE
    printed = capsys.readouterr()
    assert printed.out == "task 1  move warehouse  priority 5  SUCCEEDED\n"
    assert [line.split("  ")[3] for line in printed.err.splitlines()] == ["QUEUED", "RUNNING"]


async def test_waiting_for_a_task_that_somebody_cancels_is_an_error(lab, lines):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait"))
    await asyncio.sleep(1)
    await task("cancel", 1)
    assert await waiting == Exit.ERROR
    assert lines()[-1].startswith("task 1  move warehouse  priority 5  CANCELED  cancelled by ")


async def test_whoever_stops_waiting_is_told_that_the_task_goes_on(lab, capsys):
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


async def test_waiting_survives_a_server_that_restarts_and_tells_the_interruption(lab, capsys):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait"))
    await asyncio.sleep(1)
    await lab.stop()
    await asyncio.sleep(1)
    await lab.start()
    assert await waiting == Exit.ERROR
    printed = capsys.readouterr()
    assert "INTERRUPTED  the server ended while it ran" in printed.out
    assert "the task server has ended; waiting for its next start...\n" in printed.err


async def test_waiting_ends_when_the_server_does_not_come_back_in_time(lab):
    waiting = asyncio.create_task(task("submit", "move", "warehouse", "--wait", "--timeout", 3))
    await asyncio.sleep(1)
    await lab.stop()
    with pytest.raises(OutcomeUnknown, match="did not come back within 3 s"):
        await waiting


async def test_a_watcher_sees_each_state_once_and_survives_a_restart(lab, capsys):
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


async def test_a_watcher_of_one_task_hears_of_no_other(lab, lines):
    await task("submit", "report", "dock")
    watching = asyncio.create_task(task("watch", 1, "--json"))
    await asyncio.sleep(5)
    await task("submit", "move", "warehouse")
    await asyncio.sleep(30)
    watching.cancel()
    told = [json.loads(line) for line in lines() if line.startswith("{")]
    assert {each["task_id"] for each in told} == {1}
    assert told[-1]["state"] == "SUCCEEDED"


async def test_without_a_server_the_command_waits_and_then_says_how_to_start_one(capsys):
    with pytest.raises(ServiceUnavailable, match=r"^nobody offers /robot_task \(waited 3 s\)") as e:
        await task("list", "--timeout", 3)
    assert exit_code(e.value) == Exit.NOT_RUN
    assert "taskrpc-server" in e.value.__notes__[0]
    assert "taskrpc-server offers it" in capsys.readouterr().err


async def test_a_server_that_comes_in_time_is_waited_for(lines):
    lab = Lab()
    asyncio.get_running_loop().call_later(2, lambda: asyncio.ensure_future(lab.start()))
    assert await task("submit", "report", "dock") == Exit.DONE
    await lab.stop()


async def test_the_services_may_have_another_name(lines):
    lab = Lab(service_name="lab/robot")
    await lab.start()
    await task("submit", "report", "dock", "--service", "lab/robot")
    assert lines()[0].startswith("Task queued: report (task 1,")
    await lab.stop()


async def test_a_service_of_another_type_is_no_task_server():
    trigger = srvgen.load("std_srvs/srv/Trigger")
    async with taskrpc.Node("other", transport="memory") as node:
        node.create_service(trigger, "robot_task", lambda _, response: response)
        with pytest.raises(TypeMismatch, match="/robot_task is offered as std_srvs/srv/Trigger"):
            await task("list")


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
def test_a_command_line_that_makes_no_sense_is_refused_with_its_usage(argv):
    with pytest.raises(UsageError) as error:
        parsed(*argv)
    assert error.value.usage.startswith("usage: taskrpc task")


def info(**fields):
    return TASK_INFO(**{"task_id": 3, "task_type": "move", "target": "dock", **fields})


def test_texts_of_others_cannot_steer_the_terminal():
    nasty = info(target="a\x1b[2Jb\n", client="\x07", message="x\ry", state="FAILED")
    assert all(printable(line) == line for line in [news(nasty), *details(nasty)])
    assert as_object(nasty)["target"] == "a\x1b[2Jb\n"


def test_an_instant_that_is_not_set_is_null():
    assert as_object(info())["ended"] is None


def test_a_result_of_a_users_own_robot_is_shown_whatever_it_holds():
    found = {"ok": True, "path": [[0, 1]], "name": "x\n", "many": list(range(20)), "none": None}
    lines = details(info(result=json.dumps(found), state="SUCCEEDED"))
    assert lines[-5:] == [
        "  ok:        true",
        "  path:      [[0, 1]]",
        '  name:      "x\\n"',
        "  many:      20 values from 0 to 19",
        "  none:      null",
    ]


def test_columns_stand_below_each_other():
    assert aligned([("a", "bb"), ("100", "c")], right={0}) == ["  a  bb", "100  c"]


def test_the_bar_shows_what_is_left_and_that_the_queue_is_paused():
    console = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    with ProgressBar(console) as bar:
        bar.show(info(state="RUNNING", progress=0.5, estimated_time=12.34), paused=False)
        bar._bars.refresh()
        bar.show(info(state="PAUSED", progress=0.5), paused=True)
    drawn = console.file.getvalue()
    assert "task 3  move dock  RUNNING" in drawn
    assert "50 %  done in 12.3 s" in drawn
    assert "the queue is paused" in drawn


def test_where_stderr_is_no_terminal_there_is_no_bar():
    assert isinstance(progress.progress(), progress.ProgressLines)


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
