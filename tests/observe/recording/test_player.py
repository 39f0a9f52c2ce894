"""The player publishes a recording again: at its times, with its QoS, in parts."""

from __future__ import annotations

import asyncio

import pytest

import srvgen
import taskrpc
from srvgen.classes.loader import search
from taskrpc import QoS
from taskrpc.core.introspection import service_event
from taskrpc.observe.recording.mcap_file import Recording, RecordingWriter
from taskrpc.observe.recording.player import Player, PlaySettings, playable_class
from taskrpc.observe.recording.schemas import schema_text

String = srvgen.load("std_msgs/msg/String")
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
ADD_EVENT = "example_interfaces/srv/AddTwoInts_Event"
SECOND = 10**9


@pytest.fixture
def recording(tmp_path):
    """Five messages on each of two topics, one a second."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    schema = schema_text("std_msgs/msg/String", search())
    topics = [
        writer.add_topic(name, "std_msgs/msg/String", schema, qos=QoS(2)) for name in ("/a", "/b")
    ]
    for number in range(5):
        for topic in topics:
            data = srvgen.to_cdr(String(data=f"{number}"))
            writer.write(topic, data, 1_000 * SECOND + number * SECOND)
    writer.close()
    return Recording(tmp_path / "a.mcap")


@pytest.fixture
async def node():
    async with taskrpc.Node("player", transport="memory", token="player") as node:
        yield node


@pytest.fixture
async def listener(node):
    async with taskrpc.Node("listener", transport="memory", token="listener") as listener:
        yield listener


async def heard(node, listener, recording, **settings):
    """What a listener hears of the topic /a, with the seconds since the first message."""
    loop, found = asyncio.get_running_loop(), []
    listener.create_subscription(
        String, "/a", lambda message: found.append((loop.time(), message.data))
    )
    player = Player(node, recording, PlaySettings(delay=1.0, **settings))
    await player.play()
    await asyncio.sleep(1)
    return [(round(time - found[0][0], 3), data) for time, data in found], player


async def test_messages_are_published_at_their_times(node, listener, recording):
    found, player = await heard(node, listener, recording)
    assert found == [(0, "0"), (1, "1"), (2, "2"), (3, "3"), (4, "4")]
    assert player.published == 10


async def test_rate_and_offset_and_duration_choose_a_part(node, listener, recording):
    found, _ = await heard(node, listener, recording, rate=2.0, start_offset=1.0, duration=2.0)
    assert found == [(0, "1"), (0.5, "2"), (1, "3")]


@pytest.mark.parametrize(
    ("settings", "published"), [({"topics": ["/a"]}, 5), ({"exclude": ["/a"]}, 5), ({}, 10)]
)
async def test_topics_are_chosen_by_name(node, recording, settings, published):
    player = Player(node, recording, PlaySettings(**settings))
    await player.play()
    assert player.published == published


async def test_recorded_requests_are_sent_again(node, listener, tmp_path):
    writer = RecordingWriter(tmp_path / "calls.mcap")
    topic = writer.add_topic("/add/_service_event", ADD_EVENT, schema_text(ADD_EVENT, search()))
    for number, step in enumerate(("REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT")):
        message = {"request": Add.Request(a=2, b=3)} if number < 2 else {"response": Add.Response()}
        event = service_event(Add, step, number, [7] * 16, 1, **message)
        writer.write(topic, srvgen.to_cdr(event), number)
    writer.close()
    received = []

    def add(request, response):
        received.append((request.a, request.b))
        return response

    listener.create_service(Add, "/add", add)
    player = Player(node, Recording(writer.path), PlaySettings(publish_requests=True))
    await player.play()
    assert received == [(2, 3)]
    assert player.skipped == {}


async def test_type_that_only_the_file_defines_is_played(node, listener, tmp_path):
    writer = RecordingWriter(tmp_path / "own.mcap")
    text = "nowhere/Inner[] inners\n" + "=" * 80 + "\nMSG: nowhere/Inner\nint8 x\n"
    topic = writer.add_topic("/own", "nowhere/msg/Own", text)
    cls = srvgen.define(
        "nowhere/msg/Own", text.replace("nowhere/Inner\nint8", "nowhere/msg/Inner\nint8")
    )
    inner = cls._NESTED["inners"]
    writer.write(topic, srvgen.to_cdr(cls(inners=[inner(x=4)])), 1)
    writer.close()
    found = []
    listener.create_subscription(cls, "/own", found.append)
    await Player(node, Recording(writer.path), PlaySettings(delay=1.0)).play()
    await asyncio.sleep(1)
    assert [each.inners[0].x for each in found] == [4]


async def test_local_class_is_used_if_it_has_the_recorded_definition(recording):
    list(recording.messages())
    assert {playable_class(topic) for topic in recording.topics.values()} == {String}


async def test_topic_that_cannot_be_played_is_left_out_with_its_reason(node, tmp_path):
    writer = RecordingWriter(tmp_path / "odd.mcap")
    writer.write(writer.add_topic("/odd", "nowhere/msg/Odd", "this is no definition"), b"x", 1)
    writer.write(writer.add_topic("/cut", "std_msgs/msg/String", "string data\n"), b"\0\1\0\0", 2)
    writer.close()
    player = Player(node, Recording(writer.path), PlaySettings())
    await player.play()
    assert set(player.skipped) == {"/odd", "/cut"}
    assert player.published == 0


async def test_message_that_is_older_than_the_first_one_is_played_too(node, listener, tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    topic = writer.add_topic("/a", String._TYPE, schema_text(String._TYPE, search()))
    for time in (1000 * SECOND, 999 * SECOND, 1001 * SECOND):
        writer.write(topic, srvgen.to_cdr(String(data=f"{time // SECOND}")), time)
    writer.close()
    found, _ = await heard(node, listener, Recording(writer.path))
    assert found == [(0, "1000"), (0, "999"), (1, "1001")]
