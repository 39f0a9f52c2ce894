"""The recorder writes what the selected topics publish, with their QoS."""

from __future__ import annotations

import asyncio
import logging

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.observe.recording.mcap_file import Recording, RecordingError, RecordingWriter
from taskrpc.observe.recording.recorder import Recorder, Selection

String = srvgen.load("std_msgs/msg/String")
Add = srvgen.load("example_interfaces/srv/AddTwoInts")


@pytest.fixture
async def node():
    async with taskrpc.Node("talker", transport="memory", token="talker") as node:
        yield node


@pytest.fixture
async def listener(node):
    async with taskrpc.Node("recorder", transport="memory", token="recorder") as listener:
        yield listener


@pytest.fixture
def writer(tmp_path):
    return RecordingWriter(tmp_path / "a.mcap")


async def recorded(listener, writer, selection, publish):
    recorder = Recorder(listener, writer, selection, pytest.fail)
    recorder.update(await listener.graph())
    await asyncio.sleep(1)
    await publish()
    await asyncio.sleep(1)
    recorder.close()
    writer.close()
    return list(Recording(writer.path).messages())


async def test_messages_of_a_topic_are_recorded_as_cdr(node, listener, writer):
    publisher = node.create_publisher(String, "/chatter", QoS(4, "best_effort"))

    async def publish():
        publisher.publish(String(data="hello"))

    (message,) = await recorded(listener, writer, Selection(topics=["/chatter"]), publish)
    assert srvgen.from_cdr(String, message.data).data == "hello"
    assert message.topic.type_name == "std_msgs/msg/String"
    assert message.topic.qos == QoS(4, "best_effort")


async def test_latched_message_from_before_the_recording_is_recorded(node, listener, writer):
    node.create_publisher(String, "/state", QoS(1, durability="transient_local")).publish(
        String(data="ready")
    )
    (message,) = await recorded(
        listener, writer, Selection(all_topics=True), lambda: asyncio.sleep(0)
    )
    assert message.topic.qos.is_latched


async def test_calls_of_a_service_are_recorded_as_its_events(node, listener, writer):
    def add(request, response):
        response.sum = request.a + request.b
        return response

    service = node.create_service(Add, "/add", add)
    node.configure_introspection(service, "contents")

    async def call():
        await listener.create_client(Add, "/add").call(Add.Request(a=2, b=3))

    messages = await recorded(listener, writer, Selection(services=["/add"]), call)
    events = [srvgen.from_cdr(Add.Event, message.data) for message in messages]
    assert {message.topic.name for message in messages} == {"/add/_service_event"}
    assert {message.topic.type_name for message in messages} == {
        "example_interfaces/srv/AddTwoInts_Event"
    }
    assert [list(event.request) for event in events] == [[Add.Request(a=2, b=3)], []]
    assert events[1].response[0].sum == 5


async def test_topic_of_an_unknown_type_is_reported_once_and_left_out(
    node, listener, writer, caplog
):
    custom = srvgen.define("nowhere/msg/Custom", "int8 x\n")
    node.create_publisher(custom, "/custom")
    recorder = Recorder(listener, writer, Selection(all_topics=True), pytest.fail)
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            assert recorder.update(await listener.graph()) == []
    assert caplog.text.count("/custom is not recorded") == 1


async def test_disk_that_refuses_a_message_ends_the_recording(node, listener, writer, monkeypatch):
    failures = []
    publisher = node.create_publisher(String, "/chatter")
    recorder = Recorder(listener, writer, Selection(all_topics=True), failures.append)
    recorder.update(await listener.graph())
    await asyncio.sleep(1)

    def full(*_):
        raise RecordingError("cannot write a.mcap: No space left on device")

    monkeypatch.setattr(writer, "write", full)
    for _ in range(3):
        publisher.publish(String())
    await asyncio.sleep(1)
    assert [str(each) for each in failures] == ["cannot write a.mcap: No space left on device"]


@pytest.mark.parametrize(
    ("selection", "wanted"),
    [
        (Selection(topics=["/a"]), {"/a"}),
        (Selection(services=["/s"]), {"/s/_service_event"}),
        (Selection(all_topics=True), {"/a", "/b"}),
        (Selection(all_topics=True, hidden=True), {"/a", "/b", "/_h"}),
        (Selection(all_services=True), {"/s/_service_event", "/t/_service_event"}),
        (Selection(pattern="^/b"), {"/b"}),
        (Selection(all_topics=True, all_services=True, without="a|t"), {"/b", "/s/_service_event"}),
    ],
)
def test_selection_chooses_topics_and_services(selection, wanted):
    known = ["/a", "/b", "/_h", "/s/_service_event", "/t/_service_event"]
    assert {topic for topic in known if selection.wants(topic)} == wanted
    assert not selection.is_empty
    assert Selection().is_empty
