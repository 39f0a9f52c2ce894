"""`taskrpc simulate --record` writes the failing run as a recording, which the page plays."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from taskrpc.observe.recording.calls import CallReader
from taskrpc.observe.recording.mcap_file import Recording
from taskrpc.observe.recording.timed_event import NOTES_TOPIC
from taskrpc.observe.recording.timeline import Timeline
from taskrpc.simulation.interpreter.loop import FIRST_DAY
from taskrpc.simulation.run.trace import Event
from taskrpc.simulation.search.protocol import Contents, Explained, ToldCall
from taskrpc.simulation.search.recording import write

pytestmark = pytest.mark.end_to_end

GRIPPER = """
import asyncio
import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

async def main():
    async with taskrpc.Node("gripper") as node:
        async def grasp(request, response):
            print("grasping")
            await asyncio.sleep(0.3)
            response.message = "held"
            return response
        node.create_service(Trigger, "grasp", grasp)
        await node.spin()

asyncio.run(main())
"""
STUDENT = """
import asyncio
import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_client(Trigger, "grasp", timeout=1.0)
        await client.wait_for_service(None)
        for attempt in range(2):
            try:
                await client.call(Trigger.Request())
                return
            except taskrpc.DeadlineExceeded:
                print("again")

asyncio.run(main())
"""
SCENARIO = """
from taskrpc.simulation import Scenario

scenario = Scenario(duration=10.0)
scenario.program("gripper", "gripper.py")
scenario.program("student", "student.py")
scenario.faults(lose_responses={share})

@scenario.finally_
def one_grasp(world):
    assert world.count("gripper", "grasping") <= 1, "it grasped twice"
"""


def simulate(folder: Path, *options: str, share: float = 0.3) -> subprocess.CompletedProcess[str]:
    (folder / "gripper.py").write_text(GRIPPER)
    (folder / "student.py").write_text(STUDENT)
    (folder / "grasp.sim.py").write_text(SCENARIO.format(share=share))
    command = [sys.executable, "-m", "taskrpc", "simulate", "grasp.sim.py", "--jobs", "1"]
    return subprocess.run(
        [*command, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run that fails, and what the command printed."""
    folder = tmp_path_factory.mktemp("run")
    ended = simulate(folder, "--record", "run.mcap")
    assert ended.returncode == 1, ended.stderr
    return folder / "run.mcap", ended


def test_recording_has_the_calls_with_their_requests_and_responses(run):
    path, _ = run
    recording = Recording(path)
    reader = CallReader()
    for message in recording.messages():
        reader.take(message)
    assert recording.problem == ""
    lost, again = reader.calls
    assert (lost.client, lost.service, lost.code) == ("student", "/grasp", "DEADLINE_EXCEEDED")
    assert lost.ms == pytest.approx(1000, abs=1)
    assert (again.client, again.state) == ("student", "ok")
    assert again.ms == pytest.approx(300, abs=1)
    assert "message=held" in again.response


def test_recording_has_the_story_with_its_fault_and_failure(run):
    path, ended = run
    notes = [
        json.loads(each.data)
        for each in Recording(path).messages(keep=lambda topic: topic.name == NOTES_TOPIC)
    ]
    (fault,) = [each for each in notes if each["kind"] == "fault"]
    assert fault["text"] == "response 1 of /grasp lost"
    assert f"{fault['time']:.3f} s  gripper  FAULT: {fault['text']}" in ended.stdout
    assert notes[-1]["kind"] == "failure"
    assert notes[-1]["text"] == "one_grasp: it grasped twice"
    assert [each["text"] for each in notes if each["kind"] == "print"].count("grasping") == 2


def test_recording_begins_on_the_day_of_the_simulated_programs(run):
    path, _ = run
    timeline = Timeline(Recording(path))
    assert timeline.begin == FIRST_DAY
    assert timeline.problem == ""
    times = {event.data["text"]: event.t for event in timeline if event.event == "note"}
    begins = [event.t for event in timeline if event.event == "calls"]
    assert begins[0] < times["response 1 of /grasp lost"] < times["again"]


def test_command_says_how_to_watch_the_recording(run):
    _, ended = run
    assert ended.stderr.splitlines()[-1] == "Recorded. Watch it: taskrpc view run.mcap"


def test_existing_file_is_refused_before_the_search(tmp_path):
    (tmp_path / "run.mcap").write_text("mine")
    ended = simulate(tmp_path, "--record", "run.mcap")
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert "run.mcap: the file exists already" in ended.stderr
    assert (tmp_path / "run.mcap").read_text() == "mine"


def test_missing_folder_is_refused_before_the_search(tmp_path):
    ended = simulate(tmp_path, "--record", "nowhere/run.mcap")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "there is no folder nowhere" in ended.stderr


def test_nothing_is_recorded_if_no_run_fails(tmp_path):
    ended = simulate(tmp_path, "--record", "run.mcap", "--runs", "2", share=0.0)
    assert ended.returncode == 0
    assert "Nothing was recorded: no run failed." in ended.stderr
    assert not (tmp_path / "run.mcap").exists()


def test_json_has_no_contents_of_calls(tmp_path):
    ended = simulate(tmp_path, "--record", "run.mcap", "--json")
    assert "contents" not in json.loads(ended.stdout)["failure"]
    assert (tmp_path / "run.mcap").exists()


def explained(failed_at, contents, **facts):
    """A failing run with these facts."""
    return Explained(
        **{"seed": 1, "kind": "check", "text": "", "faults": [], "groups": [], "in_order": True}
        | {"hash": "", "events": [], "waits": []}
        | {"failed_at": failed_at, "contents": contents}
        | facts
    )


def test_recorded_exception_is_told_by_its_last_line(tmp_path):
    text = 'Traceback (most recent call last):\n  File "a.py", line 1, in main\nKeyError: 7\n'
    events = [Event(0.0, "a", "start", "starts")]
    contents = Contents([], {}, [])
    found = explained(1.5, contents, kind="exception in a", text=text, events=events)
    write(tmp_path / "run.mcap", found)
    *_, last = Recording(tmp_path / "run.mcap").messages()
    assert last.time == (int(FIRST_DAY) * 10 + 15) * 10**8
    assert json.loads(last.data)["text"] == "exception in a: KeyError: 7"


def test_call_that_nobody_answers_is_recorded_as_open(tmp_path):
    calls = [ToldCall(1, "student", "/grasp", 0.5, None, "OK", None)]
    write(tmp_path / "run.mcap", explained(9.0, Contents(calls, {}, [])))
    reader = CallReader()
    for message in Recording(tmp_path / "run.mcap").messages():
        reader.take(message)
    (call,) = reader.calls
    assert (call.client, call.state, call.begin) == ("student", "open", FIRST_DAY + 0.5)
