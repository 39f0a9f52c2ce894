"""`taskrpc topic` prints what ros2 prints, for publishers of other programs."""

from __future__ import annotations

import io
import subprocess
import sys
import time

import pytest

import srvgen
from taskrpc.cli.shared.messages import Template, documents
from taskrpc.errors import TaskRpcError
from taskrpc.ros.message_text import Cut, csv_of, plain, yaml_of
from tests.cli.ros.topic.conftest import Pose, String, real_time

Covariance = srvgen.load("geometry_msgs/msg/PoseWithCovariance")
Image = srvgen.load("sensor_msgs/msg/Image")
Reference = srvgen.load("sensor_msgs/msg/TimeReference")


@real_time
def test_echo_prints_yaml_documents(talker, run):
    code, out, _ = run("echo", "/chatter", "--once")
    assert code == 0
    assert out.startswith("data: 'Hello: ")
    assert out.endswith("'\n---\n")
    assert run("echo", "/state", "--once")[1] == "data: ready\n---\n"
    assert run("echo", "/state", "std_msgs/String", "--once", "--csv")[1] == "ready\n"
    assert run("echo", "/pose", "--once", "--field", "pose.position.x")[1] == "1.5\n---\n"
    assert run("echo", "/pose", "--once", "--field", "pose.position", "--flow-style")[1] == (
        "{x: 1.5, y: 0.0, z: 0.0}\n---\n"
    )


@real_time
def test_echo_of_an_unknown_topic_is_an_error(talker, run):
    code, out, err = run("echo", "/nothing")
    assert (code, out) == (1, "WARNING: topic [/nothing] does not appear to be published yet\n")
    assert err.startswith("Could not determine the type for the passed topic\n")
    code, _, err = run("echo", "/heard", "--once", "--timeout", "0.05")
    assert (code, err) == (1, "no message on /heard within 0.05 s\n")
    code, _, err = run("echo", "/chatter", "--once", "--field", "nope.x")
    assert (code, err) == (1, "Invalid field 'nope.x': std_msgs/msg/String has no such field\n")


@real_time
def test_pub_prints_each_message_and_reaches_subscribers(talker, run):
    code, out, _ = run("pub", "--once", "/heard", "std_msgs/msg/String", "{data: over here}")
    assert code == 0
    assert out.endswith(
        "publisher: beginning loop\npublishing #1: std_msgs.msg.String(data='over here')\n\n"
    )
    assert talker.stdout.readline() == "over here\n"
    rate = ("-r", "1000", "-p", "2")
    code, out, _ = run("pub", "-t", "3", *rate, "/heard", "std_msgs/String", "data=so")
    assert "publishing #2: " in out
    assert "publishing #1: " not in out
    assert [talker.stdout.readline() for _ in range(3)] == ["so\n"] * 3


@real_time
@pytest.mark.parametrize(
    ("argv", "code", "said"),
    [
        (("/t", "std_msgs/msg/Nope"), 1, "The passed message type is invalid\n"),
        (("/t", "std_srvs/srv/Trigger"), 1, "The passed type is not a message\n"),
        (
            ("/t", "std_msgs/msg/String", "7"),
            1,
            "The passed value needs to be a dictionary in YAML",
        ),
        (("/t", "std_msgs/msg/String", "text=1"), 1, "Failed to populate field: "),
        (("/a b", "std_msgs/msg/String"), 1, "Invalid topic name: "),
        (("/t", "std_msgs/msg/String", "-1", "-t", "2"), 2, "usage: "),
        (
            ("/t", "std_msgs/msg/String", "--max-wait-time-secs", "1"),
            2,
            "expected -w, --once or --times beside --max-wait-time-secs",
        ),
        (
            ("/t", "std_msgs/msg/String", "-1", "--max-wait-time-secs", "0.01"),
            1,
            "Timed out waiting for subscribers: Expected 1 subscribers but only got 0 subscribers",
        ),
    ],
)
def test_invalid_use_of_pub_is_one_sentence(run, argv, code, said):
    told, _, err = run("pub", *argv)
    assert told == code
    assert err.startswith(said)


# How messages are printed


def test_arrays_and_strings_are_cut_off_or_omitted():
    image = Image(encoding="rgb8", data=bytes(range(5)))
    told = yaml_of(image, Cut(3))
    assert "encoding: rgb...\n" in told
    assert "data:\n- 0\n- 1\n- 2\n- '...'\n" in told
    told = yaml_of(image, Cut(arrays=False, texts=False))
    assert "encoding: '<string length: <4>>'\n" in told
    assert "data: '<sequence type: uint8, length: 5>'\n" in told
    assert "covariance: '<array type: double[36]>'\n" in yaml_of(Covariance(), Cut(arrays=False))
    assert yaml_of(image, Cut(None)).endswith("- 3\n- 4\n")


@pytest.mark.parametrize(
    ("type_", "field", "text"),
    [
        ("test_msgs/msg/UnboundedSequences", "byte_values", "<sequence type: octet, length: 0>"),
        ("test_msgs/msg/BoundedSequences", "bool_values", "<sequence type: boolean[3], length: 0>"),
        (
            "test_msgs/msg/BoundedSequences",
            "char_values_default",
            "<sequence type: uint8[3], length: 3>",
        ),
        (
            "test_msgs/msg/WStrings",
            "bounded_sequence_of_wstrings",
            "<sequence type: wstring[3], length: 0>",
        ),
        ("test_msgs/msg/WStrings", "array_of_wstrings", "<array type: wstring[3]>"),
        ("test_msgs/msg/Arrays", "basic_types_values", "<array type: test_msgs/msg/BasicTypes[3]>"),
        (
            "sensor_msgs/msg/PointCloud2",
            "fields",
            "<sequence type: sensor_msgs/msg/PointField, length: 0>",
        ),
        (
            "shape_msgs/msg/SolidPrimitive",
            "dimensions",
            "<sequence type: double[3], length: 0>",
        ),
        (
            "rcl_interfaces/msg/ParameterDescriptor",
            "integer_range",
            "<sequence type: rcl_interfaces/msg/IntegerRange[1], length: 0>",
        ),
    ],
)
def test_no_arr_writes_types_and_bounds_as_rosidl_runtime_py(type_, field, text):
    message = srvgen.load(type_)()
    assert plain(message, Cut(arrays=False))[field] == text


def test_no_arr_omits_the_bound_of_strings():
    text = "string<=22[] words\nstring<=22[<=4] few\n"
    message = srvgen.define("wordy_msgs/msg/Words", text)()
    message.words = ["a"]
    assert plain(message, Cut(arrays=False)) == {
        "words": "<sequence type: string, length: 1>",
        "few": "<sequence type: string[4], length: 0>",
    }


def test_values_between_commas_are_in_order():
    pose = Pose()
    pose.pose.position.y = 2.0
    assert csv_of(pose, Cut()) == "0,0,,0.0,2.0,0.0,0.0,0.0,0.0,1.0"
    assert csv_of(Image(data=b"\1\2"), Cut()).endswith(",1,2")


def test_a_text_that_yaml_would_misread_is_quoted():
    for text in ("yes", "007", "a: b", "", "- x", "ü"):
        import yaml

        assert yaml.safe_load(yaml_of(String(data=text), Cut())) == {"data": text}


@real_time
def test_topics_of_a_remote_program_need_its_token(run, monkeypatch, tmp_path):
    from taskrpc import QoS, sync

    with sync.Node("talker", token="a secret of sixteen") as node:
        state = node.create_publisher(String, "state", QoS(1, durability="transient_local"))
        state.publish(String(data="ready"))
        place = ("--connect", node.address)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # or the registry would tell it
        code, _, err = run("echo", "/state", "--once", *place)
        assert code == 1
        assert "TASKRPC_TOKEN" in err
        monkeypatch.setenv("TASKRPC_TOKEN", "a secret of sixteen")
        assert run("list", *place)[1] == "/state\n"
        assert run("echo", "/state", "--once", *place)[1] == "data: ready\n---\n"


# What `pub` sends


def test_auto_and_now_are_the_time_of_each_message():
    before = time.time_ns()
    template = Template(Reference, ['{header: "auto", time_ref: "now", source: "dumy"}'])
    for _ in range(2):
        message = template.message()
        for stamp in (message.header.stamp, message.time_ref):
            now = stamp.sec * 10**9 + stamp.nanosec
            assert before <= now <= time.time_ns()
            before = now - 1
    assert (message.header.frame_id, message.source) == ("", "dumy")


def test_time_stamps_in_nested_messages_and_arrays_are_set():
    markers = srvgen.load("visualization_msgs/msg/MarkerArray")
    template = Template(markers, ["{markers: [{header: auto}, {header: {frame_id: map}}]}"])
    first, second = template.message().markers
    assert first.header.stamp.sec > 0
    assert (second.header.stamp.sec, second.header.frame_id) == (0, "map")
    assert Template(Pose, ["header=auto"]).message().header.stamp.sec > 0
    assert Template(String, ["{data: auto}"]).message() == String(data="auto")


def test_a_file_has_a_document_for_each_message(tmp_path):
    path = tmp_path / "messages.yaml"
    path.write_text("data: one\n---\n# nothing\n---\n{data: two}\n", "utf-8")
    texts = documents(str(path))
    assert [Template(String, [text]).message().data for text in texts] == ["one", "two"]
    path.write_text("data: [\n", "utf-8")
    with pytest.raises(TaskRpcError, match="is not valid YAML: "):
        documents(str(path))
    with pytest.raises(TaskRpcError, match="cannot read "):
        documents(str(tmp_path / "nowhere"))


@real_time
def test_pub_reads_messages_from_files_and_standard_input(talker, run, tmp_path, monkeypatch):
    path = tmp_path / "messages.yaml"
    path.write_text("data: one\n---\ndata: two\n", "utf-8")
    rate = ("-r", "1000", "-p", "0")
    assert (
        run("pub", "-t", "3", *rate, "/heard", "std_msgs/String", "--yaml-file", str(path))[0] == 0
    )
    assert [talker.stdout.readline() for _ in range(3)] == ["one\n", "two\n", "one\n"]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"data: piped")))
    assert run("pub", "--once", "/heard", "std_msgs/String", "--stdin")[0] == 0
    assert talker.stdout.readline() == "piped\n"
    path.write_text("---\n", "utf-8")
    for argv, expected in (
        (("--stdin", "data=1"), "expected one of values, --stdin and --yaml-file, got several"),
        (("--yaml-file", str(path)), f"expected messages in {path}, got none"),
    ):
        code, _, err = run("pub", "/heard", "std_msgs/String", *argv)
        assert (code, err) == (2, f"{expected}\n")


# What `echo` and `hz` leave out, and what they add


@real_time
def test_echo_filters_messages(talker, run):
    assert (
        run("echo", "/state", "--once", "--filter", "m.data == 'ready'")[1] == "data: ready\n---\n"
    )
    code, out, _ = run("echo", "/state", "--timeout", "0.2", "--filter", "m.data == 'busy'")
    assert (code, out) == (0, "")
    filtered = ("--field", "data", "--filter", "m.endswith('y')")
    assert run("echo", "/state", "--once", *filtered)[1] == "ready\n---\n"
    code, _, err = run("echo", "/state", "--filter", "m.nope > 1")
    assert code == 1
    assert err.startswith("--filter: AttributeError: ")
    code, _, err = run("echo", "/state", "--filter", "m.data ==")
    assert code == 2
    assert err.startswith("--filter: expected a Python expression about m, the message; ")
    assert run("echo", "/state", "--field", ".") == (2, "", "Invalid field value '.'\n")


@real_time
def test_echo_prints_raw_bytes_and_message_info(talker, run):
    assert run("echo", "/state", "--once", "--raw")[1] == (
        "b'\\x00\\x01\\x00\\x00\\x06\\x00\\x00\\x00ready\\x00'\n---\n"
    )
    out = run("echo", "/state", "--once", "-i")[1]
    assert out.startswith("publication_sequence_number: 1\nreceived_timestamp: ")
    assert out.endswith("---\ndata: ready\n---\n")
    assert run("echo", "/state", "--once", "-i", "--csv")[1].endswith(",ready\n")


@real_time
def test_echo_ends_silently_if_its_output_is_closed(talker):
    command = [sys.executable, "-u", "-m", "taskrpc", "topic", "echo", "/chatter"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0
