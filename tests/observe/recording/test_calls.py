"""The calls of a recording: requests and responses of every client, put together."""

from __future__ import annotations

import msgspec
import pytest

import srvgen
from srvgen.classes.loader import search
from taskrpc.core.introspection import service_event
from taskrpc.observe.recording.calls import CALLS_TOPIC, CallReader, is_about_calls
from taskrpc.observe.recording.mcap_file import Recording, RecordingWriter
from taskrpc.observe.recording.schemas import schema_text

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
ADD_EVENT = "example_interfaces/srv/AddTwoInts_Event"


def calls_of(path, **options):
    """The calls of a recording, in the order of their start."""
    reader = CallReader(**options)
    for message in Recording(path).messages(keep=is_about_calls):
        reader.take(message)
    return sorted(reader.calls, key=lambda call: call.begin)


def calls(tmp_path, *steps):
    """The calls of a recording with these events: step, seconds, client, number, message."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    topic = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    for step, seconds, client, number, message in steps:
        at = round(seconds * 1e9)
        event = service_event(Add, step, at, [client] * 16, number, **message)
        writer.write(topic, srvgen.to_cdr(event), at)
    writer.close()
    return calls_of(writer.path)


ASK, TELL = {"request": Add.Request(a=2, b=3)}, {"response": Add.Response(sum=5)}


def test_response_belongs_to_the_request_of_the_same_client_and_number(tmp_path):
    found = calls(
        tmp_path,
        ("REQUEST_RECEIVED", 1.0, 7, 1, ASK),
        ("REQUEST_RECEIVED", 2.0, 8, 1, ASK),
        ("RESPONSE_SENT", 3.0, 8, 1, TELL),
        ("RESPONSE_SENT", 5.0, 7, 1, TELL),
    )
    assert [(call.client, call.begin, call.ms) for call in found] == [
        ("client 1", 1.0, pytest.approx(4000)),
        ("client 2", 2.0, pytest.approx(1000)),
    ]
    assert (found[0].request, found[0].response) == ("a=2 b=3", "sum=5")


def test_events_of_client_and_server_are_one_call_from_first_to_last(tmp_path):
    steps = ("REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED")
    (call,) = calls(tmp_path, *((step, 1.0 + n, 7, 1, {}) for n, step in enumerate(steps)))
    assert (call.begin, call.ms, call.state) == (1.0, pytest.approx(3000), "ok")


def test_call_without_a_response_is_open(tmp_path):
    (call,) = calls(tmp_path, ("REQUEST_RECEIVED", 1.0, 7, 1, ASK))
    assert (call.state, call.ms) == ("open", None)


async def test_end_that_the_server_recorded_names_the_client(recorded_run):
    found = calls_of(recorded_run)
    assert {call.client for call in found} == {"/ada"}
    assert found[0].request == "task_type=move target=warehouse priority=5"
    assert found[0].task_id == 1
    assert {call.state for call in found} == {"ok"}


async def test_reader_without_texts_finds_the_same_calls(recorded_run):
    found = calls_of(recorded_run)
    assert any(call.request for call in found)
    plain = [msgspec.structs.replace(call, request="", response="") for call in found]
    assert calls_of(recorded_run, texts=False) == plain


@pytest.mark.parametrize("data", [b"{", b"\xff", b"[" * 100_000, b'{"number": 2}'])
def test_damaged_line_about_a_call_is_left_out(tmp_path, data):
    writer = RecordingWriter(tmp_path / "a.mcap")
    writer.write(writer.add_json_topic(CALLS_TOPIC), data, 1)
    writer.close()
    assert calls_of(writer.path) == []
