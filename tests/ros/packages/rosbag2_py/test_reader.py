"""Reading bags: MCAP and SQLite, filters, the ROS tutorial, and the names that are not here."""

import importlib
import sqlite3
import sys

import pytest

import srvgen
from taskrpc.observe.recording.mcap_file import RecordingWriter

SECOND = 10**9


@pytest.fixture
def bags(ros_names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return importlib.import_module("rosbag2_py")


def text(value):
    return srvgen.to_cdr(srvgen.load("std_msgs/msg/String")(data=value))


@pytest.fixture
def bag(bags):
    """Messages a0, b0, a1, b1, a2, b2, one each second from 1 s on; the topic c is empty."""
    writer = bags.SequentialWriter()
    writer.open(bags.StorageOptions("my_bag"), bags.ConverterOptions())
    for name in "abc":
        writer.create_topic(
            bags.TopicMetadata(name=name, type="std_msgs/msg/String", serialization_format="cdr")
        )
    for number in range(6):
        name = "ab"[number % 2]
        writer.write(name, text(f"{name}{number // 2}"), (number + 1) * SECOND)
    writer.close()
    return "my_bag"


@pytest.fixture
def reader(bags, bag):
    reader = bags.SequentialReader()
    reader.open(bags.StorageOptions(uri=bag, storage_id="mcap"), bags.ConverterOptions("", ""))
    return reader


def rest(reader):
    found = []
    while reader.has_next():
        topic, data, time = reader.read_next()
        value = srvgen.from_cdr(srvgen.load("std_msgs/msg/String"), data).data
        assert value[0] == topic
        found.append((value, time // SECOND))
    return [f"{value} {time}" for value, time in found]


def test_messages_come_with_topic_data_and_time(bags, reader):
    assert reader.read_next() == ("a", text("a0"), SECOND)
    assert rest(reader) == ["b0 2", "a1 3", "b1 4", "a2 5", "b2 6"]
    with pytest.raises(RuntimeError, match="the bag has no more messages"):
        reader.read_next()
    reader.close()
    with pytest.raises(RuntimeError, match="expected an open bag"):
        reader.has_next()


def test_filter_holds_from_the_position_on(bags, reader):
    reader.set_filter(bags.StorageFilter(topics=["b"]))
    assert reader.read_next()[0] == "b"
    reader.set_filter(bags.StorageFilter(topics=["c"]))
    assert not reader.has_next()  # has looked at all the rest
    reader.reset_filter()
    assert rest(reader) == ["a1 3", "b1 4", "a2 5", "b2 6"]


def test_seek_goes_to_a_time_forwards_and_backwards(bags, reader):
    reader.seek(5 * SECOND)
    assert rest(reader) == ["a2 5", "b2 6"]
    reader.seek(4 * SECOND - 1)
    assert reader.read_next() == ("b", text("b1"), 4 * SECOND)
    reader.set_filter(bags.StorageFilter(regex="[b]"))
    assert rest(reader) == ["b2 6"]


@pytest.mark.parametrize("has_metadata", [True, False])
def test_metadata_and_topics(bags, bag, tmp_path, has_metadata):
    if not has_metadata:
        (tmp_path / bag / "metadata.yaml").unlink()
    metadata = bags.Info().read_metadata(bag, "mcap")
    assert metadata.message_count == 6
    assert metadata.starting_time.nanoseconds == SECOND
    assert metadata.duration.nanoseconds == 5 * SECOND
    assert metadata.bag_size == (tmp_path / bag / "my_bag_0.mcap").stat().st_size
    counts = [
        (each.topic_metadata.name, each.message_count)
        for each in metadata.topics_with_message_count
    ]
    assert counts == [("a", 3), ("b", 3), ("c", 0)]
    reader = bags.SequentialReader()
    reader.open_uri(bag)
    types = {each.name: each.type for each in reader.get_all_topics_and_types()}
    assert types == dict.fromkeys("abc", "std_msgs/msg/String")
    [profile] = reader.get_all_topics_and_types()[0].offered_qos_profiles
    assert profile.depth == 10


def test_file_of_taskrpc_bag_record_is_read(bags, tmp_path, capsys):
    writer = RecordingWriter(tmp_path / "run.mcap")
    topic = writer.add_topic("a", "std_msgs/msg/String", "string data\n")
    writer.write(topic, text("a0"), SECOND)
    reader = bags.SequentialReader()
    reader.open_uri("run.mcap")
    assert rest(reader) == ["a0 1"]
    assert "WARNING: run.mcap is not finished" in capsys.readouterr().err
    writer.close()


def sqlite_bag(folder, *, has_qos=True):
    folder.mkdir()
    database = sqlite3.connect(folder / "bag_0.db3")
    qos = ", offered_qos_profiles TEXT" if has_qos else ""
    database.execute(f"CREATE TABLE topics(id INTEGER, name, type, serialization_format{qos})")
    database.execute("CREATE TABLE messages(id INTEGER, topic_id, timestamp, data BLOB)")
    row = (1, "a", "std_msgs/msg/String", "cdr", *([""] if has_qos else []))
    database.execute(f"INSERT INTO topics VALUES ({', '.join('?' * len(row))})", row)
    for number, second in enumerate([2, 1]):
        values = (number, 1, second * SECOND, text(f"a{second}"))
        database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", values)
    database.commit()
    database.close()


@pytest.mark.parametrize("has_qos", [True, False])
def test_sqlite_is_read_in_the_order_of_time(bags, tmp_path, has_qos):
    sqlite_bag(tmp_path / "old", has_qos=has_qos)
    reader = bags.SequentialReader()
    reader.open(bags.StorageOptions("old", "sqlite3"), bags.ConverterOptions("cdr", "cdr"))
    assert rest(reader) == ["a1 1", "a2 2"]
    assert reader.get_metadata().storage_identifier == "sqlite3"
    with pytest.raises(RuntimeError, match="old is a bag of storage_id='sqlite3', expected 'mcap'"):
        reader.open(bags.StorageOptions("old", "mcap"), bags.ConverterOptions("", ""))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("missing", "expected the folder of a bag, 'missing' does not exist"),
        ("empty", "expected a folder with .mcap files, empty has none"),
        ("text.mcap", "text.mcap is not a recording: expected an MCAP file"),
        ("bad.db3", "cannot read bad.db3: file is not a database"),
        ("unclear", "cannot read unclear.metadata.yaml: expected 'rosbag2_bagfile_information'"),
        ("packed", "packed has compressed files, which taskrpc does not read"),
    ],
)
def test_unreadable_bag_is_an_error_of_one_line(bags, bag, tmp_path, name, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("hello, this is no bag")
    (tmp_path / "bad.db3").write_text("hello, this is no bag" * 100)
    for folder in ("unclear", "packed"):
        (tmp_path / folder).mkdir()
    (tmp_path / "unclear/metadata.yaml").write_text("{}")
    whole = (tmp_path / bag / "metadata.yaml").read_text()
    packed = whole.replace("compression_mode: ''", "compression_mode: FILE")
    (tmp_path / "packed/metadata.yaml").write_text(packed)
    reader = bags.SequentialReader()
    with pytest.raises(RuntimeError, match=said) as caught:  # noqa: PT012 - either may raise it
        reader.open_uri(name)
        reader.has_next()
    assert "\n" not in str(caught.value)


def test_reader_of_the_tutorial_publishes_the_recorded_bytes(bags, reader):
    rclpy = importlib.import_module("rclpy")
    string = importlib.import_module("std_msgs.msg").String
    heard = []
    with rclpy.init():
        node = rclpy.create_node("simple_bag_reader")
        publisher = node.create_publisher(string, "chatter", 10)
        node.create_subscription(string, "chatter", lambda each: heard.append(each.data), 10)

        def publish_next():
            while reader.has_next():
                topic, data, _ = reader.read_next()
                if topic == "a":
                    publisher.publish(data)
                    break

        node.create_timer(0.01, publish_next)
        for _ in range(1000):
            rclpy.spin_once(node, timeout_sec=1)
            if len(heard) == 3:
                break
        node.destroy_node()
    assert heard == ["a0", "a1", "a2"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Recorder", "rosbag2_py does not have Recorder: record with .* `taskrpc bag record`"),
        ("Player", "`taskrpc bag play`, or watch it with `taskrpc view`"),
        ("SequentialCompressionReader", "without zstd compression"),
        ("Reindexer", "run the program on a real ROS 2"),
    ],
)
def test_names_that_are_not_here_say_what_to_use(bags, name, said):
    with pytest.raises(ImportError, match=said):
        exec(f"from rosbag2_py import {name}")
    assert not hasattr(bags, "nonsense")


def test_import_without_the_extra_says_what_to_install(ros_names, monkeypatch):
    for name in list(sys.modules):
        if name.startswith(("rosbag2_py", "taskrpc.observe.recording")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mcap", None)
    with pytest.raises(ModuleNotFoundError, match=r"rosbag2_py: .* pip install 'mcap>="):
        importlib.import_module("rosbag2_py")
