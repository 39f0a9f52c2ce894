"""Recordings and readers that we did not write: rosbags, mcap-ros2-support, and mcap itself."""

from __future__ import annotations

import asyncio
import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype

import srvgen
import taskrpc
from srvgen.classes.loader import search
from taskrpc.observe.recording.mcap_file import Recording, RecordingWriter
from taskrpc.observe.recording.player import Player, PlaySettings
from taskrpc.observe.recording.recorder import message_class
from taskrpc.observe.recording.schemas import schema_text
from tests.observe.recording.conftest import _recorded, recorded_run  # noqa: F401

SECOND = 10**9
EMPTY = "structure_needs_at_least_one_member"
"""The field that rosbags gives a message without fields."""


def unsigned(name, value):
    """The value of a field; rosbags reads the elements of `byte[]` as signed numbers."""
    return [each % 256 for each in value] if name == "byte_values_default" else value


def plain(value):
    """A message of any of the three libraries as dicts, lists and numbers."""
    if hasattr(value, "_FIELDS"):
        return plain(srvgen.to_builtins(value))
    if hasattr(value, "__dataclass_fields__"):
        names = [field.name for field in dataclasses.fields(value)]
        hidden = {"__msgtype__", EMPTY}
        fields = [name for name in names if name not in hidden and not name.isupper()]
        return {name: unsigned(name, plain(getattr(value, name))) for name in fields}
    if hasattr(value, "__slots__") and hasattr(value, "_full_text"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, bytes | bytearray):
        return list(value)
    if isinstance(value, list | tuple | np.ndarray) or hasattr(value, "typecode"):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return "nan" if math.isnan(value) else round(value, 6)
    return value


def ours(path):
    """Each recorded CDR message: topic, time, and its value as taskrpc reads it."""
    found = Recording(path)
    return [
        (m.topic.name, m.time, plain(srvgen.from_cdr(message_class(m.topic.type_name), m.data)))
        for m in found.messages(keep=lambda topic: topic.encoding == "cdr")
    ]


def with_rosbags(path):
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        connections = [
            each for each in reader.connections if each.ext.serialization_format == "cdr"
        ]
        for connection, time, data in reader.messages(connections=connections):
            # rosbags knows the schema pkg/srv/Name_Event as pkg/srv/msg/Name_Event.
            message = reader.deserialize(data, normalize_msgtype(connection.msgtype))
            yield connection.topic, time, plain(message)


def with_mcap_ros2(path, topics):
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=topics):
            yield channel.topic, message.log_time, plain(decoded)


async def test_rosbags_reads_every_message_of_a_recorded_run(recorded_run):  # noqa: F811
    expected = ours(recorded_run)
    assert list(with_rosbags(recorded_run)) == expected
    topics = {topic for topic, _, _ in expected}
    assert {"/robot_task/pose", "/robot_task/events", "/robot_task/_service_event"} <= topics


async def test_mcap_ros2_support_reads_every_topic_that_is_no_service(recorded_run):  # noqa: F811
    # It refuses the schema name RobotTask_Event: an underscore in a type name.
    expected = [each for each in ours(recorded_run) if not each[0].endswith("_service_event")]
    topics = {topic for topic, _, _ in expected}
    assert list(with_mcap_ros2(recorded_run, topics)) == expected


@pytest.mark.parametrize("package", ["test_msgs", "geometry_msgs", "sensor_msgs", "std_msgs"])
def test_default_message_of_every_type_is_read_by_both(tmp_path, package):
    names = [name for name in search().interfaces(package) if "/msg/" in name]
    unreadable = {"test_msgs/msg/WStrings", "test_msgs/msg/Constants", "test_msgs/msg/Empty"}
    names = [name for name in names if name not in unreadable]
    writer = RecordingWriter(tmp_path / "a.mcap")
    for number, name in enumerate(names):
        topic = writer.add_topic(f"/t{number}", name, schema_text(name, search()))
        writer.write(topic, srvgen.to_cdr(srvgen.load(name)()), number)
    writer.close()
    expected = ours(writer.path)
    assert list(with_rosbags(writer.path)) == expected
    assert list(with_mcap_ros2(writer.path, None)) == expected


@pytest.mark.real_time
def test_file_of_a_killed_recorder_is_read_up_to_its_last_message(tmp_path):
    path = tmp_path / "killed.mcap"
    program = (
        "import os, signal, sys\n"
        "from taskrpc.observe.recording.mcap_file import RecordingWriter\n"
        "writer = RecordingWriter(sys.argv[1])\n"
        "topic = writer.add_topic('/n', 'std_msgs/msg/UInt8', 'uint8 data\\n')\n"
        "for number in range(1000):\n"
        "    writer.write(topic, bytes([0, 1, 0, 0, number % 256]), number)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", program, path], check=False)
    recording = Recording(path)
    assert len(list(recording.messages())) == 1000
    assert "is not finished" in recording.problem


@pytest.fixture
def rosbag2(tmp_path):
    """A bag in rosbag2's format, written by rosbags."""
    store = get_typestore(Stores.ROS2_JAZZY)
    string = store.types["std_msgs/msg/String"]
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/chatter", string.__msgtype__, typestore=store)
        for number in range(5):
            data = store.serialize_cdr(string(f"hello {number}"), string.__msgtype__)
            bag.write(connection, 1_000 * SECOND + number * SECOND // 10, data)
    return path


async def test_bag_of_rosbag2_plays_here(rosbag2):
    string = srvgen.load("std_msgs/msg/String")
    heard = []
    async with (
        taskrpc.Node("player", transport="memory", token="player") as node,
        taskrpc.Node("listener", transport="memory", token="listener") as listener,
    ):
        listener.create_subscription(string, "/chatter", lambda each: heard.append(each.data))
        await Player(node, Recording(rosbag2), PlaySettings(delay=1.0)).play()
        await asyncio.sleep(1)
    assert heard == [f"hello {number}" for number in range(5)]
