"""Each log line says to which call it belongs, and as JSON it is one line, whatever is in it."""

import io
import json
import logging
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taskrpc
from taskrpc import logs
from tests.core.transport.helpers import Add, add, ask
from tests.properties import examples


def record(message="hello", *args, error=None, **extra):
    made = logging.LogRecord("lab", logging.INFO, __file__, 1, message, args, error)
    vars(made).update(extra)
    return made


def line(*args, **extra):
    text = logs.JsonFormatter().format(record(*args, **extra))
    assert "\n" not in text
    return json.loads(text, parse_constant=pytest.fail)


@pytest.fixture
def said():
    """What the root logger writes, line by line, as objects."""
    stream = io.StringIO()
    handler = logs.handler("json", stream)
    logger = logging.getLogger()
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    yield lambda: [json.loads(each) for each in stream.getvalue().splitlines()]
    logger.removeHandler(handler)
    logger.setLevel(before)


def test_a_line_has_time_level_logger_and_message():
    got = line("task %d to %s", 7, "dock")
    assert got.pop("time").endswith("Z")
    assert got == {"level": "INFO", "logger": "lab", "message": "task 7 to dock"}


def test_the_time_is_utc_with_microseconds():
    made = record()
    made.created = 1.5
    text = logs.JsonFormatter().format(made)
    assert json.loads(text)["time"] == "1970-01-01T00:00:01.500000Z"


def test_extra_fields_of_a_record_are_keys_of_the_json_line():
    got = line(pose={"x": 1.5}, task=3)
    assert set(got) == {"time", "level", "logger", "message", "pose", "task"}
    assert got["pose"] == {"x": 1.5}


def test_a_traceback_is_one_field():
    try:
        raise OSError("no battery")
    except OSError:
        got = line(error=sys.exc_info())
    assert got["error"].startswith("Traceback (most recent call last):\n")
    assert got["error"].endswith("OSError: no battery")


anything = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text() | st.binary() | st.just(object()),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text() | st.tuples(), inner, max_size=3)
    ),
)


@settings(max_examples=examples(40))
@given(
    st.text(), st.dictionaries(st.from_regex(r"x_[a-z]{1,5}", fullmatch=True), anything, max_size=4)
)
def test_every_record_becomes_one_line_of_valid_json(message, extra):
    got = line("%s", message, **extra)
    assert got["message"] == message
    assert {name for name, value in extra.items() if value != ""} <= set(got)


def test_list_that_contains_itself_becomes_text():
    ring = []
    ring.append(ring)
    assert line(ring=ring)["ring"] == "[[...]]"


def test_an_unknown_style_is_refused():
    with pytest.raises(ValueError, match="expected 'text' or 'json', got 'xml'"):
        logs.handler("xml")


def test_a_text_line_looks_as_in_ros_2():
    stream = io.StringIO()
    logs.handler("text", stream).handle(record())
    assert stream.getvalue().startswith("[INFO] [")
    assert stream.getvalue().endswith("] [lab]: hello\n")


def text_of(*args, **extra):
    """A line of text without its head."""
    text = logs.TextFormatter().format(record(*args, **extra))
    return text.partition("]: ")[2]


def test_a_caller_cannot_forge_a_line_of_text():
    assert text_of("to %s", "dock\n[ERROR] it burns") == r"to dock\n[ERROR] it burns"
    assert (
        text_of("to %s", "a\r\x1b[2J\x9b\u202e\u2028\x7f") == r"to a\r\x1b[2J\x9b\u202e\u2028\x7f"
    )
    assert text_of("two\nlines: %s", "a\n[ERROR] b") == "two\n  lines: a\n  [ERROR] b"


def test_printable_characters_are_not_escaped():
    assert text_of("%s", "Küche\t→ 厨房 \xa0✓") == "Küche\t→ 厨房 \xa0✓"


def test_traceback_that_another_handler_formatted_first_cannot_forge_a_line():
    try:
        raise OSError("no\n[ERROR] it burns\x1b[2J")
    except OSError:
        made = record("task failed", error=sys.exc_info())
    logging.Formatter().format(made)
    first, *more = logs.TextFormatter().format(made).split("\n")
    assert first.endswith("]: task failed")
    assert more[0] == "  Traceback (most recent call last):"
    assert more[-2:] == ["  OSError: no", r"  [ERROR] it burns\x1b[2J"]
    assert all(line.startswith("  ") for line in more)


@settings(max_examples=examples(40))
@given(st.text())
def test_every_message_is_one_line_of_text(message):
    assert len(text_of("%s", message).splitlines()) <= 1


def test_outside_a_callback_the_fields_are_empty():
    made = record()
    assert logs.CallFilter().filter(made)
    assert [getattr(made, name) for name in logs.CALL_FIELDS] == [""] * len(logs.CALL_FIELDS)


async def call_once(callback, **options):
    async with (
        taskrpc.Node("server", transport="memory", token="server") as server,
        taskrpc.Node("client", transport="memory", token="client") as node,
    ):
        server.create_service(Add, "add", callback, **options)
        return await node.create_client(Add, "add").call(ask(2, 3))


async def asynchronous(request, response):
    return logging_add(request, response)


def logging_add(request, response):
    logging.getLogger("mine").info("adding, call %d", taskrpc.current_call().number)
    return add(request, response)


@pytest.mark.parametrize(
    ("callback", "threaded"),
    [(logging_add, False), (asynchronous, False), (logging_add, True)],
    ids=["plain", "async", "threaded"],
)
async def test_a_line_of_a_callback_carries_its_call(said, callback, threaded):
    await call_once(callback, threaded=threaded)
    (mine,) = [each for each in said() if each["logger"] == "mine"]
    assert mine["message"] == f"adding, call {mine['call']}"
    assert (mine["service"], mine["caller"]) == ("/add", "/client")


async def test_log_line_of_a_failed_call_has_the_number_that_the_caller_gets(said):
    def fail(request, response):
        raise OSError("no battery")

    with pytest.raises(taskrpc.HandlerFailed) as caught:
        await call_once(fail)
    number = int(str(caught.value).rpartition("call ")[2])
    (found,) = [each for each in said() if each.get("call") == number and "error" in each]
    assert found["level"] == "ERROR"
    assert (found["service"], found["caller"]) == ("/add", "/client")
    assert "OSError: no battery" in found["error"]
    assert "battery" not in found["message"]


async def test_begin_and_end_of_each_call_are_logged_at_debug(said):
    await call_once(add)
    lines = [each for each in said() if each["logger"] == "taskrpc.server"]
    number = lines[0]["call"]
    assert lines[0]["message"] == f"call {number} of /add from /client began"
    assert lines[1]["message"].startswith(f"call {number} of /add from /client ended: OK after ")


async def test_calls_are_not_logged_at_info(said):
    logging.getLogger().setLevel(logging.INFO)
    await call_once(add)
    assert [each for each in said() if each["logger"].startswith("taskrpc")] == []
