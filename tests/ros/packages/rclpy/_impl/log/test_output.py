"""The levels of loggers, and the lines on the console and on `/rosout`."""

import inspect
import re

import pytest

from taskrpc.ros.packages.rclpy import logging
from taskrpc.ros.packages.rclpy._impl.log import output
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.logging import LoggingSeverity, get_logger

pytestmark = pytest.mark.usefixtures("fresh_log")


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


def test_the_format_has_all_tokens_and_leaves_what_is_none(shown):
    form = "{severity}|{name}|{function_name}|{short_file_name}|{line_number}|{x}{{message}}\\t{"
    line = inspect.currentframe().f_lineno + 1
    _, err = shown(lambda: get_logger("n").info("hello {name}"), RCUTILS_CONSOLE_OUTPUT_FORMAT=form)
    assert err == f"INFO|n|<lambda>|test_output.py|{line}|{{x}}{{hello {{name}}}}\t{{\n"


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
