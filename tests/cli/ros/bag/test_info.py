"""`taskrpc bag info` and `taskrpc bag sequence` print what a recording contains."""

from __future__ import annotations

import json

from taskrpc.observe.recording.mcap_file import RecordingWriter
from tests.cli.ros.bag.conftest import cut


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


def test_info_of_an_unfinished_file_says_what_is_missing(bag, recording):
    cut(recording)
    code, out, err = bag("info", recording)
    assert code == 0
    assert "Messages:          3\n" in out
    assert err.startswith("WARNING: a.mcap is not finished: its recorder still runs")


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
    assert err == f"{recording} has no calls of /other; taskrpc bag info lists its services\n"


def test_names_from_a_file_cannot_control_the_terminal(bag, tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    writer.add_topic("/a\x1b[31m\nb", "std_msgs/msg/\x9bString", "string data\n")
    writer.write(writer.add_topic("/c\x07", "x/msg/Y", ""), b"", 1)
    writer.close()
    assert "Topic: /a?[31m?b | Type: std_msgs/msg/?String | Count: 0" in bag("info", writer.path)[1]
    assert bag("info", writer.path, "-t")[1] == "/a?[31m?b\n/c?\n"
    assert bag("play", writer.path, "-d", "0")[2].startswith("WARNING: /c? was not played: ")
