"""`taskrpc bag`: what users type, the output of ros2 bag, and one line for each mistake."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest

import srvgen
from srvgen.classes.loader import search
from taskrpc.introspection import service_event
from taskrpc.recording.mcap_file import Recording, RecordingWriter
from taskrpc.recording.schemas import schema_text

String = srvgen.load("std_msgs/msg/String")
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
ADD_EVENT = "example_interfaces/srv/AddTwoInts_Event"
START = 1_700_000_000 * 10**9
PATIENCE = 60


@pytest.fixture
def recording(tmp_path):
    """Three messages, one a tenth of a second, and one call."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    text = writer.add_topic("/chatter", String._TYPE, schema_text(String._TYPE, search()))
    calls = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    for number in range(3):
        data = srvgen.to_cdr(String(data=f"hello {number}"))
        writer.write(text, data, START + number * 10**8)
    for at, step, message in (
        (START + 300_000_000, "REQUEST_RECEIVED", {"request": Add.Request(a=2, b=3)}),
        (START + 313_000_000, "RESPONSE_SENT", {"response": Add.Response(sum=5)}),
    ):
        event = service_event(Add, step, at, [7] * 16, 1, **message)
        writer.write(calls, srvgen.to_cdr(event), at)
    writer.close()
    return writer.path


@pytest.fixture
def bag(run):
    return lambda *argv: run("bag", *map(str, argv))


def test_info_prints_what_ros2_bag_info_prints(bag, recording):
    code, out, err = bag("info", recording)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[1] == "Files:             a.mcap"
    assert lines[4] == "Duration:          0.313000000s"
    assert lines[5].endswith(" (1700000000.000000000)")
    assert lines[7:11] == [
        "Messages:          5",
        "Topic information: Topic: /chatter | Type: std_msgs/msg/String | Count: 3"
        " | Serialization Format: cdr",
        "Services:          1",
        "Service information: Service: /add | Type: example_interfaces/srv/AddTwoInts"
        " | Event Count: 2 | Serialization Format: cdr",
    ]


def test_info_for_programs_is_json(bag, recording):
    found = json.loads(bag("info", recording, "--json")[1])
    assert found["topics"] == [{"name": "/chatter", "type": "std_msgs/msg/String", "count": 3}]
    assert found["services"][0]["events"] == 2
    assert (found["messages"], found["problem"]) == (5, "")


def test_info_can_print_only_the_topics(bag, recording):
    assert bag("info", recording, "-t")[1] == "/chatter\n"


def cut(recording):
    """Cut the file in the middle of the call, as a killed recorder may."""
    os.truncate(recording, recording.read_bytes().index(b"hello 2") + 40)


def test_info_of_an_unfinished_file_says_what_is_missing(bag, recording):
    cut(recording)
    code, out, err = bag("info", recording)
    assert code == 0
    assert "Messages:          3\n" in out
    assert err.startswith("WARNING: a.mcap is not finished: its recorder still runs")


@pytest.mark.real_time
def test_play_publishes_the_messages_again(bag, recording):
    code, out, err = bag("play", recording, "--rate", "10", "--delay", "0")
    assert (code, out, err) == (0, "", "played 5 messages\n")


@pytest.mark.real_time
def test_play_of_an_unfinished_file_plays_the_rest_and_says_so(bag, recording):
    cut(recording)
    code, _, err = bag("play", recording, "--rate", "10", "--delay", "0")
    assert code == 0
    assert err.splitlines()[0].startswith("WARNING: a.mcap is not finished")
    assert err.splitlines()[1] == "played 3 messages"


@pytest.mark.real_time
def test_play_of_nothing_is_a_mistake(bag, recording):
    code, _, err = bag("play", recording, "--topics", "/other", "--delay", "0")
    assert code == 1
    assert err == f"{recording}: no message was played; taskrpc bag info lists the topics\n"


def test_sequence_is_a_mermaid_diagram(bag, recording):
    code, out, err = bag("sequence", recording)
    assert (code, err) == (0, "")
    assert out == (
        "sequenceDiagram\n"
        "    participant p1 as client 1\n"
        "    participant p2 as /add\n"
        "    p1->>p2: 0.000 s  a=2 b=3\n"
        "    p2-->>p1: 0.013 s  sum=5 (13 ms)\n"
    )


def test_sequence_without_calls_is_a_mistake(bag, recording):
    code, out, err = bag("sequence", recording, "--services", "/other")
    assert (code, out) == (1, "")
    assert err == f"{recording}: no call was recorded\n"


@pytest.mark.parametrize("verb", ["info", "play", "sequence"])
@pytest.mark.parametrize(
    ("content", "problem"),
    [(None, "cannot read"), ("", "is empty"), ("hello", "is not a recording: expected an MCAP")],
)
def test_foreign_file_is_one_line(bag, tmp_path, verb, content, problem):
    if content is not None:
        (tmp_path / "x.mcap").write_text(content)
    code, out, err = bag(verb, tmp_path / "x.mcap")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert problem in err


@pytest.mark.parametrize(
    ("argv", "problem"),
    [
        ([], "expected topics to record, or --all, --services SERVICE, --regex REGEX"),
        (["--regex", "("], "--regex: expected a regular expression, got '('"),
        (["-a", "-s", "sqlite3"], "invalid choice: 'sqlite3'"),
        (["a topic"], "Invalid topic name"),
    ],
)
def test_record_refuses_wrong_usage(bag, tmp_path, monkeypatch, argv, problem):
    monkeypatch.chdir(tmp_path)
    code, _, err = bag("record", *argv)
    assert code in (1, 2)
    assert problem in err
    assert not list(tmp_path.iterdir())


def test_record_keeps_an_existing_file(bag, recording):
    code, _, err = bag("record", "-a", "-o", recording)
    assert code == 1
    assert "the file exists already; choose another name or remove it" in err


PROGRAM = """
import asyncio, sys
import srvgen, taskrpc
String = srvgen.load("std_msgs/msg/String")
async def main():
    async with taskrpc.Node("talker") as node:
        publisher = node.create_publisher(String, "/chatter")
        node.create_timer(0.02, lambda: publisher.publish(String(data="hello")))
        await node.spin()
taskrpc.run(main())
"""


@pytest.mark.real_time
@pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_record_writes_until_it_is_ended(bag, tmp_path, number):
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "taskrpc", "bag", "record", "/chatter", "-o", str(path)]
    with (
        subprocess.Popen([sys.executable, "-c", PROGRAM]) as talker,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder,
    ):
        try:
            ends = time.monotonic() + PATIENCE
            while not path.exists() or path.stat().st_size < 2_000:
                assert time.monotonic() < ends
                time.sleep(0.02)
            recorder.send_signal(number)
            _, err = recorder.communicate(timeout=PATIENCE)
        finally:
            talker.kill()
            recorder.kill()
    assert err.startswith(f"recording to {path}; Ctrl-C ends it\nrecording /chatter\n")
    recording = Recording(path)
    messages = list(recording.messages())
    assert len(messages) > 5
    assert srvgen.from_cdr(String, messages[-1].data).data == "hello"
    if number == signal.SIGINT:
        assert re.search(rf"recorded {len(messages)} messages in {path}\n$", err)
        assert (recorder.returncode, recording.problem) == (0, "")
    else:
        assert "is not finished" in recording.problem
