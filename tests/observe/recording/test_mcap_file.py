"""Recording files: whole, unfinished, damaged and foreign ones."""

from __future__ import annotations

import errno
import os
import re
import struct
import tracemalloc

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from taskrpc.observe.recording import mcap_file
from taskrpc.observe.recording.mcap_file import Recording, RecordingError, RecordingWriter, one_line
from taskrpc.qos import QoS
from tests.properties import examples

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


def read(path, shown=bytes):
    recording = Recording(path)
    return [(m.topic.name, m.time, shown(m.data)) for m in recording.messages()], recording


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


@settings(max_examples=examples(60))
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
def test_error_names_the_format_of_a_file_that_is_no_recording(tmp_path, content, problem):
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
    with pytest.raises(RecordingError, match="has none; its SQLite files are for `taskrpc bag`"):
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


# Files of other programs, and crafted ones


def record(written):
    builder = RecordBuilder()
    written.write(builder)
    return builder.end()


SCHEMA = records.Schema(1, b"string data\n", "ros2msg", "std_msgs/msg/String")
MESSAGE = record(records.Message(1, SECOND, b"\0\1\0\0a", SECOND, 0))
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
CHANNEL = record(records.Channel(1, "/text", "cdr", {}, 1))


def foreign(path, *parts, topic="/text", metadata=None, schema=SCHEMA):
    """Write a file of another program: a topic, then these parts."""
    channel = records.Channel(1, topic, "cdr", metadata or {}, schema.id)
    head = [records.Header("ros2", "another"), schema, channel]
    end = [records.DataEnd(0), records.Footer(0, 0, 0)]
    known, rest = b"".join(map(record, head)), b"".join(map(record, end))
    path.write_bytes(MCAP0_MAGIC + known + b"".join(parts) + rest + MCAP0_MAGIC)
    return path


def chunk(compression, contents, size=None):
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
    data = packed[compression](contents)
    size = len(contents) if size is None else size
    return record(records.Chunk(compression, data, 0, 0, 0, size))


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_messages_in_chunks_are_read(tmp_path, compression):
    unknown = b"\x80" + (3).to_bytes(8, "little") + b"abc"
    contents = MESSAGE + unknown + MESSAGE
    messages, recording = read(foreign(tmp_path / "a.mcap", chunk(compression, contents), MESSAGE))
    assert (messages, recording.problem) == ([("/text", SECOND, b"\0\1\0\0a")] * 3, "")


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize(
    ("size", "problem"),
    [
        (100, "the contents of a chunk do not have the length that it says"),
        (2**62, "a chunk of 4,611,686,018,427,387,904 bytes; expected at most 268,435,456"),
    ],
)
def test_chunk_that_expands_beyond_its_declared_size_takes_no_memory(
    tmp_path, compression, size, problem
):
    bomb = chunk(compression, bytes(2**26), size)
    path = foreign(tmp_path / "a.mcap", MESSAGE, bomb, MESSAGE)
    tracemalloc.start()
    try:
        messages, recording = read(path)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(messages) == 1
    assert problem in recording.problem
    assert most < 2**23


def test_short_file_whose_chunks_expand_to_gigabytes_is_not_read_to_its_end(tmp_path):
    """Each of 64 chunks has 48 MiB, but only five kilobytes in the file."""
    bomb = chunk("zstd", record(records.Message(1, SECOND, bytes(2**20), SECOND, 0)) * 48)
    path = foreign(tmp_path / "a.mcap", *[bomb] * 64)
    messages, recording = read(path, len)
    assert path.stat().st_size < 512_000
    assert 48 <= len(messages) < 48 * 10
    assert "a.mcap is damaged after byte " in recording.problem
    assert "(chunks of " in recording.problem


def test_short_file_with_millions_of_records_is_not_read_to_its_end(tmp_path):
    """The records of unknown types and of known topics count too."""
    for contents in (MESSAGE, b"\x80" + bytes(8), CHANNEL):
        path = foreign(tmp_path / "a.mcap", chunk("zstd", contents * 70_000) * 100)
        messages, recording = read(path)
        assert len(messages) < 200_000
        assert re.search(r"more than 1\d\d,\d\d\d records in the chunks", recording.problem)


def test_short_file_with_megabytes_about_topics_is_not_read_to_its_end(tmp_path):
    topics = [records.Channel(each, "/a", "cdr", {"b": " " * 2**20}, 1) for each in range(2, 99)]
    path = foreign(tmp_path / "a.mcap", *(chunk("zstd", record(topic)) for topic in topics))
    _, recording = read(path)
    assert len(recording.topics) == 8
    assert "descriptions of topics of " in recording.problem


def test_chunk_in_a_chunk_is_not_read(tmp_path):
    inner = chunk("zstd", MESSAGE)
    messages, recording = read(foreign(tmp_path / "a.mcap", chunk("zstd", inner + MESSAGE)))
    assert (len(messages), recording.problem) == (1, "")


def test_long_recording_of_small_messages_and_a_blank_map_are_read(tmp_path):
    """The contents of both compress very well."""
    times = range(SECOND, 121_000 * SECOND, SECOND)
    clock = (MESSAGE_HEAD.pack(5, 27, 1, 0, time, time) + b"\0\1\0\0a" for time in times)
    path = foreign(tmp_path / "a.mcap", chunk("zstd", b"".join(clock)))
    messages, recording = read(path, len)
    assert (len(messages), recording.problem) == (len(times), "")
    blank = records.Message(1, SECOND, b"\xff" * 2**24, SECOND, 0)
    messages, recording = read(foreign(path, chunk("zstd", record(blank)) * 3), len)
    assert (len(messages), recording.problem) == (3, "")


def test_small_records_of_a_chunk_are_not_all_in_memory_at_once(tmp_path):
    path = foreign(tmp_path / "a.mcap", chunk("zstd", record(SCHEMA) * 10_000))
    tracemalloc.start()
    try:
        read(path)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 2**21


@pytest.mark.parametrize(
    ("contents", "problem"),
    [
        (b"\5" + (2**63).to_bytes(8, "little"), "a record of 9,223,372,036,854,775,808 bytes"),
        (b"\5" + (3).to_bytes(8, "little") + b"abc", "requires a buffer of at least 22 bytes"),
        (b"\3" + (8).to_bytes(8, "little") + b"\1\0abcdef", "a field is longer than its record"),
        (chunk("", MESSAGE[:-1]), "a record is longer than its chunk"),
        (record(records.Chunk("br\x1b", b"abc", 0, 0, 0, 3)), r"compression 'br\x1b' is unknown"),
    ],
)
def test_impossible_length_is_damage_and_the_messages_before_it_are_read(
    tmp_path, contents, problem
):
    messages, recording = read(foreign(tmp_path / "a.mcap", MESSAGE, contents, MESSAGE))
    assert len(messages) == 1
    assert recording.problem.startswith("a.mcap is damaged after byte ")
    assert problem in recording.problem


@pytest.mark.parametrize(
    "text",
    ["- depth: true", "- depth: 2024-99-99", "- depth: " + "9" * 5000, "[" * 3_000, "- [1]"],
)
def test_unreadable_qos_is_the_default_and_loses_no_message(tmp_path, text):
    path = foreign(tmp_path / "a.mcap", MESSAGE, metadata={"offered_qos_profiles": text})
    messages, recording = read(path)
    assert (len(messages), recording.problem) == (1, "")
    assert recording.topics[1].qos == QoS()


def test_very_long_qos_is_not_parsed(tmp_path):
    text = "- depth: 3\n" + "#" * 20_000
    path = foreign(tmp_path / "a.mcap", MESSAGE, metadata={"offered_qos_profiles": text})
    assert read(path)[1].topics[1].qos == QoS()


def test_only_the_qos_of_the_first_publisher_counts(tmp_path):
    for others in (0, 1, 500):
        text = "- depth: 3\n  reliability: best_effort\n" + "- depth: 7\n" * others
        path = foreign(tmp_path / "a.mcap", metadata={"offered_qos_profiles": text})
        assert read(path)[1].topics[1].qos == QoS(3, "best_effort")


def test_qos_of_a_topic_that_is_only_listed_is_not_parsed(tmp_path, monkeypatch):
    """Parsing takes milliseconds, and a file can have thousands of topics."""
    monkeypatch.setattr(mcap_file, "qos_from", pytest.fail)
    path = foreign(tmp_path / "a.mcap", MESSAGE, metadata={"offered_qos_profiles": "- depth: 3"})
    messages, recording = read(path)
    assert (len(messages), len(recording.topics)) == (1, 1)


def test_topics_of_one_type_share_the_text_of_its_schema(tmp_path):
    second = record(records.Channel(2, "/other", "cdr", {}, 1))
    _, recording = read(foreign(tmp_path / "a.mcap", second))
    assert recording.topics[1].schema is recording.topics[2].schema


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX's")
def test_named_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.mcap")
    for path in (tmp_path / "a.mcap", tmp_path):
        with pytest.raises(RecordingError, match=r"a\.mcap: expected a file, or a folder"):
            Recording(path)


def test_text_of_an_error_is_one_short_line():
    assert (
        one_line(ValueError("a\n  b\x1b[31m\u202e" + "x" * 1000)) == "a b?[31m?" + "x" * 230 + "…"
    )
    assert one_line(MemoryError()) == "MemoryError"
