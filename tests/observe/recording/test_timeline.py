"""A recording as events of the live page: what the page would have shown at each time."""

from __future__ import annotations

import gzip
import json
from collections import Counter

import msgspec
import pytest

import srvgen
from srvgen.classes.loader import search
from taskrpc.core.introspection import service_event
from taskrpc.observe.recording.calls import CALLS_TOPIC
from taskrpc.observe.recording.mcap_file import Recording, RecordingError, RecordingWriter
from taskrpc.observe.recording.schemas import schema_text
from taskrpc.observe.recording.timeline import Timeline
from tests.observe.recording.conftest import START

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
ADD_EVENT = "example_interfaces/srv/AddTwoInts_Event"


@pytest.fixture
def timeline(recorded_run):
    return Timeline(Recording(recorded_run))


def named(timeline, name):
    return [event for event in timeline if event.event == name]


async def test_events_are_in_order_of_time_and_begin_with_hello(timeline):
    events = list(timeline)
    times = [event.t for event in events]
    assert times == sorted(times)
    assert events[0] is timeline.hello
    assert {event.event for event in events} == {
        *("hello", "tasks", "robot", "path", "scan", "task", "calls", "graph")
    }
    assert all(timeline.begin <= time <= timeline.end for time in times)


async def test_hello_has_the_server_the_map_and_the_span_of_the_recording(timeline):
    data = timeline.hello.data
    assert data["server"]["service"] == "/robot_task"
    assert data["server"]["node"] == "/task_server"
    assert data["map"]["size"] == (10.0, 8.0)
    assert data["map"]["places"]["dock"] == (1.0, 1.0)
    assert data["recording"]["name"] == "run.mcap"
    assert data["recording"]["begin"] == timeline.begin
    assert data["control"] is False


async def test_queue_is_shown_in_the_order_of_execution_with_its_estimates(timeline):
    shown = timeline.state_at(START + 1.5)["tasks"].data
    assert shown["running"]["task_id"] == 3
    assert [task["task_id"] for task in shown["queue"]] == [1, 2, 4]
    estimates = [task["estimated_time"] for task in (shown["running"], *shown["queue"])]
    assert estimates == sorted(estimates)
    assert (shown["queued"], shown["more"], shown["paused"]) == (3, 0, False)
    assert shown["running"]["client"] == "/ada"


async def test_estimate_of_the_running_task_counts_down_to_its_end(timeline):
    found = []
    for event in named(timeline, "tasks"):
        running = event.data["running"]
        if running and running["task_id"] == 2 and running["state"] == "RUNNING":
            found.append(event.t + running["estimated_time"])
    assert len(found) > 10
    ends = [task["ended"] for task in named(timeline, "tasks")[-1].data["ended"]]
    assert max(found) - min(found) < 0.02
    assert min(abs(found[0] - end) for end in ends) < 0.1


async def test_pause_and_its_reason_are_shown(timeline):
    shown = [event.data for event in named(timeline, "tasks")]
    assert any(data["paused"] for data in shown)
    causes = {move["cause"] for data in shown for move in data["moves"]}
    assert "the queue was paused" in causes
    assert "task 3, priority 9, went ahead" in causes


async def test_ended_tasks_are_counted_by_state(timeline):
    data = named(timeline, "tasks")[-1].data
    assert data["counts"] == Counter(task["state"] for task in data["ended"])
    assert data["counts"]["SUCCEEDED"] >= 4
    assert data["counts"]["CANCELED"] >= 1
    ended = [task["ended"] for task in data["ended"]]
    assert ended == sorted(ended, reverse=True)


async def test_robot_moves_along_its_path(timeline):
    (first, *_) = [event.data for event in named(timeline, "path") if event.data["points"]]
    assert first["task_id"] == 3
    assert first["points"][0] == [1.0, 1.0]
    assert first["points"][-1] == [3.0, 4.0]
    moving = [event.data for event in named(timeline, "robot") if event.data["moving"]]
    assert len(moving) > 50
    standing = timeline.state_at(START + 28)["robot"].data
    assert (standing["moving"], standing["remaining"]) == (False, 0.0)
    assert standing["odometer"] > 5
    assert standing["battery"] < 100


async def test_scan_is_shown_at_its_end(timeline):
    scan = named(timeline, "scan")[0].data
    assert scan["task_id"] == 2
    assert len(scan["ranges"]) == 360


async def test_calls_are_listed_with_their_client_and_task(timeline):
    calls = [call for event in named(timeline, "calls") for call in event.data["calls"]]
    assert [call["id"] for call in calls] == sorted({call["id"] for call in calls})
    first = calls[0]
    assert (first["client"], first["service"]) == ("/ada", "/robot_task")
    assert (first["state"], first["task_id"], first["deadline_ms"]) == ("ok", 1, 10000.0)
    assert calls[4]["task_id"] is None
    assert "/robot_task/cancel" in {call["service"] for call in calls}
    assert named(timeline, "calls")[-1].data["stats"]["total"] == len(calls)


async def test_graph_shows_the_server_and_its_clients(timeline):
    nodes = {node["name"]: node for node in named(timeline, "graph")[-1].data["nodes"]}
    assert "/robot_task/cancel" in nodes["/task_server"]["services"]
    assert "/robot_task" in nodes["/ada"]["clients"]


async def test_events_between_two_times_are_those_events(timeline):
    begin, end = START + 3.0, START + 6.0
    found = list(timeline.events_between(begin, end))
    assert found == [event for event in timeline if begin <= event.t < end]
    assert found
    assert list(timeline.events_between(end, begin)) == []


async def test_lines_are_json_with_time_name_and_data(timeline):
    text = b"".join(timeline.lines())
    lines = [json.loads(line) for line in text.splitlines()]
    assert lines == msgspec.to_builtins(list(timeline)[1:])
    assert {"t", "event", "data"} == set(lines[0])
    assert gzip.decompress(b"".join(timeline.gzipped())) == text


async def test_result_and_changes_of_an_ended_task_are_shown_at_its_end(timeline):
    results = {event.data["task_id"]: event for event in named(timeline, "task")}
    assert results[3].data["result"]["pose"]["x"] == pytest.approx(3.0, abs=0.1)
    assert len(results[2].data["result"]["ranges"]) == 360
    changes = [change["cause"] for change in results[2].data["changes"]]
    assert "the queue was paused" in changes
    ended = {task["task_id"]: task for task in named(timeline, "tasks")[-1].data["ended"]}
    assert results[3].t == pytest.approx(ended[3]["ended"], abs=0.1)


async def test_unfinished_recording_is_shown_up_to_its_end_and_says_so(recorded_run):
    data = recorded_run.read_bytes()
    recorded_run.write_bytes(data[: len(data) // 2])
    timeline = Timeline(Recording(recorded_run))
    assert named(timeline, "tasks")
    assert "is not finished" in timeline.hello.data["recording"]["problem"]


def test_recording_of_a_foreign_program_shows_its_calls(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    topic = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    for number in range(3):
        for step, seconds in ("REQUEST_SENT", 0), ("RESPONSE_RECEIVED", 0.1):
            at = round((START + number + seconds) * 1e9)
            event = service_event(Add, step, at, [number] * 16, 1, request=Add.Request(a=1))
            writer.write(topic, srvgen.to_cdr(event), at)
    writer.close()
    timeline = Timeline(Recording(writer.path))
    calls = [call for event in named(timeline, "calls") for call in event.data["calls"]]
    assert {call["client"] for call in calls} == {"client 1", "client 2", "client 3"}
    assert Counter(call["state"] for call in calls) == {"open": 3, "ok": 3}
    assert timeline.hello.data["map"] is None


def test_recording_without_messages_is_refused(tmp_path):
    RecordingWriter(tmp_path / "a.mcap").close()
    with pytest.raises(RecordingError, match="has no message"):
        Timeline(Recording(tmp_path / "a.mcap"))


async def test_contradictory_decision_ends_the_queue_and_is_named(recorded_run):
    data = recorded_run.read_bytes()
    recorded_run.write_bytes(data.replace(b'"method":"begin"', b'"method":"bogus"'))
    timeline = Timeline(Recording(recorded_run))
    assert "cannot be shown: the recorded step 'bogus' is impossible here" in timeline.problem
    assert named(timeline, "tasks")
    assert named(timeline, "calls")


def test_problem_of_a_recording_without_decisions_names_the_missing_parts(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    topic = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    event = service_event(Add, "REQUEST_SENT", START, [1] * 16, 1, request=Add.Request(a=1))
    writer.write(topic, srvgen.to_cdr(event), START)
    writer.close()
    hello = Timeline(Recording(writer.path)).hello.data
    assert hello["recording"]["problem"] == (
        "a.mcap has no decisions of a task server, so there is no map and no queue;"
        " the page shows the calls and the nodes"
    )


def test_damaged_end_of_a_call_is_left_out(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    writer.write(writer.add_json_topic(CALLS_TOPIC), b"{", START)
    writer.close()
    assert not named(Timeline(Recording(writer.path)), "calls")
