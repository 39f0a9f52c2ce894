"""`taskrpc bag`: what users type, the output of ros2 bag, and one line for each mistake."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time

import pytest

import srvgen
from taskrpc.observe.recording.mcap_file import Recording
from tests.cli.ros.bag.conftest import String, cut

PATIENCE = 60


@pytest.mark.real_time
def test_play_publishes_the_messages_again(bag, recording):
    code, out, err = bag("play", recording, "--rate", "10", "--delay", "0")
    assert (code, out, err) == (0, "", "played 5 messages\n")


@pytest.mark.real_time
def test_play_of_an_unfinished_file_plays_its_messages_and_prints_a_warning(bag, recording):
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


@pytest.mark.real_time
def test_a_bag_in_sqlite_is_read_and_played(bag, tmp_path):
    folder = tmp_path / "old"
    folder.mkdir()
    with contextlib.closing(sqlite3.connect(folder / "old_0.db3")) as database:
        database.execute("CREATE TABLE topics(id, name, type, serialization_format)")
        database.execute("CREATE TABLE messages(id, topic_id, timestamp, data)")
        database.execute("INSERT INTO topics VALUES (1, '/chatter', 'std_msgs/msg/String', 'cdr')")
        row = (1, 1, 10**18, srvgen.to_cdr(String(data="hello")))
        database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
        database.commit()
    for place in (folder, folder / "old_0.db3"):
        code, out, err = bag("info", place)
        assert (code, err) == (0, "")
        assert "Storage id:        sqlite3\n" in out
        assert "Topic: /chatter | Type: std_msgs/msg/String | Count: 1" in out
        assert bag("play", place, "--delay", "0") == (0, "", "played 1 messages\n")
