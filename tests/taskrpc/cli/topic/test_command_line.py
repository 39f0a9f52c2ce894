"""`taskrpc topic` prints what ros2 prints, about publishers of other programs."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import time

import pytest

import srvgen
from taskrpc.cli.main import main
from taskrpc.cli.topic.measures import Bandwidth, Delay, Rate, SimulatedTime, _text
from taskrpc.cli.topic.messages import Template, documents
from taskrpc.cli.topic.reading import condition
from taskrpc.errors import TaskRpcError
from taskrpc.ros.message_text import Cut, csv_of, plain, yaml_of

String = srvgen.load("std_msgs/msg/String")
Pose = srvgen.load("geometry_msgs/msg/PoseStamped")
Covariance = srvgen.load("geometry_msgs/msg/PoseWithCovariance")
Clock = srvgen.load("rosgraph_msgs/msg/Clock")
Time = srvgen.load("builtin_interfaces/msg/Time")
Image = srvgen.load("sensor_msgs/msg/Image")
Reference = srvgen.load("sensor_msgs/msg/TimeReference")

TALKER = """
import sys
import srvgen, taskrpc
from taskrpc import QoS
String = srvgen.load("std_msgs/msg/String")
Pose = srvgen.load("geometry_msgs/msg/PoseStamped")
import asyncio
async def main():
    async with taskrpc.Node("talker", namespace="/lab") as node:
        chatter = node.create_publisher(String, "/chatter")
        pose = node.create_publisher(Pose, "/pose", QoS(5, "best_effort"))
        node.create_publisher(String, "/_hidden")
        node.create_subscription(String, "/heard", lambda message: print(message.data, flush=True))
        state = node.create_publisher(String, "/state", QoS(1, durability="transient_local"))
        state.publish(String(data="ready"))
        where = Pose()
        where.pose.position.x = 1.5
        count = 0
        def tick():
            nonlocal count
            count += 1
            chatter.publish(String(data=f"Hello: {count}"))
            pose.publish(where)
        node.create_timer(0.02, tick)
        print("up", flush=True)
        await node.spin()
taskrpc.run(main())
"""


@pytest.fixture(scope="module")
def _runtime(tmp_path_factory):
    return tmp_path_factory.mktemp("runtime")


@pytest.fixture(scope="module")
def _talker(_runtime):
    """One program for all tests of this module, in a runtime folder of their own."""
    import os

    _runtime.chmod(0o700)
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(_runtime)}
    environment.pop("ROS_DOMAIN_ID", None)
    with subprocess.Popen(
        [sys.executable, "-c", TALKER], env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "up\n"
        yield process
        process.terminate()


@pytest.fixture
def talker(_talker, _runtime, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(_runtime))
    return _talker


@pytest.fixture
def run(capsys):
    """Runs `taskrpc topic …` in this process: exit code, stdout, stderr."""

    def _run(*argv):
        code = main(("topic", *argv))
        out, err = capsys.readouterr()
        return code, out, err

    return _run


real_time = pytest.mark.real_time


@real_time
def test_listings(talker, run):
    assert run("list") == (0, "/chatter\n/heard\n/pose\n/state\n", "")
    assert run("list", "-c") == (0, "4\n", "")
    assert run("list", "-a")[1].startswith("/_hidden\n/chatter\n")
    assert run("--include-hidden-topics", "list", "-c")[1] == "5\n"
    assert "/pose [geometry_msgs/msg/PoseStamped]\n" in run("list", "-t")[1]
    assert json.loads(run("list", "--json")[1])[0] == {
        "name": "/chatter",
        "types": ["std_msgs/msg/String"],
    }
    assert run("list", "-v")[1] == (
        "Published topics:\n"
        " * /chatter [std_msgs/msg/String] 1 publisher\n"
        " * /pose [geometry_msgs/msg/PoseStamped] 1 publisher\n"
        " * /state [std_msgs/msg/String] 1 publisher\n"
        "\n"
        "Subscribed topics:\n"
        " * /heard [std_msgs/msg/String] 1 subscriber\n"
        "\n"
    )


@real_time
def test_type_and_find(talker, run):
    assert run("type", "chatter") == (0, "std_msgs/msg/String\n", "")
    assert run("find", "std_msgs/String") == (0, "/chatter\n/heard\n/state\n", "")
    assert run("find", "std_msgs/msg/String", "-c") == (0, "3\n", "")
    code, out, err = run("type", "/chater")
    assert (code, out) == (1, "")
    assert err == "Unknown topic '/chater'\n  hint: did you mean /chatter?\n"


@real_time
def test_info(talker, run):
    assert run("info", "/chatter") == (
        0,
        "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 0\n",
        "",
    )
    told = run("info", "/pose", "-v")[1]
    assert told.startswith(
        "Type: geometry_msgs/msg/PoseStamped\n\nPublisher count: 1\n\nNode name: talker\n"
        "Node namespace: /lab\nTopic type: geometry_msgs/msg/PoseStamped\n"
    )
    assert "QoS profile:\n  Reliability: BEST_EFFORT\n  History (Depth): KEEP_LAST (5)\n" in told
    assert "  Durability: VOLATILE\n" in told
    assert told.endswith("\nSubscription count: 0\n\n")
    gids = re.findall(r"^Endpoint type: PUBLISHER\nGID: ((?:[0-9a-f]{2}\.){15}..)$", told, re.M)
    assert len(gids) == 1
    found = json.loads(run("info", "/pose", "--json")[1])
    assert [each["gid"] for each in found["publishers"]] == gids
    found = json.loads(run("info", "/state", "--json")[1])
    assert found["publishers"][0]["durability"] == "transient_local"


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
def test_echo_of_what_is_not_there(talker, run):
    code, out, err = run("echo", "/nothing")
    assert (code, out) == (1, "WARNING: topic [/nothing] does not appear to be published yet\n")
    assert err.startswith("Could not determine the type for the passed topic\n")
    code, _, err = run("echo", "/heard", "--once", "--timeout", "0.05")
    assert (code, err) == (1, "no message on /heard within 0.05 s\n")
    code, _, err = run("echo", "/chatter", "--once", "--field", "nope.x")
    assert (code, err) == (1, "Invalid field 'nope.x': std_msgs/msg/String has no such field\n")


@real_time
def test_pub_prints_each_message_and_reaches_who_listens(talker, run):
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
            ("/t", "std_msgs/msg/String", "-1", "--max-wait-time-secs", "0.01"),
            1,
            "Timed out waiting for subscribers: Expected 1 subscribers but only got 0 subscribers",
        ),
    ],
)
def test_what_pub_cannot_do_is_told_in_a_sentence(run, argv, code, said):
    told, _, err = run("pub", *argv)
    assert told == code
    assert err.startswith(said)


@real_time
@pytest.mark.parametrize(
    ("verb", "topic", "expected"),
    [
        ("hz", "/chatter", r"average rate: \d+\.\d{3}\n\tmin: 0\.\d{3}s max: "),
        (
            "bw",
            "/chatter",
            r"Subscribed to \[/chatter\]\n[\d.]+ K?B/s from \d+ messages\n",
        ),
        ("delay", "/pose", r"average delay: \d+\.\d{3}\n\tmin: \d+\.\d{3}s max: "),
    ],
)
def test_figures_once_a_second(talker, tmp_path, verb, topic, expected):
    command = [sys.executable, "-u", "-m", "taskrpc", "topic", verb, topic]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline() for _ in range(3 if verb == "bw" else 2)]
        process.kill()
    assert re.match(expected, "".join(lines))


@real_time
def test_all_topics_are_measured_in_one_table(talker):
    command = [sys.executable, "-u", "-m", "taskrpc", "topic", "hz", "--all"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline() for _ in range(5)]
        process.kill()
    assert lines[0] == "Subscribing to all 4 available topics...\n"
    first = [line.split()[0] for line in lines[1:]]
    assert [first[0], *first[2:]] == ["topic", "/chatter", "/pose"]


@real_time
@pytest.mark.parametrize(
    ("argv", "code", "said"),
    [
        ((), 2, "Either specify topic names or use --all/-a option"),
        (("-a", "/chatter"), 2, "Cannot specify both --all/-a and topic names"),
    ],
)
@pytest.mark.parametrize("verb", ["hz", "bw"])
def test_topics_to_measure_are_named_or_all(run, verb, argv, code, said):
    assert run(verb, *argv) == (code, "", f"{said}\n")


@real_time
def test_of_no_topics_none_is_measured(run, tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert run("bw", "-a") == (0, "No topics available\n", "")


@real_time
def test_a_message_without_a_header_has_no_delay(talker, run):
    assert run("delay", "/chatter") == (1, "", "msg does not have header\n")


# How messages are printed


def test_arrays_and_texts_are_cut_off_or_left_out():
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


def test_no_arr_leaves_the_bound_of_strings_out():
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
def test_topics_of_a_program_elsewhere_need_its_secret(run, monkeypatch, tmp_path):
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


def test_time_stamps_in_messages_within_and_in_arrays():
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
def test_pub_reads_messages_from_elsewhere(talker, run, tmp_path, monkeypatch):
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
def test_echo_of_some_messages(talker, run):
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
def test_echo_of_bytes_and_of_what_is_known_beside_a_message(talker, run):
    assert run("echo", "/state", "--once", "--raw")[1] == (
        "b'\\x00\\x01\\x00\\x00\\x06\\x00\\x00\\x00ready\\x00'\n---\n"
    )
    out = run("echo", "/state", "--once", "-i")[1]
    assert out.startswith("publication_sequence_number: 1\nreceived_timestamp: ")
    assert out.endswith("---\ndata: ready\n---\n")
    assert run("echo", "/state", "--once", "-i", "--csv")[1].endswith(",ready\n")


@real_time
def test_a_reader_that_goes_ends_echo_in_silence(talker):
    command = [sys.executable, "-u", "-m", "taskrpc", "topic", "echo", "/chatter"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


def _clock(seconds):
    whole, rest = divmod(round(seconds * 10**9), 10**9)
    return Clock(clock=Time(sec=whole, nanosec=rest))


def test_a_rate_in_simulated_time_counts_from_the_first_clock_message_on():
    time = SimulatedTime()
    rate = Rate(10, condition(None), time)
    rate.take(None)
    assert rate.line() == ""
    for each in (100.0, 102.0, 104.0):
        time.take(_clock(each))
        rate.take(None)
    assert rate.line() == (
        "average rate: 0.500\n\tmin: 2.000s max: 2.000s std dev: 0.00000s window: 2"
    )


def test_a_simulation_that_starts_again_starts_the_measures_again():
    time = SimulatedTime()
    rate, bandwidth = Rate(10, condition(None), time), Bandwidth(10, time)
    message = String(data="abc")
    for each in (100.0, 101.0, 1.0, 1.5, 2.0):
        time.take(_clock(each))
        rate.take(message)
        bandwidth.take(message)
    assert rate.line().startswith("average rate: 2.000\n\tmin: 0.500s max: 0.500s")
    assert bandwidth.line() == (
        "36 B/s from 3 messages\n\tMessage size mean: 12 B min: 12 B max: 12 B"
    )
    time.take(_clock(0.5))
    assert bandwidth.line() == ""


def test_a_delay_in_simulated_time_is_the_age_by_that_time():
    time = SimulatedTime()
    delay = Delay(10, time)
    pose = Pose()
    pose.header.stamp.sec = 7
    delay.take(pose)
    time.take(_clock(7.25))
    delay.take(pose)
    assert delay.line().startswith("average delay: 0.250\n")


@pytest.mark.parametrize(("text", "size"), [("", 12), ("hell", 16), ("hello", 16), ("x" * 8, 20)])
def test_sizes_of_messages_include_the_padding_of_dds(text, size):
    """As raw subscriptions of a real rclpy receive them from another process."""
    time = SimulatedTime()
    bandwidth = Bandwidth(10, time)
    for each in (1.0, 2.0):
        time.take(_clock(each))
        bandwidth.take(String(data=text))
    assert bandwidth.line().endswith(f"mean: {size} B min: {size} B max: {size} B")


def test_several_bandwidths_have_the_columns_of_ros2():
    time = SimulatedTime()
    bandwidths = {name: Bandwidth(10, time) for name in ("/a", "/b")}
    for each in (1.0, 2.0):
        time.take(_clock(each))
        bandwidths["/a"].take(String(data="abc"))
    assert _text(bandwidths) == (
        "topic   bandwidth   window   mean   min    max \n"
        "===============================================\n"
        "/a      24 B/s      2        12 B   12 B   12 B\n"
    )


SIMULATION = """
import asyncio, srvgen, taskrpc
from taskrpc import QoS
Clock = srvgen.load("rosgraph_msgs/msg/Clock")
String = srvgen.load("std_msgs/msg/String")
async def main():
    async with taskrpc.Node("simulation") as node:
        clock = node.create_publisher(Clock, "/clock", QoS(1, "best_effort"))
        chatter = node.create_publisher(String, "/chatter")
        now = Clock()
        def tick():
            now.clock.sec += 50
            clock.publish(now)
            chatter.publish(String(data="hi"))
        node.create_timer(0.02, tick)
        print("up", flush=True)
        await node.spin()
taskrpc.run(main())
"""


@real_time
def test_hz_and_bw_measure_in_the_time_of_a_simulation(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    options = {"stdout": subprocess.PIPE, "text": True}
    start = [sys.executable, "-u", "-m", "taskrpc", "topic"]
    with subprocess.Popen([sys.executable, "-c", SIMULATION], **options) as simulation:
        assert simulation.stdout.readline() == "up\n"
        with (
            subprocess.Popen([*start, "hz", "-s", "/chatter"], **options) as hz,
            subprocess.Popen([*start, "bw", "--use-sim-time", "/chatter"], **options) as bw,
        ):
            told = hz.stdout.readline(), [bw.stdout.readline() for _ in range(2)][1]
            for process in (hz, bw, simulation):
                process.kill()
    assert re.fullmatch(r"average rate: 0\.0[12]\d\n", told[0])
    assert re.match(r"0 B/s from \d+ messages\n", told[1])


def test_several_topics_are_compared_in_a_table():
    time = SimulatedTime()
    rates = {name: Rate(10, condition("m > 0"), time) for name in ("/a", "/longer", "/silent")}
    for name, times in (("/a", [1.0, 1.5, 1.75]), ("/longer", [1.0, 2.0])):
        for each in times:
            time.take(_clock(each))
            rates[name].take(1)
            rates[name].take(-1)
    assert _text(rates) == (
        " topic     rate   min_delta   max_delta   std_dev   window\n"
        "==========================================================\n"
        "/a        2.667   0.250       0.500       0.12500   2     \n"
        "/longer   1.000   1.000       1.000       0.00000   1     \n"
    )
    assert _text(rates) == "no new messages"
