"""`taskrpc topic hz`, `bw` and `delay` measure as ros2 does."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

import srvgen
from taskrpc.cli.ros.topic.measures import Bandwidth, Delay, Rate, SimulatedTime, _text
from taskrpc.cli.ros.topic.reading import condition
from tests.cli.ros.topic.conftest import Pose, String, real_time

Clock = srvgen.load("rosgraph_msgs/msg/Clock")
Time = srvgen.load("builtin_interfaces/msg/Time")


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
def test_measures_print_once_a_second(talker, tmp_path, verb, topic, expected):
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
def test_without_topics_nothing_is_measured(run, tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert run("bw", "-a") == (0, "No topics available\n", "")


@real_time
def test_a_message_without_a_header_has_no_delay(talker, run):
    assert run("delay", "/chatter") == (1, "", "msg does not have header\n")


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
