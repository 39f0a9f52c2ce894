"""The map of the live page draws the frames of `/tf` and `/tf_static` where they are."""

from __future__ import annotations

import math

import pytest

import srvgen
from taskrpc import sync
from taskrpc.qos import QoS
from taskrpc.ros.packages.tf2_py.geometry import Transform, quaternion_of_angles

TFMessage = srvgen.load("tf2_msgs/msg/TFMessage")
TransformStamped = srvgen.load("geometry_msgs/msg/TransformStamped")

ARM = Transform((0.5, 0.25, 0.75), quaternion_of_angles(0.3, -0.4, 1.2))
HAND = Transform((0.1, -0.2, 0.3), quaternion_of_angles(-1.0, 0.6, 2.0))
BASE = Transform((3.0, 2.0, 0.0), quaternion_of_angles(0.0, 0.0, math.pi / 2))

PLACE = """
const { placedFrames } = await import("./frames.js");
return placedFrames(args[0], args[1]);
"""


def frame(name, parent, transform):
    return {
        "name": name,
        "parent": parent,
        "at": list(transform.translation),
        "turn": list(transform.rotation),
    }


def expected(transform):
    """The origin, and the directions of x and y, computed by tf2's functions."""
    origin = transform.translation
    axes = [transform.apply(axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    return [
        *origin,
        *(end - begin for axis in axes for end, begin in zip(axis, origin, strict=True)),
    ]


def test_frames_are_placed_as_tf2_places_them(start_server, open_page):
    page = open_page(start_server())
    tree = [
        frame("hand", "arm", HAND),
        frame("arm", "base_link", ARM),
        frame("base_link", "map", BASE),
        frame("a", "b", ARM),
        frame("b", "a", ARM),  # a circle
    ]
    robot = {"x": 1.0, "y": -2.0, "theta": 0.7}
    found = {each["name"]: each for each in page.tab.run_async(PLACE, tree, robot)}
    assert set(found) == {"map", "base_link", "arm", "hand"}
    wanted = {
        "map": Transform(),
        "base_link": BASE,
        "arm": BASE.after(ARM),
        "hand": BASE.after(ARM).after(HAND),
    }
    for name, transform in wanted.items():
        numbers = [*found[name]["origin"], *found[name]["axes"][0], *found[name]["axes"][1]]
        assert numbers == pytest.approx(expected(transform), abs=1e-12), name

    # Without a map, the tree stands at the robot.
    standing = Transform((1.0, -2.0, 0.0), quaternion_of_angles(0.0, 0.0, 0.7))
    [base, arm] = page.tab.run_async(PLACE, [frame("arm", "base_link", ARM)], robot)
    assert (base["name"], arm["name"]) == ("base_link", "arm")
    assert arm["origin"] == pytest.approx(standing.after(ARM).translation, abs=1e-12)


def test_the_map_shows_the_frames_of_a_program_while_it_publishes(start_server, open_page):
    page = open_page(start_server())
    texts = "return [...document.querySelectorAll('.frames text')].map(t => t.firstChild.data)"
    assert page.tab.run(texts) == []
    with sync.Node("robot") as node:
        fixed = node.create_publisher(
            TFMessage, "/tf_static", QoS(1, "reliable", "transient_local")
        )
        stamped = []
        for name, parent, x in (("base_link", "map", 3.0), ("laser", "base_link", 0.01)):
            made = TransformStamped(child_frame_id=name)
            made.header.frame_id = parent
            made.transform.translation.x = x
            stamped.append(made)
        fixed.publish(TFMessage(transforms=stamped))
        page.tab.wait(lambda: page.tab.run(texts) == ["map", "base_link +1"], "the frames")
        assert len(page.tab.all(".frames .axis_x")) == len(page.tab.all(".frames .axis_y")) == 3
    page.tab.wait(lambda: page.tab.run(texts) == [], "no frames")
