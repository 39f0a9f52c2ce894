"""Loggers write what ROS 2's write, when they would."""

import inspect
import re
import weakref
from typing import ClassVar

import pytest

from taskrpc.rclpy import logging
from taskrpc.rclpy._impl.log import output
from taskrpc.rclpy.clock import Clock, ROSClock
from taskrpc.rclpy.context import Context
from taskrpc.rclpy.impl import rcutils_logger
from taskrpc.rclpy.impl.rcutils_logger import CallerId, LoggingFilter, Once, SkipFirst
from taskrpc.rclpy.logging import LoggingSeverity, get_logger
from taskrpc.rclpy.time import Time


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch):
    for name in ("OUTPUT_FORMAT", "STDOUT_LINE_BUFFERED"):
        monkeypatch.delenv(f"RCUTILS_CONSOLE_{name}", raising=False)
    monkeypatch.setattr(output, "_owners", weakref.WeakSet())
    logging.shutdown()
    yield
    logging.shutdown()


@pytest.fixture
def shown(capsys, monkeypatch):
    """What a logger writes with the environment given, without and with standard output."""

    def shown(log, **environment):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        logging.clear_config()
        log()
        return capsys.readouterr()

    return shown


def test_a_line_has_its_severity_time_and_name_and_goes_to_standard_error(capsys):
    get_logger("minimal_service").info("Incoming request")
    out, err = capsys.readouterr()
    pattern = r"\[INFO\] \[\d{10}\.\d{9}\] \[minimal_service\]: Incoming request\n"
    assert out == ""
    assert re.fullmatch(pattern, err)


def test_every_severity_has_its_word_and_debug_is_not_shown(capsys):
    logger = get_logger("n")
    logged = [logger.debug("m"), logger.info("m"), logger.warning("m"), logger.warn("m")]
    logged += [logger.error("m"), logger.fatal("m")]
    assert logged == [False] + [True] * 5
    words = [line[1 : line.index("]")] for line in capsys.readouterr().err.splitlines()]
    assert words == ["INFO", "WARN", "WARN", "ERROR", "FATAL"]


def test_the_format_has_all_tokens_and_leaves_what_is_none(shown):
    form = "{severity}|{name}|{function_name}|{short_file_name}|{line_number}|{x}{{message}}\\t{"
    line = inspect.currentframe().f_lineno + 1
    _, err = shown(lambda: get_logger("n").info("hello {name}"), RCUTILS_CONSOLE_OUTPUT_FORMAT=form)
    assert err == f"INFO|n|<lambda>|test_logging.py|{line}|{{x}}{{hello {{name}}}}\t{{\n"


def test_times_are_written_in_seconds_nanoseconds_and_as_a_date(shown):
    form = "{time} {time_as_nanoseconds} {date_time_with_ms}"
    _, err = shown(lambda: get_logger("n").info(""), RCUTILS_CONSOLE_OUTPUT_FORMAT=form)
    seconds, nanoseconds, date, clock = err.split()
    assert nanoseconds == seconds.replace(".", "").zfill(19)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3}", f"{date} {clock}")
    assert clock.endswith(nanoseconds[10:13])


def test_colours_and_standard_output_are_asked_for_by_the_environment(shown):
    out, err = shown(
        lambda: (get_logger("n").warn("a"), get_logger("n").info("b")),
        RCUTILS_COLORIZED_OUTPUT="1",
        RCUTILS_LOGGING_USE_STDOUT="1",
        RCUTILS_LOGGING_BUFFERED_STREAM="1",
        RCUTILS_CONSOLE_OUTPUT_FORMAT="{message}",
    )
    assert (out, err) == ("\033[33ma\033[0m\n\033[0mb\033[0m\n", "")


def test_a_switch_that_is_neither_0_nor_1_is_refused(monkeypatch):
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "yes")
    with pytest.raises(RuntimeError, match=r"unexpected value \[yes\] specified for RCUTILS_COLOR"):
        logging.initialize()


def test_children_take_the_level_of_their_parents_until_they_have_one():
    parent = get_logger("parent")
    child = parent.get_child("child")
    assert child.name == "parent.child"
    parent.set_level(LoggingSeverity.ERROR)
    assert child.get_effective_level() is LoggingSeverity.ERROR
    child.set_level(LoggingSeverity.DEBUG)
    assert (child.is_enabled_for(10), parent.is_enabled_for(30)) == (True, False)
    assert logging.get_logger_level("parent.child") is LoggingSeverity.DEBUG
    child.set_level(LoggingSeverity.UNSET)
    assert child.get_effective_level() is LoggingSeverity.ERROR
    logging.set_logger_level("", 50)
    assert logging.get_logger_effective_level("other") is LoggingSeverity.FATAL
    logging.clear_config()
    assert parent.get_effective_level() is LoggingSeverity.INFO


def test_names_may_not_be_empty_and_levels_must_exist():
    with pytest.raises(ValueError, match=r"^Logger name must not be empty\.$"):
        get_logger("")
    with pytest.raises(ValueError, match=r"^Child logger name must not be empty\.$"):
        get_logger("a").get_child("")
    with pytest.raises(ValueError, match="22 is not a valid LoggingSeverity"):
        logging.set_logger_level("a", 22)
    with pytest.raises(RuntimeError, match="from 'loud': expected one of UNSET, DEBUG"):
        logging.get_logging_severity_from_string("loud")
    assert logging.get_logging_severity_from_string("warn") is LoggingSeverity.WARN


def logged(times=5, between=lambda: None, logger=None, **options):
    """Whether each call of one place in the program logged."""
    logger = logger or get_logger("n")
    seen = []
    for _ in range(times):
        seen.append(logger.info("m", **options))
        between()
    return seen


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


def test_a_console_of_another_code_page_shows_what_it_can(capsys, monkeypatch):
    import io
    import sys

    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(raw, "ascii", write_through=True))
    get_logger("n").info("grüß")
    assert raw.getvalue().decode().rstrip().endswith(r"gr\xfc\xdf")


def test_ros_arguments_set_levels_and_switch_the_console_off(capsys):
    first, second = Context(), Context()
    levels = ["--log-level", "warn", "--log-level", "talker:=debug"]
    first.init(["p", "--ros-args", *levels, "--disable-stdout-logs"])
    second.init(["p"])
    assert get_logger("a").get_effective_level() is LoggingSeverity.WARN
    assert get_logger("talker").get_effective_level() is LoggingSeverity.DEBUG
    get_logger("a").error("unseen")
    first.shutdown()
    get_logger("a").error("unseen, while a context is left")
    second.shutdown()
    get_logger("a").error("seen")
    assert [line.partition(": ")[2] for line in capsys.readouterr().err.splitlines()] == ["seen"]


def test_deprecated_rules_are_warned_of_by_the_logger_rcl(capsys):
    context = Context()
    context.init(["p", "a:=b"])
    context.shutdown()
    assert "[rcl]: Found remap rule 'a:=b'. This syntax is deprecated." in capsys.readouterr().err


def test_lines_of_a_node_s_loggers_reach_its_rosout_publisher():
    records = []

    class Node:
        def publish(self, record):
            records.append(record)

    node = Node()
    output.add_rosout("ns.node", node.publish)
    get_logger("ns.node").info("own")
    get_logger("ns.node").get_child("a").get_child("b").warn("child's")
    get_logger("ns.node2").info("another's")
    output.remove_rosout("ns.node")
    get_logger("ns.node").info("late")
    assert [(r.severity, r.name, r.message) for r in records] == [
        (20, "ns.node", "own"),
        (30, "ns.node.a.b", "child's"),
    ]
    assert records[0].file == __file__
    assert records[0].function == "test_lines_of_a_node_s_loggers_reach_its_rosout_publisher"


def test_the_directory_of_logs_is_where_ros_has_it(monkeypatch, tmp_path):
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert logging.get_logging_directory() == tmp_path / ".ros" / "log"
    monkeypatch.setenv("ROS_HOME", "~/other")
    assert logging.get_logging_directory() == tmp_path / "other" / "log"
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "logs"))
    assert logging.get_logging_directory() == tmp_path / "logs"
