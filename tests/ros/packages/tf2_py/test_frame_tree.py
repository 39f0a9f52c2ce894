"""Lookups in a tree of frames: any way through it, tf2's errors, any order of arrival."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.ros.packages.tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from taskrpc.ros.packages.tf2_py.descriptions import as_dot, as_yaml
from taskrpc.ros.packages.tf2_py.frame_tree import FrameTree
from taskrpc.ros.packages.tf2_py.geometry import Transform, quaternion_of_angles
from tests.properties import examples

SECOND = 1_000_000_000
LEFT = quaternion_of_angles(0, 0, math.pi / 2)


def at(x=0.0, y=0.0, z=0.0, rotation=(0.0, 0.0, 0.0, 1.0)):
    return Transform((x, y, z), rotation)


def tree_of(*links, time=SECOND, is_static=False):
    tree = FrameTree()
    for parent, child, transform in links:
        assert tree.set(parent, child, time, transform, "test", is_static=is_static) == []
    return tree


def translation(tree, target, source, time=0):
    return tree.lookup(target, source, time)[0].translation


def near(values):
    return pytest.approx(tuple(values), abs=1e-7)


@pytest.fixture
def robot():
    """A robot in a world, with a camera and an arm; all of it at 1 s."""
    return tree_of(
        ("world", "base", at(1, 2, rotation=LEFT)),
        ("base", "camera", at(0.5)),
        ("base", "arm", at(0, 0.3)),
        ("arm", "hand", at(0, 0, 0.2)),
    )


def test_lookups_go_up_down_and_across(robot):
    assert translation(robot, "world", "camera") == near((1, 2.5, 0))
    assert translation(robot, "camera", "world") == near((-2.5, 1, 0))
    assert translation(robot, "camera", "hand") == near((-0.5, 0.3, 0.2))
    assert translation(robot, "hand", "camera") == near((0.5, -0.3, -0.2))
    assert robot.lookup("arm", "arm", 0) == (Transform(), SECOND)
    assert robot.lookup("arm", "arm", 7) == (Transform(), 7)
    assert robot.lookup("nowhere", "nowhere", 7) == (Transform(), 7)  # as in tf2


def test_chain_names_the_frames_on_the_way(robot):
    assert robot.chain("camera", 0, "hand", 0, "camera") == ["hand", "arm", "base", "camera"]
    assert robot.chain("world", 0, "hand", 0, "base") == ["hand", "arm", "base", "world"]
    assert robot.chain("base", 0, "world", 0, "world") == ["world", "base"]


@pytest.mark.parametrize(
    ("target", "source", "kind", "text"),
    [
        (
            "x",
            "base",
            LookupException,
            '"x" passed to lookupTransform argument target_frame does not exist. ',
        ),
        (
            "base",
            "x",
            LookupException,
            '"x" passed to lookupTransform argument source_frame does not exist. ',
        ),
        (
            "",
            "base",
            InvalidArgumentException,
            'Invalid argument "" passed to lookupTransform argument target_frame - in tf2 frame_ids'
            " cannot be empty",
        ),
        (
            "base",
            "/arm",
            InvalidArgumentException,
            'Invalid argument "/arm" passed to lookupTransform argument source_frame - in tf2'
            " frame_ids cannot start with a '/'",
        ),
        (
            "base",
            "island",
            ConnectivityException,
            "Could not find a connection between 'base' and 'island' because they are not part of"
            " the same tree.Tf has two or more unconnected trees.",
        ),
    ],
)
def test_impossible_lookups_have_the_texts_of_tf2(robot, target, source, kind, text):
    robot.set("sea", "island", SECOND, at(), "test")
    for time in (0, SECOND):
        with pytest.raises(kind) as caught:
            robot.lookup(target, source, time)
        assert str(caught.value) == text
    assert robot.obstacle(target, source, 0)


def test_obstacles_have_the_texts_of_tf2(robot):
    robot.set("sea", "island", SECOND, at(), "test")
    said = "passed to canTransform argument"
    assert robot.obstacle("world", "hand", 0) == ""
    assert robot.obstacle("hand", "hand", 0) == ""
    assert robot.obstacle("", "hand", 0) == (
        f'Invalid frame ID "" {said} target_frame - in tf2 frame_ids cannot be empty'
    )
    assert robot.obstacle("/world", "hand", 0) == (
        f'Invalid frame ID "/world" {said} target_frame'
        " - in tf2 frame_ids cannot start with a '/'"
    )
    assert robot.obstacle("world", "foot", 0) == (
        f'Invalid frame ID "foot" {said} source_frame - frame does not exist'
    )
    assert robot.obstacle("world", "island", 0).startswith("Could not find a connection")
    assert robot.obstacle_full("world", 0, "hand", 0, "base") == ""
    assert "fixed_frame - frame does not exist" in robot.obstacle_full("world", 0, "arm", 0, "x")
    assert "Could not find" in robot.obstacle_full("world", 0, "arm", 0, "sea")


def test_extrapolation_names_the_times_and_the_frames(robot):
    robot.set("world", "base", 2 * SECOND, at(3, 2, rotation=LEFT), "test")
    with pytest.raises(ExtrapolationException) as caught:
        robot.lookup("world", "base", 5 * SECOND)
    assert str(caught.value) == (
        "Lookup would require extrapolation into the future.  Requested time 5.000000 but the"
        " latest data is at time 2.000000, when looking up transform from frame [base] to frame"
        " [world]"
    )
    assert robot.obstacle("world", "base", 5 * SECOND) == str(caught.value)
    with pytest.raises(ExtrapolationException, match=r"extrapolation into the past\.  Requested"):
        robot.lookup("base", "world", SECOND // 2)
    assert translation(robot, "world", "base", 3 * SECOND // 2) == near((2, 2, 0))


def test_latest_lookup_uses_the_latest_common_time(robot):
    robot.set("base", "camera", 3 * SECOND, at(1.5), "test")
    assert robot.latest_common_time("world", "camera") == SECOND
    assert robot.lookup("world", "camera", 0)[1] == SECOND
    assert robot.lookup("base", "camera", 0)[1] == 3 * SECOND
    assert robot.latest_common_time("camera", "base") == 3 * SECOND
    assert robot.latest_common_time("camera", "arm") == SECOND
    assert robot.latest_common_time("camera", "camera") == 3 * SECOND
    with pytest.raises(LookupException, match='"x" passed to get_latest_common_time does not'):
        robot.latest_common_time("x", "base")


def test_static_transforms_do_not_limit_the_time(robot):
    robot.set("hand", "finger", 0, at(0, 0, 0.1), "test", is_static=True)
    assert robot.lookup("base", "finger", 0)[1] == SECOND
    assert robot.lookup("hand", "finger", 0) == (at(0, 0, 0.1), 0)
    assert robot.lookup("hand", "finger", 99)[1] == 99


def test_full_lookup_goes_through_two_times():
    tree = tree_of(("world", "turtle", at(1)), ("world", "carrot", at(5)))
    tree.set("world", "turtle", 2 * SECOND, at(2), "test")
    tree.set("world", "carrot", 2 * SECOND, at(6), "test")
    found, time = tree.lookup_full("turtle", 2 * SECOND, "carrot", SECOND, "world")
    assert (found.translation, time) == (near((3, 0, 0)), 2 * SECOND)
    with pytest.raises(LookupException, match='"x" passed to lookupTransform argument fixed_frame'):
        tree.lookup_full("turtle", 0, "carrot", 0, "x")


def test_rotation_is_returned_with_tf2s_sign():
    tree = tree_of(("a", "b", at(rotation=(0.0, 0.0, 0.0, -1.0))))
    assert str(tree.lookup("a", "b", 0)[0]) == str(Transform())
    assert str(tree.lookup("b", "a", 0)[0]) == str(Transform())


def test_longer_quaternion_is_normalised_as_in_tf2():
    tree = tree_of(("a", "b", at(rotation=(0.0, 0.0, 2.0, 2.0))))
    assert tree.lookup("a", "b", 0)[0].rotation == near(LEFT)


NAN = math.nan


@pytest.mark.parametrize(
    ("parent", "child", "transform", "text"),
    [
        (
            "a",
            "/a",
            at(),
            'TF_SELF_TRANSFORM: Ignoring transform from authority "me" with frame_id and '
            ' child_frame_id "a" because they are the same',
        ),
        (
            "a",
            "",
            at(),
            'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "me" because child_frame_id'
            " not set ",
        ),
        (
            "",
            "b",
            at(),
            'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "b"  from authority "me"'
            " because frame_id not set",
        ),
        (
            "a",
            "b",
            at(NAN, 1),
            'TF_NAN_INPUT: Ignoring transform for child_frame_id "b" from authority "me" because of'
            " a nan value in the transform (nan 1.000000 0.000000) (0.000000 0.000000 0.000000"
            " 1.000000)",
        ),
        (
            "a",
            "b",
            at(rotation=(0.0, 0.0, 0.0, 0.0)),
            'TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "b" from authority'
            ' "me" because of an invalid quaternion in the transform (0.000000 0.000000 0.000000'
            " 0.000000)",
        ),
        (
            "a",
            "b",
            at(rotation=(0.0, 0.0, 0.0, math.inf)),
            'TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "b" from authority'
            ' "me" because of an invalid quaternion in the transform (0.000000 0.000000 0.000000'
            " inf)",
        ),
    ],
)
def test_unusable_transforms_are_refused_in_tf2s_words(parent, child, transform, text):
    tree = FrameTree()
    assert tree.set(parent, child, SECOND, transform, "me") == [text]
    assert tree.names() == []


def test_old_transform_is_refused():
    tree = tree_of(("a", "b", at()), time=30 * SECOND)
    assert tree.set("a", "b", 20 * SECOND, at(), "me") == []
    (refused,) = tree.set("a", "b", 19 * SECOND, at(), "me")
    assert refused.startswith(
        "TF_OLD_DATA ignoring data from the past for frame b at time 19.000000 according to"
        " authority me\nPossible reasons are listed at http://wiki.ros.org/tf/Errors%20explained"
    )


def test_loop_of_frames_is_refused():
    tree = tree_of(("a", "b", at()), ("b", "a", at()), ("s", "c", at()))
    with pytest.raises(LookupException) as caught:
        tree.lookup("c", "a", SECOND)
    assert str(caught.value) == (
        "The tf tree is invalid because it contains a loop.\n"
        "Frame b exists with parent a.\nFrame a exists with parent b.\n"
        "Frame c exists with parent s.\n\n"
    )
    with pytest.raises(LookupException, match="contains a loop"):
        tree.latest_common_time("c", "a")


def test_frame_moves_to_another_parent():
    tree = tree_of(("a", "b", at(1)), ("a", "c", at(10)))
    tree.set("a", "c", 3 * SECOND, at(10), "test")
    tree.set("c", "b", 3 * SECOND, at(1), "test")
    assert translation(tree, "a", "b", SECOND) == near((1, 0, 0))
    assert translation(tree, "a", "b", 3 * SECOND) == near((11, 0, 0))


def test_frame_becomes_static_and_moves_again():
    tree = tree_of(("a", "b", at(1)))
    tree.set("a", "b", SECOND, at(2), "test", is_static=True)
    assert tree.lookup("a", "b", 99) == (at(2), 99)
    tree.set("a", "b", 2 * SECOND, at(3), "test")
    assert tree.lookup("a", "b", 0) == (at(3), 2 * SECOND)


def test_clear_keeps_names_and_static_transforms(robot):
    robot.set("hand", "finger", 0, at(0, 0, 0.1), "test", is_static=True)
    robot.clear()
    assert robot.knows("camera")
    assert translation(robot, "hand", "finger") == (0, 0, 0.1)
    with pytest.raises(ConnectivityException):
        robot.lookup("world", "camera", 0)
    with pytest.raises(ExtrapolationException):
        robot.lookup("world", "camera", SECOND)
    assert "Frame base exists with parent NO_PARENT.\n" in robot.as_string()


def test_descriptions_have_the_format_of_tf2():
    tree = FrameTree()
    assert (as_yaml(tree), tree.as_string()) == ("[]", "")
    assert as_dot(tree) == 'digraph G {\n"no tf data recieved"\n}'
    tree.set("base_link", "odom", 0, at(1, 1, 1), "default_authority", is_static=True)
    assert as_yaml(tree) == (
        "odom: \n  parent: 'base_link'\n  broadcaster: 'default_authority'\n  rate: 10000.000\n"
        "  most_recent_transform: 0.000000\n  oldest_transform: 0.000000\n"
        "  buffer_length: 0.000\n"
    )
    tree = tree_of(("a", "b", at()))
    tree.set("a", "b", 3 * SECOND, at(), "test")
    assert "  rate: 1.000\n  most_recent_transform: 3.000000\n" in as_yaml(tree)
    assert "  oldest_transform: 1.000000\n  buffer_length: 2.000\n" in as_yaml(tree)
    assert as_dot(tree, 4 * SECOND).splitlines()[:2] == [
        "digraph G {",
        '"a" -> "b"[label="Broadcaster: test\\nAverage rate: 1.000 Hz\\nMost recent transform:'
        ' 3.000000 ( 1.000 sec old)\\nBuffer length: 2.000 sec\\n"];',
    ]
    assert '"Recorded at time: 4.000000"[ shape=plaintext ] ;\n }->"a";' in as_dot(tree, 4 * SECOND)
    assert tree.names() == ["b", "a"]


number = st.floats(-10, 10).map(lambda value: round(value, 3))
poses = st.builds(
    lambda x, y, z, *angles: Transform((x, y, z), quaternion_of_angles(*angles)),
    *[number] * 6,
)


@st.composite
def trees(draw):
    """The links of a tree: each frame hangs below one of those before it."""
    count = draw(st.integers(2, 7))
    return [(f"f{draw(st.integers(0, n - 1))}", f"f{n}", draw(poses)) for n in range(1, count)]


@settings(max_examples=examples(40))
@given(trees(), st.data())
def test_transforms_along_any_way_agree(links, data):
    tree = tree_of(*links)
    frame = st.sampled_from(tree.names())
    a, b, c = data.draw(frame), data.draw(frame), data.draw(frame)
    point = (1.0, -2.0, 0.5)
    ab, bc, ac = (tree.lookup(*pair, 0)[0] for pair in ((a, b), (b, c), (a, c)))
    assert ac.apply(point) == near(ab.apply(bc.apply(point)))
    assert tree.lookup(b, a, 0)[0].apply(ab.apply(point)) == near(point)
    chain = tree.chain(a, 0, b, 0, a)
    assert (chain[0], chain[-1], len(set(chain))) == (b, a, len(chain))


@settings(max_examples=examples(40))
@given(trees(), st.data())
def test_order_of_arrival_does_not_matter(links, data):
    timed = [(*link, time) for link in links for time in (SECOND, 2 * SECOND)]
    tree, other = FrameTree(), FrameTree()
    for arrived, order in ((tree, timed), (other, data.draw(st.permutations(timed)))):
        for parent, child, transform, time in order:
            arrived.set(parent, child, time, transform, "test")
    for name in tree.names():
        for time in (0, SECOND, 3 * SECOND // 2):
            assert tree.lookup("f0", name, time) == other.lookup("f0", name, time)
            assert tree.obstacle("f0", name, time) == other.obstacle("f0", name, time) == ""


@settings(max_examples=examples(40))
@given(trees(), st.data())
def test_lookup_fails_exactly_when_there_is_an_obstacle(links, data):
    tree = FrameTree()
    times = st.integers(1, 4).map(lambda time: time * SECOND)
    for parent, child, transform in links:
        for time in data.draw(st.lists(times, min_size=1, max_size=3)):
            tree.set(parent, child, time, transform, "test")
    tree.set("g0", "g1", SECOND, at(), "test")
    frame = st.sampled_from([*tree.names(), "", "/f1", "unknown"])
    target, source = data.draw(frame), data.draw(frame)
    time = data.draw(st.sampled_from([0, SECOND, 5 * SECOND // 2, 9 * SECOND]))
    obstacle = tree.obstacle(target, source, time)
    if not obstacle:
        tree.lookup(target, source, time)
        return
    with pytest.raises(TransformException) as caught:
        tree.lookup(target, source, time)
    if isinstance(caught.value, ConnectivityException | ExtrapolationException):
        assert str(caught.value) == obstacle
