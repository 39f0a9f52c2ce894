"""Writing bags: the folder, the errors, and the ROS tutorial."""

import gc
import importlib
import subprocess
import sys
import textwrap

import pytest
import yaml

import srvgen
from taskrpc.observe.recording.mcap_file import Recording

SECOND = 10**9


@pytest.fixture
def bags(ros_names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return importlib.import_module("rosbag2_py")


@pytest.fixture
def serialized(ros_names):
    string = importlib.import_module("std_msgs.msg").String
    serialize = importlib.import_module("rclpy.serialization").serialize_message
    return lambda text: serialize(string(data=text))


def opened(bags, uri="my_bag", storage_id="mcap", **options):
    writer = bags.SequentialWriter()
    writer.open(bags.StorageOptions(uri, storage_id, **options), bags.ConverterOptions("", ""))
    return writer


def topic(bags, name="chatter", type="std_msgs/msg/String", **described):
    values = {"id": 0, "serialization_format": "cdr"} | described
    return bags.TopicMetadata(name=name, type=type, **values)


def described(folder):
    return yaml.safe_load((folder / "metadata.yaml").read_text("utf-8"))[
        "rosbag2_bagfile_information"
    ]


def test_folder_has_the_messages_and_their_description(bags, serialized, tmp_path):
    writer = opened(bags, custom_data={"robot": "7"})
    writer.create_topic(topic(bags))
    writer.create_topic(topic(bags, "/empty"))
    writer.create_topic(topic(bags))
    for number in range(3):
        writer.write("chatter", serialized(f"hello {number}"), (number + 5) * SECOND)
    writer.close()
    writer.close()
    folder = tmp_path / "my_bag"
    assert {each.name for each in folder.iterdir()} == {"my_bag_0.mcap", "metadata.yaml"}
    recording = Recording(folder)
    string = srvgen.load("std_msgs/msg/String")
    found = [(m.topic.name, m.time, srvgen.from_cdr(string, m.data)) for m in recording.messages()]
    assert found[2] == ("chatter", 7 * SECOND, string(data="hello 2"))
    assert recording.problem == ""
    read = described(folder)
    assert (read["version"], read["storage_identifier"]) == (9, "mcap")
    assert read["relative_file_paths"] == ["my_bag_0.mcap"]
    assert read["duration"] == {"nanoseconds": 2 * SECOND}
    assert read["files"][0]["starting_time"] == {"nanoseconds_since_epoch": 5 * SECOND}
    assert read["custom_data"] == {"robot": "7"}
    chatter, empty = read["topics_with_message_count"]
    assert (chatter["message_count"], empty["message_count"]) == (3, 0)
    assert chatter["topic_metadata"]["type_description_hash"].startswith("RIHS01_")
    assert "&" not in (folder / "metadata.yaml").read_text("utf-8")  # no references of YAML


def test_qos_of_the_first_profile_is_recorded(bags, tmp_path):
    qos = importlib.import_module("rclpy.qos")
    latched = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
    writer = opened(bags)
    writer.create_topic(topic(bags, offered_qos_profiles=[latched]))
    writer.close()
    recording = Recording(tmp_path / "my_bag")
    assert list(recording.messages()) == []
    assert [each.qos.durability for each in recording.topics.values()] == ["transient_local"]
    [chatter] = described(tmp_path / "my_bag")["topics_with_message_count"]
    assert chatter["topic_metadata"]["offered_qos_profiles"][0]["depth"] == 1


def test_end_of_the_writer_finishes_the_bag(bags, serialized, tmp_path, monkeypatch):
    writer = opened(bags)
    writer.create_topic(topic(bags))
    writer.write("chatter", serialized("hello"), SECOND)
    monkeypatch.chdir("my_bag")  # the folder's name was relative
    del writer
    gc.collect()
    assert described(tmp_path / "my_bag")["message_count"] == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("old",), "cannot record to old: it exists already; choose another uri, or remove it"),
        (("file/inner",), "cannot record to file.inner: "),
        (("new", "sqlite3"), "expected storage_id='mcap', got 'sqlite3': taskrpc writes bags only"),
    ],
)
def test_open_refuses_in_one_line(bags, tmp_path, arguments, said):
    (tmp_path / "old").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(RuntimeError, match=said) as caught:
        opened(bags, *arguments)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("described", "said"),
    [
        ({"type": "std_msgs/msg/Strin"}, "create_topic chatter: .*did you mean String"),
        ({"type": "String"}, "create_topic chatter: "),
        ({"serialization_format": "json"}, "serialization_format='json'"),
        ({"id": "chatter", "type": "cdr", "serialization_format": ""}, "got id='chatter'"),
        ({"name": ""}, r"expected TopicMetadata\(id=0, name='/chatter'"),
    ],
)
def test_create_topic_refuses_in_one_line(bags, described, said):
    writer = opened(bags)
    with pytest.raises(RuntimeError, match=said) as caught:
        writer.create_topic(topic(bags, **described))
    assert "\n" not in str(caught.value)


def test_topic_cannot_have_two_types(bags):
    writer = opened(bags)
    writer.create_topic(topic(bags))
    with pytest.raises(RuntimeError, match="expected std_msgs/msg/String, as in an earlier call"):
        writer.create_topic(topic(bags, type="std_msgs/msg/Int32"))


def test_write_refuses_in_one_line(bags, serialized):
    writer = opened(bags)
    writer.create_topic(topic(bags))
    with pytest.raises(RuntimeError, match=r"create_topic \(chatter\), got '/chatter'"):
        writer.write("/chatter", serialized("a"), 1)
    message = importlib.import_module("std_msgs.msg").String()
    with pytest.raises(TypeError, match=r"expected bytes, got .*String; write serialize_message"):
        writer.write("chatter", message, 1)
    time = importlib.import_module("rclpy.time").Time()
    with pytest.raises(TypeError, match="expected a time as nanoseconds since 1970"):
        writer.write("chatter", serialized("a"), time)
    with pytest.raises(RuntimeError, match="expected an open bag"):
        bags.SequentialWriter().write("chatter", serialized("a"), 1)


RECORDER = """
    import rclpy
    import rosbag2_py
    from rclpy.node import Node
    from rclpy.serialization import serialize_message
    from std_msgs.msg import String


    class Recorder(Node):
        def __init__(self):
            super().__init__("recorder")
            self.writer = rosbag2_py.SequentialWriter()
            storage = rosbag2_py.StorageOptions(uri="my_bag", storage_id="mcap")
            self.writer.open(storage, rosbag2_py.ConverterOptions("", ""))
            chatter = rosbag2_py.TopicMetadata(
                id=0, name="chatter", type="std_msgs/msg/String", serialization_format="cdr"
            )
            self.writer.create_topic(chatter)
            self.create_subscription(String, "chatter", self.heard, 10)
            self.publisher = self.create_publisher(String, "chatter", 10)
            self.create_timer(0.01, lambda: self.publisher.publish(String(data="hello")))

        def heard(self, message):
            now = self.get_clock().now().nanoseconds
            self.writer.write("chatter", serialize_message(message), now)
            raise SystemExit


    rclpy.init()
    rclpy.spin(Recorder())
"""


@pytest.mark.real_time
def test_recorder_of_the_tutorial_leaves_a_finished_bag(tmp_path):
    (tmp_path / "recorder.py").write_text(textwrap.dedent(RECORDER))
    command = [sys.executable, "-m", "taskrpc", "run", "recorder.py"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    assert described(tmp_path / "my_bag")["message_count"] == 1
    recording = Recording(tmp_path / "my_bag")
    assert [message.data for message in recording.messages()] == [
        srvgen.to_cdr(srvgen.load("std_msgs/msg/String")(data="hello"))
    ]
    assert recording.problem == ""
