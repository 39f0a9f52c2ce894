"""Bags of our rosbag2_py in readers that we did not write, and bags that rosbags wrote."""

from __future__ import annotations

import importlib

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.ros.packages.conftest import ros_names  # noqa: F401

SECOND = 10**9


@pytest.fixture
def bags(ros_names):  # noqa: F811
    return importlib.import_module("rosbag2_py")


@pytest.fixture
def serialization(ros_names):  # noqa: F811
    return importlib.import_module("rclpy.serialization")


@pytest.fixture
def written(bags, serialization, tmp_path):
    """A bag of our writer: strings, poses, and a topic without messages."""
    qos = importlib.import_module("rclpy.qos")
    string = importlib.import_module("std_msgs.msg").String
    pose = importlib.import_module("geometry_msgs.msg").PoseStamped
    writer = bags.SequentialWriter()
    path = tmp_path / "my_bag"
    writer.open(bags.StorageOptions(str(path), "mcap"), bags.ConverterOptions("", ""))
    types = {
        "/chatter": "std_msgs/msg/String",
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/empty": "sensor_msgs/msg/LaserScan",
    }
    latched = qos.QoSProfile(depth=3, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
    for number, (name, type_name) in enumerate(types.items()):
        writer.create_topic(
            bags.TopicMetadata(number, name, type_name, "cdr", [latched] if number == 0 else [])
        )
    for number in range(4):
        time = (1_000 + number) * SECOND
        writer.write("/chatter", serialization.serialize_message(string(data=f"ä{number}")), time)
        moved = pose()
        moved.header.frame_id, moved.pose.position.x = "map", float(number)
        writer.write("/pose", serialization.serialize_message(moved), time + 1)
    writer.close()
    return path


def test_rosbags_reads_the_folder(written):
    with Reader(written) as reader:  # with the metadata.yaml
        assert (reader.message_count, reader.ros_distro) == (8, "taskrpc")
        assert (reader.start_time, reader.duration) == (1_000 * SECOND, 3 * SECOND + 2)
        counts = {each.topic: each.msgcount for each in reader.connections}
        assert counts == {"/chatter": 4, "/pose": 4, "/empty": 0}
        [profile] = reader.connections[0].ext.offered_qos_profiles
        assert (profile.depth, profile.durability.name) == (3, "TRANSIENT_LOCAL")
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([written], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        for each in reader.connections:
            assert each.digest == store.hash_rihs01(each.msgtype)
        found = [
            (connection.topic, time - 1_000 * SECOND, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]
    assert [value.data for topic, _, value in found if topic == "/chatter"] == [
        f"ä{number}" for number in range(4)
    ]
    assert [(time, value.pose.position.x) for topic, time, value in found if topic == "/pose"] == [
        (number * SECOND + 1, float(number)) for number in range(4)
    ]


def test_mcap_reads_the_file(written):
    with open(written / "my_bag_0.mcap", "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_summary().statistics.message_count == 8
        texts = [value.data for *_, value in reader.iter_decoded_messages(topics=["/chatter"])]
    assert texts == [f"ä{number}" for number in range(4)]


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_bag_of_rosbags_is_read(bags, serialization, tmp_path, plugin, version):
    store = get_typestore(Stores.ROS2_JAZZY)
    string = store.types["std_msgs/msg/String"]
    path = tmp_path / "bag"
    with Writer(path, version=version, storage_plugin=plugin) as bag:
        chatter = bag.add_connection("/chatter", string.__msgtype__, typestore=store)
        bag.add_connection("/other", string.__msgtype__, typestore=store)
        for number in range(5):
            data = store.serialize_cdr(string(f"hello {number}"), string.__msgtype__)
            bag.write(chatter, (1_000 + number) * SECOND, data)
    reader = bags.SequentialReader()
    storage_id = plugin.name.lower()
    reader.open(bags.StorageOptions(str(path), storage_id), bags.ConverterOptions("cdr", "cdr"))
    types = {each.name: each.type for each in reader.get_all_topics_and_types()}
    assert types == {"/chatter": "std_msgs/msg/String", "/other": "std_msgs/msg/String"}
    reader.set_filter(bags.StorageFilter(topics=["/chatter"]))
    own = importlib.import_module("std_msgs.msg").String
    texts = []
    while reader.has_next():
        topic, data, time = reader.read_next()
        assert (topic, time) == ("/chatter", (1_000 + len(texts)) * SECOND)
        texts.append(serialization.deserialize_message(data, own).data)
    assert texts == [f"hello {number}" for number in range(5)]
    metadata = bags.Info().read_metadata(str(path), storage_id)
    assert (metadata.message_count, metadata.duration.nanoseconds) == (5, 4 * SECOND)
    assert metadata.storage_identifier == storage_id


@pytest.mark.parametrize("name", ["FILE", "MESSAGE"])
def test_compressed_bag_of_rosbags_is_refused(bags, tmp_path, name):
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / "bag"
    bag = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(CompressionMode[name], CompressionFormat.ZSTD)
    with bag:
        bag.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
    with pytest.raises(RuntimeError, match=f"has compressed {name.lower()}s, which taskrpc does"):
        bags.SequentialReader().open_uri(str(path))
