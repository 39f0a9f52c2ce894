"""Recording files: whole, unfinished, damaged and foreign ones."""

from __future__ import annotations

import errno
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from taskrpc.qos import QoS
from taskrpc.recording.mcap_file import Recording, RecordingError, RecordingWriter

SECOND = 10**9


def write(path, count=5, *, finish=True):
    writer = RecordingWriter(path)
    text = writer.add_topic("/text", "std_msgs/msg/String", "string data\n", qos=QoS(3))
    told = writer.add_json_topic("/told")
    for number in range(count):
        writer.write(text, b"\0\1\0\0" + bytes([number]), number * SECOND)
    writer.write(told, b'{"a":1}', count * SECOND)
    if finish:
        writer.close()
    return writer


def read(path):
    recording = Recording(path)
    return [(m.topic.name, m.time, m.data) for m in recording.messages()], recording


def test_messages_are_read_as_they_were_written(tmp_path):
    write(tmp_path / "a.mcap")
    messages, recording = read(tmp_path / "a.mcap")
    assert messages[0] == ("/text", 0, b"\0\1\0\0\0")
    assert messages[-1] == ("/told", 5 * SECOND, b'{"a":1}')
    assert len(messages) == 6
    assert (recording.problem, recording.library) == ("", "taskrpc")


def test_topic_keeps_its_type_schema_and_qos(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    qos = QoS(7, "best_effort", "transient_local")
    writer.write(writer.add_topic("/x", "a/msg/B", "int8 x\n", qos=qos), b"x", 1)
    writer.close()
    _, recording = read(tmp_path / "a.mcap")
    (topic,) = recording.topics.values()
    assert (topic.type_name, topic.schema, topic.qos) == ("a/msg/B", "int8 x\n", qos)


def test_file_has_the_summary_and_profile_of_rosbag2(tmp_path):
    write(tmp_path / "a.mcap")
    with open(tmp_path / "a.mcap", "rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary.statistics.message_count == 6
    assert not summary.chunk_indexes


def test_file_of_a_killed_recorder_has_every_message(tmp_path):
    write(tmp_path / "a.mcap", finish=False)
    messages, recording = read(tmp_path / "a.mcap")
    assert len(messages) == 6
    assert recording.problem == (
        "a.mcap is not finished: its recorder still runs, or was killed;"
        " the messages before that are all there"
    )


def test_killed_in_the_middle_of_a_message_loses_only_that_one(tmp_path):
    write(tmp_path / "a.mcap", finish=False)
    path = tmp_path / "a.mcap"
    os.truncate(path, path.stat().st_size - 3)
    messages, recording = read(path)
    assert len(messages) == 5
    assert "its last 35 bytes are an incomplete record" in recording.problem


def test_damaged_bytes_end_the_reading_with_their_place(tmp_path):
    write(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    at = data.index(b"\0\1\0\0\2") - 31
    data[at + 1 : at + 9] = b"\xff" * 8  # the length of the third message
    (tmp_path / "a.mcap").write_bytes(data)
    messages, recording = read(tmp_path / "a.mcap")
    assert len(messages) == 2
    assert recording.problem.startswith(f"a.mcap is damaged after byte {at:,} of {len(data):,} (")


@settings(max_examples=60)
@given(st.data())
def test_any_damage_is_one_sentence_and_never_another_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "a.mcap"
    write(path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(8, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(9, len(content)))])
    _, recording = read(path)
    assert "\n" not in recording.problem


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "is empty; expected an MCAP file"),
        (b"hello world", "is not a recording: expected an MCAP file"),
        (b"SQLite format 3\0", "expected an MCAP file; it is an SQLite file"),
        (b"#ROSBAG V2.0\n", "expected an MCAP file; it is a bag of ROS 1"),
    ],
)
def test_foreign_file_is_refused_with_what_it_is(tmp_path, content, problem):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(RecordingError, match=problem):
        Recording(tmp_path / "x")


def test_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(RecordingError, match=r"cannot read .*x\.mcap: No such file"):
        Recording(tmp_path / "x.mcap")


def test_folder_of_a_bag_is_read_file_after_file(tmp_path):
    for number in (0, 1):
        write(tmp_path / f"bag_{number}.mcap", 2)
    (tmp_path / "metadata.yaml").write_text("")
    messages, recording = read(tmp_path)
    assert len(messages) == 6
    assert len(recording.topics) == 4


def test_folder_without_recordings_says_so(tmp_path):
    (tmp_path / "bag.db3").touch()
    with pytest.raises(RecordingError, match="has none; taskrpc reads MCAP, not SQLite"):
        Recording(tmp_path)


def test_existing_file_is_never_overwritten(tmp_path):
    (tmp_path / "a.mcap").write_text("precious")
    with pytest.raises(RecordingError, match="the file exists already"):
        RecordingWriter(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_text() == "precious"


def test_full_disk_is_one_sentence(tmp_path, monkeypatch):
    writer = write(tmp_path / "a.mcap", finish=False)

    def full(file, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(RecordingError, match=r"cannot write .*a\.mcap: No space left"):
        writer.write(1, b"x", 1)
