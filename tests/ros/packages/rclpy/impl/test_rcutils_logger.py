"""Loggers of nodes: filters, callers, and the messages that they take."""

import inspect
from typing import ClassVar

import pytest

from taskrpc.ros.packages.rclpy.clock import Clock, ROSClock
from taskrpc.ros.packages.rclpy.impl import rcutils_logger
from taskrpc.ros.packages.rclpy.impl.rcutils_logger import CallerId, LoggingFilter, Once, SkipFirst
from taskrpc.ros.packages.rclpy.logging import get_logger
from taskrpc.ros.packages.rclpy.time import Time

pytestmark = pytest.mark.usefixtures("fresh_log")


def test_once_and_skip_first_remember_the_place_in_the_program():
    logger = get_logger("n")
    assert logged(3, logger=logger, once=True) == [True, False, False]
    assert logged(3, skip_first=True) == [False, True, True]
    assert logged(3, once=True, skip_first=True) == [False, True, False]
    assert logged(3, once=False) == [True] * 3
    two = [[logger.info("m", once=True), logger.info("m", once=True)] for _ in range(2)]
    assert two == [[True, True], [False, False]]


def test_filters_are_known_by_the_names_of_ros_and_remember_in_a_context():
    assert list(rcutils_logger.supported_filters) == ["throttle", "skip_first", "once"]
    wanted = rcutils_logger.get_filters_from_kwargs(once=True, skip_first=True)
    assert wanted == ["skip_first", "once"]
    assert rcutils_logger.get_filters_from_kwargs(once=False) == []
    seen = []
    for cls, options in ((Once, {"once": True}), (SkipFirst, {"skip_first": True})):
        context = {}
        cls.initialize_context(context, **options)
        seen.append([cls.should_log(context) for _ in range(3)])
    assert seen == [[True, False, False], [False, True, True]]
    with pytest.raises(TypeError, match='Required parameter "once" was not specified'):
        Once.initialize_context({})
    assert LoggingFilter.should_log({})


def test_a_program_can_add_a_filter_of_its_own(monkeypatch):
    class EverySecond(LoggingFilter):
        params: ClassVar = {"every_second": None}

        @staticmethod
        def should_log(context):
            context["count"] = context.get("count", 0) + 1
            return context["count"] % 2 == 1

    monkeypatch.setitem(rcutils_logger.supported_filters, "every_second", EverySecond)
    logger = get_logger("n")
    assert [logger.info("m", every_second=True) for _ in range(4)] == [True, False] * 2
    (context,) = logger.contexts.values()
    assert (context["name"], context["filters"], context["count"]) == ("n", ["every_second"], 4)


def test_a_caller_id_is_the_place_that_asks():
    caller = CallerId()
    assert (caller.function_name, caller.file_path) == (inspect.stack()[0].function, __file__)
    assert CallerId(inspect.currentframe()).function_name == caller.function_name


def test_throttling_goes_by_its_clock():
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    seconds = iter(range(1, 9))

    def tick():
        clock.set_ros_time_override(Time(seconds=next(seconds), clock_type=clock.clock_type))

    tick()
    options = {"throttle_duration_sec": 2, "throttle_time_source_type": clock}
    assert logged(5, tick, **options) == [False, True, False, True, False]
    assert logged(2, throttle_duration_sec=100.0) == [True, False]


def test_one_place_may_not_change_its_options():
    def each(match, *calls):
        logger = get_logger("n")
        results = []
        with pytest.raises(ValueError, match=match):
            results.extend(logger.log("m", severity, **options) for severity, options in calls)

    each("severity cannot be changed", (20, {}), (30, {}))
    each("name cannot be changed", (20, {"name": "a"}), (20, {"name": "b"}))
    each("Requested logging filters cannot", (20, {"once": True}), (20, {}))
    one, two = ({"throttle_duration_sec": n} for n in (1, 2))
    each("filter parameters cannot be changed", (20, one), (20, two))


def test_wrong_options_and_messages_are_refused():
    logger = get_logger("n")
    with pytest.raises(TypeError, match='required parameter "throttle_duration_sec" not specified'):
        logger.info("m", throttle_time_source_type=Clock())
    with pytest.raises(TypeError, match='"loudly" is not one of the recognized'):
        logger.info("m", loudly=True)
    with pytest.raises(ValueError, match='of "steady" is not a clock instance'):
        logger.info("m", throttle_duration_sec=1, throttle_time_source_type="steady")
    with pytest.raises(TypeError, match="expected a str as the message, got 5 of type int"):
        logger.info(5)


def test_nothing_and_bytes_are_logged_as_c_prints_them(capsys):
    logger = get_logger("n")
    assert logger.info(None)
    assert logger.info("Zoë".encode())
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition("[n]: ")[2] for line in lines] == ["(null)", "Zoë"]


def logged(times=5, between=lambda: None, logger=None, **options):
    """Whether each call of one place in the program logged."""
    logger = logger or get_logger("n")
    seen = []
    for _ in range(times):
        seen.append(logger.info("m", **options))
        between()
    return seen
