"""The page gets the frames that programs publish, and forgets those of programs that ended."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.observe.web import transforms
from taskrpc.observe.web.calls import CallLog
from taskrpc.observe.web.graph import NodeGraph
from taskrpc.qos import QoS

TFMessage = srvgen.load("tf2_msgs/msg/TFMessage")
TransformStamped = srvgen.load("geometry_msgs/msg/TransformStamped")
LATCHED = QoS(1, "reliable", "transient_local")


def transform(child, parent, *, x=0.0, w=1.0):
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.transform.translation.x = x
    made.transform.rotation.w = w
    return made


def shown(child, parent, *, x=0.0):
    return {"name": child, "parent": parent, "at": [x, 0.0, 0.0], "turn": [0.0, 0.0, 0.0, 1.0]}


@pytest.fixture
async def nodes():
    async with (
        taskrpc.Node("watcher", transport="memory", token="watcher") as watcher,
        taskrpc.Node("robot", transport="memory", token="robot") as robot,
    ):
        yield NodeGraph(watcher, CallLog(), is_own=lambda entry: False), robot


async def frames_after(graph, change=lambda: None):
    """The frames after a look, when the change has had its time; the time is virtual."""
    await graph.look()
    await asyncio.sleep(1)
    change()
    await asyncio.sleep(1)
    await graph.look()
    return graph.frames()


async def test_frames_are_shown_with_their_newest_transform_until_their_program_ends(nodes):
    graph, robot = nodes
    assert await frames_after(graph) == []
    moving = robot.create_publisher(TFMessage, "/tf", QoS(100))
    fixed = robot.create_publisher(TFMessage, "/tf_static", LATCHED)
    fixed.publish(TFMessage(transforms=[transform("laser", "base_link", x=0.25)]))

    def drive():
        for x in (1.0, 2.00004):
            moving.publish(TFMessage(transforms=[transform("base_link", "map", x=x, w=2.0)]))

    both = [shown("base_link", "map", x=2.0), shown("laser", "base_link", x=0.25)]
    assert await frames_after(graph, drive) == both
    moving.destroy()
    assert await frames_after(graph) == [shown("laser", "base_link", x=0.25)]
    graph.close()
    assert graph.frames() == []


async def test_frames_that_cannot_be_drawn_are_left_out_and_their_number_is_bounded(
    nodes, monkeypatch
):
    monkeypatch.setattr(transforms, "MAX_FRAMES", 2)
    graph, robot = nodes
    moving = robot.create_publisher(TFMessage, "/tf", QoS(100))
    odd = [
        transform("a", "map", x=float("nan")),
        transform("b", "map", w=0.0),
        transform("", "map"),
        transform("c", ""),
    ]
    good = [transform(name, "map") for name in ("d", "e", "f")]

    def publish():
        moving.publish(TFMessage(transforms=[*odd, *good]))

    assert await frames_after(graph, publish) == [shown("d", "map"), shown("e", "map")]
