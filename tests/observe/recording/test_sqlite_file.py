"""Bags in SQLite are read as MCAP files are: topics, messages, definitions, and damage."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import pytest

import srvgen
from taskrpc.observe.recording.mcap_file import Recording, RecordingError
from taskrpc.observe.recording.player import playable_class
from taskrpc.observe.recording.sqlite_file import SqliteRecording, open_recording
from taskrpc.qos import QoS

String = srvgen.load("std_msgs/msg/String")
LATCHED = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
SPEED = "float64 metres_per_second\n"


def write_bag(path, rows):
    """Write a file as rosbag2 of ROS 2 Iron does; each row is (topic id, time, data)."""
    with closing(sqlite3.connect(path)) as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
            " serialization_format TEXT, offered_qos_profiles TEXT, type_description_hash TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            " data BLOB)"
        )
        database.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT,"
            " encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT)"
        )
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, 'cdr', ?, '')",
            [
                (1, "/chatter", "std_msgs/msg/String", ""),
                (2, "/speed", "unknown_msgs/msg/Speed", LATCHED),
                (3, "/silent", "std_msgs/msg/String", ""),
            ],
        )
        database.execute(
            "INSERT INTO message_definitions"
            " VALUES (1, 'unknown_msgs/msg/Speed', 'ros2msg', ?, '')",
            [SPEED],
        )
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows
        )
        database.commit()


def text(word):
    return srvgen.to_cdr(String(data=word))


@pytest.fixture
def bag(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    write_bag(folder / "bag_0.db3", [(1, 30, text("c")), (2, 20, b"speed"), (1, 10, text("a"))])
    write_bag(folder / "bag_1.db3", [(1, 40, text("d"))])
    return folder


def test_the_messages_of_each_file_are_in_the_order_of_time(bag):
    recording = open_recording(bag)
    found = [(each.topic.name, each.time) for each in recording.messages()]
    assert found == [("/chatter", 10), ("/speed", 20), ("/chatter", 30), ("/chatter", 40)]
    assert {topic.name for topic in recording.topics.values()} == {"/chatter", "/speed", "/silent"}
    assert (recording.storage_id, recording.problem) == ("sqlite3", "")
    assert recording.size == sum(file.stat().st_size for file in bag.iterdir())


def test_topics_that_are_not_kept_are_skipped(bag):
    kept = open_recording(bag).messages(keep=lambda topic: topic.name == "/speed")
    assert [each.data for each in kept] == [b"speed"]
    assert not list(open_recording(bag).messages(keep=lambda _: False))


def test_a_topic_has_its_qos_and_the_recorded_definition(bag):
    topic = next(
        open_recording(bag / "bag_0.db3").messages(keep=lambda t: t.name == "/speed")
    ).topic
    assert topic.qos == QoS(1, "reliable", "transient_local")
    assert playable_class(topic).get_fields_and_field_types() == {"metres_per_second": "double"}


def test_a_file_of_another_name_is_recognized_by_its_content(bag):
    renamed = (bag / "bag_0.db3").rename(bag / "run")
    assert isinstance(open_recording(renamed), SqliteRecording)
    (bag / "run.mcap").write_bytes(b"\x89MCAP0\r\n")
    assert isinstance(open_recording(bag / "run.mcap"), Recording)


@pytest.mark.parametrize(
    "row", [(1, -1, b""), (1, 2**63 - 1, "text"), (1, 20, None), (1, "soon", b"")]
)
def test_a_damaged_message_ends_the_reading_with_a_sentence(tmp_path, row):
    write_bag(tmp_path / "a.db3", [row])
    recording = open_recording(tmp_path / "a.db3")
    assert not list(recording.messages())
    assert recording.problem == "a.db3 is damaged: a message has no data or an impossible time"


def test_what_cannot_be_read_is_an_error_of_one_sentence(bag, tmp_path):
    with pytest.raises(RecordingError, match=r"cannot read .*missing\.db3: No such file"):
        open_recording(tmp_path / "missing.db3")
    (tmp_path / "text.db3").write_text("hello, this is no bag" * 100)
    with pytest.raises(RecordingError, match=r"cannot read .*text\.db3: file is not a database"):
        list(open_recording(tmp_path / "text.db3").messages())
    with closing(sqlite3.connect(tmp_path / "other.db3")) as other:
        other.execute("CREATE TABLE tasks(id)")
    with pytest.raises(RecordingError, match=r"cannot read .*other\.db3: no such table: topics"):
        list(open_recording(tmp_path / "other.db3").messages())
    described = "rosbag2_bagfile_information: {compression_mode: MESSAGE}"
    (bag / "metadata.yaml").write_text(described)
    with pytest.raises(RecordingError, match="has compressed messages, which taskrpc does not"):
        open_recording(bag)
