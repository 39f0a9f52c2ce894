"""A recording and the command, for the tests of this folder."""

from __future__ import annotations

import os

import pytest

import srvgen
from srvgen.classes.loader import search
from taskrpc.core.introspection import service_event
from taskrpc.observe.recording.mcap_file import RecordingWriter
from taskrpc.observe.recording.schemas import schema_text

String = srvgen.load("std_msgs/msg/String")
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
ADD_EVENT = "example_interfaces/srv/AddTwoInts_Event"
START = 1_700_000_000 * 10**9


@pytest.fixture
def recording(tmp_path):
    """Three messages, one a tenth of a second, and one call."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    text = writer.add_topic("/chatter", String._TYPE, schema_text(String._TYPE, search()))
    calls = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    for number in range(3):
        data = srvgen.to_cdr(String(data=f"hello {number}"))
        writer.write(text, data, START + number * 10**8)
    for at, step, message in (
        (START + 300_000_000, "REQUEST_RECEIVED", {"request": Add.Request(a=2, b=3)}),
        (START + 313_000_000, "RESPONSE_SENT", {"response": Add.Response(sum=5)}),
    ):
        event = service_event(Add, step, at, [7] * 16, 1, **message)
        writer.write(calls, srvgen.to_cdr(event), at)
    writer.close()
    return writer.path


@pytest.fixture
def bag(run):
    return lambda *argv: run("bag", *map(str, argv))


def cut(recording):
    """Cut the file in the middle of the call, as a killed recorder may."""
    os.truncate(recording, recording.read_bytes().index(b"hello 2") + 40)
