"""What loggers log is on `/rosout`, and their levels are shown and set by services."""

import gc
import re
import subprocess
import sys

import pytest

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy._impl.log import output
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.node import Node

pytestmark = pytest.mark.real_time

Log = srvgen.load("rcl_interfaces/msg/Log")
Level = srvgen.load("rcl_interfaces/msg/LoggerLevel")
GetLoggerLevels = srvgen.load("rcl_interfaces/srv/GetLoggerLevels")
SetLoggerLevels = srvgen.load("rcl_interfaces/srv/SetLoggerLevels")


@pytest.fixture
def start():
    """Contexts with the arguments given, each with an executor."""
    contexts = []

    def start(*args):
        context = Context()
        rclpy.init(args=["p", *args], context=context)
        contexts.append(context)
        return context, SingleThreadedExecutor(context=context)

    yield start
    for context in contexts:
        context.try_shutdown()
    rclpy.logging.clear_config()


def heard(context, executor, **settings):
    """What comes to /rosout of three lines that a node's logger and its child log."""
    node = Node("talker", namespace="/ns", context=context, **settings)
    listener = Node("listener", context=context)
    executor.add_node(listener)
    got = []
    listener.create_subscription(Log, "/rosout", got.append, 10)
    logger = node.get_logger()
    logger.info("a")
    logger.debug("b")
    logger.get_child("part").warn("c \udc80")
    logger.get_child("part").error("d")
    for _ in range(20):
        executor.spin_once(timeout_sec=0.02)
    return [(line.level, line.name, line.msg) for line in got if line.name != "listener"]


def test_a_node_s_log_and_its_children_s_is_published(start):
    assert heard(*start()) == [(20, "ns.talker", "a"), (40, "ns.talker.part", "d")]


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [(["--ros-args", "--disable-rosout-logs"], {}), ([], {"enable_rosout": False})],
)
def test_it_is_not_where_the_program_or_the_command_line_says_so(start, arguments, settings):
    assert heard(*start(*arguments), **settings) == []


def test_the_second_node_of_a_name_is_warned_of_and_one_that_is_gone_is_not(start, capsys):
    context, _ = start()
    Node("twice", context=context)
    assert capsys.readouterr().err == ""
    second = Node("twice", context=context)
    error = capsys.readouterr().err
    assert "[rcl.logging_rosout]: Publisher already registered for node name: 'twice'" in error
    second.destroy_node()
    gc.collect()
    third = Node("twice", context=context)
    assert capsys.readouterr().err == ""
    third.destroy_node()
    assert "twice" not in output._rosout


def test_logging_at_the_very_end_of_a_program_only_logs():
    program = (
        "import atexit\n"
        "atexit.register(lambda: node.get_logger().info('bye'))\n"
        "from taskrpc.ros.packages import rclpy\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('node')\n"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert re.fullmatch(r"\[INFO\] \[[\d.]+\] \[node\]: bye\n", done.stderr)


def test_levels_are_shown_and_set_by_services(start):
    context, executor = start()
    node = Node("node", context=context, enable_logger_service=True)
    executor.add_node(node)

    def call(kind, name, **fields):
        client = node.create_client(kind, f"/node/{name}")
        assert client.wait_for_service(60)
        future = client.call_async(kind.Request(**fields))
        executor.spin_until_future_complete(future, 60)
        return future.result()

    levels = [Level(name="a", level=10), Level(name="a", level=22), Level(name="node", level=40)]
    results = call(SetLoggerLevels, "set_logger_levels", levels=levels).results
    assert [(each.successful, each.reason) for each in results] == [
        (True, ""),
        (False, "Failed reason: Invalid logger level."),
        (True, ""),
    ]
    found = call(GetLoggerLevels, "get_logger_levels", names=["a", "node", "other"]).levels
    assert [(each.name, each.level) for each in found] == [("a", 10), ("node", 40), ("other", 0)]
    assert not node.get_logger().is_enabled_for(30)
