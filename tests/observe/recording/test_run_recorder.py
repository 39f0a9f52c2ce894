"""The recorder of a run: every call, topic and change; the server never depends on it."""

from __future__ import annotations

import asyncio

import msgspec

import srvgen
from taskrpc.observe.recording import run_recorder
from taskrpc.observe.recording.calls import CALLS_TOPIC, CallEnd
from taskrpc.observe.recording.decisions import (
    DECISIONS_TOPIC,
    PauseChange,
    ProgressMade,
    RunStart,
    TaskChange,
    decision_of,
)
from taskrpc.observe.recording.mcap_file import Recording
from taskrpc.observe.recording.run_recorder import RunRecorder
from taskrpc.robot.tasks.model import TaskState
from tests.observe.recording.conftest import START, Run

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
EVENTS = "/robot_task/_service_event"


def found(path, topic):
    return list(Recording(path).messages(keep=lambda each: each.name == topic))


async def test_each_call_has_its_two_events_and_its_end(recorded_run):
    events = [srvgen.from_cdr(RobotTask.Event, each.data) for each in found(recorded_run, EVENTS)]
    ends = [msgspec.json.decode(m.data, type=CallEnd) for m in found(recorded_run, CALLS_TOPIC)]
    ends = [end for end in ends if end.service == "/robot_task"]
    assert [event.info.sequence_number for event in events] == [
        number for end in ends for number in (end.number, end.number)
    ]
    assert [bool(event.request) for event in events] == [True, False] * len(ends)
    assert ends[0].began >= START
    assert {(end.client, end.code) for end in ends} == {("/ada", "OK")}


async def test_every_service_has_its_topic_from_the_start(recorded_run):
    list((recording := Recording(recorded_run)).messages())
    names = {topic.name for topic in recording.topics.values()}
    decisions = [decision_of(message) for message in found(recorded_run, DECISIONS_TOPIC)]
    (run,) = (each for each in decisions if isinstance(each, RunStart))
    assert {f"{service}/_service_event" for service in run.services} <= names


async def test_every_state_of_a_task_is_recorded_in_order(recorded_run):
    decisions = [decision_of(message) for message in found(recorded_run, DECISIONS_TOPIC)]
    changes = [each.task for each in decisions if isinstance(each, TaskChange)]
    states = [task.state for task in changes if task.task_id == 2]
    assert states == [TaskState.QUEUED, TaskState.RUNNING, TaskState.SUCCEEDED]


async def test_task_that_ends_with_the_server_is_recorded_as_interrupted(recorded_run):
    last = decision_of(found(recorded_run, DECISIONS_TOPIC)[-1])
    assert last.task.state is TaskState.INTERRUPTED


async def test_refused_call_is_recorded_with_its_error(tmp_path):
    async with Run(tmp_path / "a.mcap") as run:
        await run.call("show", "ShowTask", task_id=3)
    (end,) = (msgspec.json.decode(m.data, type=CallEnd) for m in found(run.path, CALLS_TOPIC))
    assert (end.code, end.task_id) == ("OK", 3)


async def test_recorder_that_the_disk_refuses_leaves_the_server_alone(tmp_path, caplog):
    async with Run(tmp_path / "a.mcap") as run:
        run.recorder.fail(OSError("No space left on device"))
        assert await run.submit("move", "dock", 5) == 1
    assert caplog.text.count("the recording ends here: No space left on device") == 1


async def test_change_of_a_task_is_written_before_its_response(tmp_path):
    async with Run(tmp_path / "a.mcap") as run:
        number = await run.submit("move", "dock", 5)
        await run.call("pause", "PauseTasks")
        written = [decision_of(message) for message in found(run.path, DECISIONS_TOPIC)]
    changes = [each.task.task_id for each in written if isinstance(each, TaskChange)]
    assert changes[-1] == number
    assert [each.paused for each in written if isinstance(each, PauseChange)] == [False, True]


async def test_progress_is_written_at_most_every_20_ms(tmp_path):
    async with Run(tmp_path / "a.mcap") as run:
        number = await run.submit("move", "warehouse", 5)
        await asyncio.sleep(1)
        given = [0.5 + each / 10_000 for each in range(100)]
        for progress in given:
            run.server.manager.repository.announce_progress(number, progress)
    written = [decision_of(message) for message in found(run.path, DECISIONS_TOPIC)]
    made = [each.progress for each in written if isinstance(each, ProgressMade)]
    assert made
    assert len(set(made) & set(given)) <= 1


async def test_mistake_of_the_recorder_ends_the_recording_only(tmp_path, caplog, monkeypatch):
    async with Run(tmp_path / "a.mcap") as run:
        monkeypatch.setattr(run_recorder, "TaskChange", lambda task: 1 / 0)
        assert await run.submit("move", "dock", 5) == 1
    assert caplog.text.count("the recording ends here: division by zero") == 1


async def test_recorder_of_a_server_that_did_not_start_leaves_no_file(tmp_path):
    recorder = RunRecorder(tmp_path / "a.mcap")
    recorder.journal(PauseChange(False))
    await recorder.close()
    await recorder.close()
    assert not list(tmp_path.iterdir())
