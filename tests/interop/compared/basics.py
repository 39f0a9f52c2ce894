"""The small parts of rclpy: names, futures, parameters, timers, filters and more."""

import time

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy._rclpy_pybind11 import InvalidHandle
from rclpy.clock import Clock, ClockType, JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.logging import get_logger
from rclpy.parameter import Parameter, get_parameter_value
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription_content_filter_options import ContentFilterOptions
from rclpy.task import Future, FutureState
from rclpy.time import Time
from rclpy.utilities import remove_ros_args, timeout_sec_to_nsec
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_topic_name import validate_topic_name
from rosgraph_msgs.msg import Clock as ClockMessage
from shared import attempt, end, fails
from std_msgs.msg import (
    Float32MultiArray,
    Float64MultiArray,
    Int32MultiArray,
    String,
    UInt8MultiArray,
)
from test_msgs.msg import BasicTypes

PATIENCE = 10.0


def names():
    for name in (
        "a",
        "a//b",
        "{x}/a",
        "~/a",
        "~",
        "a b",
        "a/",
        "",
        "/1",
        "a~",
        "{a",
        "{1}",
        "a{b}c",
    ):
        attempt(f"topic {name!r}", lambda name=name: validate_topic_name(name))
        attempt(f"full {name!r}", lambda name=name: validate_full_topic_name(f"/{name}"))
        service = lambda name=name: validate_topic_name(name, is_service=True)  # noqa: E731
        attempt(f"service {name!r}", service)
    for name in ("a", "a b", "", "1a", "a/b"):
        attempt(f"node {name!r}", lambda name=name: validate_node_name(name))
        attempt(f"namespace {name!r}", lambda name=name: validate_namespace(name))
        attempt(f"namespace '/{name}'", lambda name=name: validate_namespace(f"/{name}"))
    for arguments in (
        ("a", "n", "/s"),
        ("~/a", "n", "/"),
        ("~", "n", "/s"),
        ("{node}/a", "n", "/s"),
        ("a?", "n", "/s"),
        ("a", "n?", "/s"),
        ("a", "n", ""),
        ("a", "n", "s"),
        ("a", "n", "/s/"),
    ):
        attempt(f"expand {arguments}", lambda arguments=arguments: expand_topic_name(*arguments))
    fails("expand unknown", lambda: expand_topic_name("{x}", "n", "/s"))
    fails("expand a number", lambda: expand_topic_name(5, "n", "/s"))


def values():
    attempt("message", lambda: deserialize_message(serialize_message(String(data="a")), String))
    fails("no bytes", lambda: deserialize_message(b"", String))
    fails("short", lambda: deserialize_message(b"\0\1\0\0\xff\0\0\0", String))
    fails("text", lambda: deserialize_message("x", String))
    fails("type", lambda: deserialize_message(b"\0\1\0\0", 5))
    future = Future()
    print(future._state, list(FutureState))
    future.cancel()
    print(future._state, future.done(), future.cancelled())
    future.set_result(1)
    print(future._state, future.done(), future.cancelled(), future.result())
    fails("child", lambda: get_logger("a").get_child(1))
    attempt("empty child", lambda: get_logger("a").get_child(""))
    print(get_logger("a").get_child("b").name)
    for text in ("1", "1.5", "true", "[1, 2]", "[a, b]", "[1, a]", "''", "!!str 3"):
        attempt(f"value {text}", lambda text=text: get_parameter_value(text))
    for seconds in (None, -1, 0, 1.5):
        attempt(f"timeout {seconds}", lambda seconds=seconds: timeout_sec_to_nsec(seconds))
    attempt("arguments", lambda: remove_ros_args(["a", "--ros-args", "-r", "x:=y", "--", "b"]))
    one, two = Time(seconds=1), Duration(seconds=2)
    for what, action in (
        ("plus", lambda: one + two),
        ("minus", lambda: one - two),
        ("times", lambda: two * 0.5),
        ("difference", lambda: one - Time(seconds=3)),
        ("clocks", lambda: one < Time(clock_type=ClockType.ROS_TIME)),
        ("overflow", lambda: Time(nanoseconds=2**63)),
        ("negative", lambda: Time(seconds=-1)),
    ):
        fails(what, action)
    fails("no qos", QoSProfile)
    attempt("jump", lambda: JumpThreshold(min_forward=Duration(), min_backward=None))
    clock = ROSClock()
    with clock.create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=None, on_clock_change=True),
        post_callback=lambda jump: (
            print("jump", jump["clock_change"].name)
            if isinstance(jump, dict)
            else print("jump", jump.clock_change.name)
        ),
    ):
        clock._set_ros_time_is_active(True)
    print(clock.ros_time_is_active, Clock(clock_type=ClockType.STEADY_TIME).clock_type.name)


def parameters(node):
    reasons = lambda *given: [  # noqa: E731
        (one.successful, one.reason) for one in node.set_parameters(list(given))
    ]
    node.declare_parameter("a", 1)
    node.declare_parameter("b", "x", ParameterDescriptor(read_only=True))
    node.declare_parameter("c", 1, ParameterDescriptor(dynamic_typing=True))
    attempt("again", lambda: node.declare_parameter("a", 1))
    attempt("set", lambda: reasons(Parameter("a", value=2), Parameter("b", value="y")))
    attempt("dynamic", lambda: reasons(Parameter("c", value="text")))
    attempt("static", lambda: reasons(Parameter("a", Parameter.Type.NOT_SET, None)))
    attempt("get", lambda: [node.get_parameter(name).value for name in "abc"])
    attempt("missing", lambda: node.get_parameter("d"))
    attempt("undeclare", lambda: node.undeclare_parameter("b"))
    attempt("list", lambda: sorted(node.list_parameters(["a"], 1).names))


FILTERS = [
    ("int32_value > %0", "15"),
    ("int32_value BETWEEN %0 AND %1", "10", "20"),
    ("NOT int32_value = 10",),
    ("int32_value < 20 OR int32_value > 20 AND bool_value = TRUE",),
]


def filters(node, executor):
    """Every filter has a topic of its own: Fast DDS takes a moment to change a filter."""
    got = {expression: [] for expression, *_ in FILTERS}
    pairs = []
    for number, (expression, *given) in enumerate(FILTERS):
        receive = lambda message, expression=expression: got[expression].append(  # noqa: E731
            message.int32_value
        )
        options = ContentFilterOptions(expression, given)
        topic = f"filtered{number}"
        subscription = node.create_subscription(
            BasicTypes, topic, receive, 10, content_filter_options=options
        )
        pairs.append((node.create_publisher(BasicTypes, topic, 10), subscription))
        print(subscription.is_cft_enabled, subscription.get_content_filter())
    end = time.monotonic() + PATIENCE
    while not all(publisher.get_subscription_count() for publisher, _ in pairs):
        assert time.monotonic() < end
        time.sleep(0.01)
    time.sleep(0.3)
    for publisher, _ in pairs:
        for value in (10, 20, 30):
            publisher.publish(BasicTypes(int32_value=value, bool_value=value == 30))
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    for expression, *_ in FILTERS:
        print(expression, got[expression])
    subscription = node.create_subscription(BasicTypes, "plain", print, 10)
    print(subscription.is_cft_enabled)
    fails("no filter", subscription.get_content_filter)
    subscription.set_content_filter("int32_value > %0", ["60"])
    print(subscription.is_cft_enabled, subscription.get_content_filter())
    fails("bad filter", lambda: subscription.set_content_filter("nothing > 1", []))
    fails("bad parameters", lambda: subscription.set_content_filter("int32_value > %0", "5"))
    print(subscription.get_content_filter())
    subscription.set_content_filter("", [])
    print(subscription.is_cft_enabled)
    node.destroy_subscription(subscription)
    fails("destroyed", lambda: subscription.is_cft_enabled)


def ends(node):
    timer = node.create_timer(60, None)
    print(timer.is_canceled(), node.destroy_timer(timer))
    try:
        with timer.handle:
            print("valid")
    except InvalidHandle as error:
        print(error)
    for name in ("bad name", "42"):
        attempt(name, lambda name=name: node.create_publisher(String, name, 1))
        attempt(name, lambda name=name: node.count_publishers(name))
    fails("other message", lambda: node.create_publisher(String, "a", 1).publish("x"))
    fails("depth", lambda: node.create_publisher(String, "a", -1))
    fails("rate", lambda: node.create_rate(0))
    node.destroy_node()
    for method in ("get_name", "get_node_names", "get_topic_names_and_types"):
        attempt(method, getattr(node, method))


class Labelled(String):
    """A message class with a constructor of its own."""

    def __init__(self, text="none", **fields):
        super().__init__(**fields)
        self.data = text
        self.label = f"label of {text}"


def subclasses(node, executor):
    message = Labelled("a")
    print(message, message.label, isinstance(message, String))
    received = []
    node.create_subscription(String, "labelled", received.append, 10)
    node.create_publisher(String, "labelled", 10).publish(message)
    while not received:
        executor.spin_once(timeout_sec=0.1)
    print(received)


def lists():
    for cls in (Int32MultiArray, UInt8MultiArray, Float32MultiArray, Float64MultiArray):
        for values in ([1, "x"], [1.5], [2**40], [-1], "ab", 5, None, [None], (1, 2), {"a": 1}):
            name = f"{cls.__name__} {values!r}"
            attempt(name, lambda cls=cls, values=values: setattr(cls(), "data", values))
        attempt(cls.__name__, lambda cls=cls: cls(data=["x"]))


def tasks(executor):
    order = []
    for number in range(4):
        executor.create_task(order.append, number)
    for _ in range(6):
        executor.spin_once(timeout_sec=0.05)
    print("tasks", order)


def simulated_time():
    """The calls of a timer on /clock, also at exact multiples of its period."""
    uses_it = Parameter("use_sim_time", value=True)
    node = rclpy.create_node("simulated", parameter_overrides=[uses_it])
    publisher = node.create_publisher(ClockMessage, "/clock", 10)
    calls = []
    node.create_timer(0.5, lambda: calls.append(node.get_clock().now().nanoseconds))
    for steps in (40, 42, 44, 48, 53, 56, 58):  # quarters of a second
        wanted = Time(seconds=0, nanoseconds=steps * 250_000_000).to_msg()
        while node.get_clock().now().to_msg() != wanted:
            publisher.publish(ClockMessage(clock=wanted))
            rclpy.spin_once(node, timeout_sec=0.1)
        for _ in range(3):
            rclpy.spin_once(node, timeout_sec=0.05)
        print("clock", steps, calls)
        calls.clear()
    node.destroy_node()


def main():
    names()
    lists()
    values()
    rclpy.init()
    node = rclpy.create_node("basics", namespace="ns")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    parameters(node)
    filters(node, executor)
    subclasses(node, executor)
    tasks(executor)
    simulated_time()
    ends(node)
    rclpy.shutdown()
    end()


main()
