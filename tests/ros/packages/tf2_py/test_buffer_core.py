"""The buffer with ROS's messages and times, imported by ROS's names."""

import importlib
from types import SimpleNamespace

import pytest


@pytest.fixture
def tf2(ros_names):
    load = importlib.import_module
    return SimpleNamespace(
        module=load("tf2_py"),
        Time=load("rclpy.time").Time,
        Duration=load("rclpy.duration").Duration,
        TimeMessage=load("builtin_interfaces.msg").Time,
    )


def link(parent, child, sec=1, **translation):
    message = importlib.import_module("geometry_msgs.msg").TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec = sec
    for axis, value in translation.items():
        setattr(message.transform.translation, axis, value)
    return message


def test_transform_is_given_back_at_times_of_both_kinds(tf2):
    buffer = tf2.module.BufferCore()
    sent = link("foo", "bar", sec=2, x=42.0, y=-3.14)
    assert buffer.set_transform(sent, "unittest") is None
    for time in (tf2.Time(seconds=2), tf2.TimeMessage(sec=2), tf2.Time()):
        assert buffer.can_transform_core("foo", "bar", time) == (True, "")
        assert buffer.lookup_transform_core("foo", "bar", time) == sent
    two = tf2.Time(seconds=2)
    assert buffer.lookup_transform_full_core("foo", two, "bar", two, "foo") == sent
    assert buffer.can_transform_full_core("foo", tf2.Time(), "bar", tf2.Time(), "foo")[0]
    assert buffer.get_latest_common_time("foo", "bar") == tf2.Time(seconds=2)
    with pytest.raises(TypeError, match="time must have sec and nanosec, or nanoseconds; got int"):
        buffer.lookup_transform_core("foo", "bar", 2)
    with pytest.raises(TypeError, match=r"time is the class Time itself; write Time\(\)"):
        buffer.lookup_transform_core("foo", "bar", tf2.Time)


@pytest.mark.parametrize("name", [None, 5])
def test_name_of_a_frame_must_be_text(tf2, name):
    buffer = tf2.module.BufferCore()
    for look in (buffer.lookup_transform_core, buffer.can_transform_core):
        with pytest.raises(TypeError, match=r"expected the name of a frame \(str\), got"):
            look(name, "bar", tf2.Time())


def test_parts_of_a_second_are_exact(tf2):
    buffer = tf2.module.BufferCore(tf2.Duration(seconds=5))
    sent = link("a", "b", sec=1_700_000_000)
    sent.header.stamp.nanosec = 999_999_999
    buffer.set_transform(sent, "test")
    found = buffer.lookup_transform_core("a", "b", sent.header.stamp)
    assert found.header.stamp == sent.header.stamp


def test_cache_time_limits_the_history(tf2, capsys):
    buffer = tf2.module.BufferCore(tf2.Duration(seconds=5))
    for sec in (10, 4, 16, 17):
        buffer.set_transform(link("a", "b", sec=sec), "me")
    assert capsys.readouterr().err.startswith(
        "Warning: TF_OLD_DATA ignoring data from the past for frame b at time 4.000000"
    )
    assert buffer.can_transform_core("a", "b", tf2.Time(seconds=10)) == (
        False,
        "Lookup would require extrapolation into the past.  Requested time 10.000000 but the"
        " earliest data is at time 16.000000, when looking up transform from frame [b] to frame"
        " [a]",
    )


def test_unusable_transform_is_reported_on_stderr(tf2, capsys):
    buffer = tf2.module.BufferCore()
    buffer.set_transform_static(link("a", "a"), "me")
    assert capsys.readouterr().err.startswith("Error:   TF_SELF_TRANSFORM: Ignoring transform from")


def test_exceptions_have_tf2s_names_and_base_class(tf2):
    buffer = tf2.module.BufferCore()
    with pytest.raises(tf2.module.LookupException) as caught:
        buffer.lookup_transform_core("a", "b", tf2.Time())
    assert isinstance(caught.value, tf2.module.TransformException)
    assert f"{type(caught.value).__module__}.{type(caught.value).__name__}" == "tf2.LookupException"
    assert str(caught.value).startswith('"a" passed to lookupTransform argument target_frame does')


def test_all_frames_are_described(tf2):
    buffer = tf2.module.BufferCore()
    buffer.set_transform(link("a", "b"), "me")
    buffer.set_transform_static(link("b", "c"), "me")
    assert buffer.all_frames_as_string() == (
        "Frame b exists with parent a.\nFrame c exists with parent b.\n"
    )
    assert buffer.all_frames_as_yaml().startswith("b: \n  parent: 'a'\n")
    assert buffer._allFramesAsDot().startswith('digraph G {\n"a" -> "b"[label="Broadcaster: me')
    assert "( 1.000 sec old)" in buffer._allFramesAsDot(tf2.Time(seconds=2))
    assert buffer._getFrameStrings() == ["b", "a", "c"]
    assert (buffer._frameExists("c"), buffer._frameExists("d")) == (True, False)
    assert buffer._chain("a", tf2.Time(), "c", tf2.Time(), "a") == ["c", "b", "a"]
    buffer.clear()
    assert buffer.all_frames_as_string().startswith("Frame b exists with parent NO_PARENT.")
