"""Transforming and converting messages by registered functions."""

import pytest


@pytest.fixture
def interface(ros):
    return ros.module("tf2_ros.buffer_interface")


def test_message_is_transformed_at_the_time_of_its_header(ros, link):
    ros.module("tf2_geometry_msgs")
    buffer = ros.tf2_ros.Buffer()
    for sec in (1, 3):
        buffer.set_transform(link("map", "robot", sec=sec, x=float(sec)), "me")
    point = ros.geometry.PointStamped()
    point.header.frame_id = "robot"
    point.header.stamp.sec = 2
    found = buffer.transform(point, "map", new_type=ros.geometry.PointStamped)
    assert (found.point.x, found.header.frame_id, found.header.stamp.sec) == (2.0, "map", 2)
    full = buffer.transform_full(point, "robot", ros.Time(seconds=3), "map")
    assert full.point.x == -1.0


def test_unregistered_type_is_refused(ros, link, interface):
    buffer = ros.tf2_ros.Buffer()
    with pytest.raises(ros.tf2_ros.TypeException) as caught:
        buffer.transform(ros.geometry.TwistStamped(), "map")
    assert caught.value.errstr.endswith("is not loaded or supported")
    with pytest.raises(interface.TypeException, match="is not loaded or supported"):
        interface.convert(1, str)


def test_unregistered_message_type_names_the_package_to_import(ros, interface, monkeypatch):
    monkeypatch.setattr(interface.TransformRegistration, "_transforms", {})
    buffer = ros.tf2_ros.Buffer()
    with pytest.raises(interface.TypeException, match="`import tf2_geometry_msgs` registers"):
        buffer.transform(ros.geometry.PointStamped(), "map")


def test_objects_are_converted_directly_or_through_messages(interface):
    registration = interface.ConvertRegistration()
    registration.add_convert((int, str), lambda value: f"direct {value}")
    registration.add_to_msg(float, lambda value: ("message", value))
    registration.add_from_msg(bytes, lambda message: repr(message).encode())
    original = [1]
    copied = interface.convert(original, list)
    assert interface.convert(5, str) == "direct 5"
    assert interface.convert(0.5, bytes) == b"('message', 0.5)"
    assert copied == original
    assert copied is not original


def test_interface_alone_looks_nothing_up(ros, interface):
    alone = interface.BufferInterface()
    time = ros.Time()
    for call in (
        lambda: alone.lookup_transform("a", "b", time),
        lambda: alone.can_transform("a", "b", time),
        lambda: alone.lookup_transform_full("a", time, "b", time, "c"),
        lambda: alone.can_transform_full("a", time, "b", time, "c"),
    ):
        with pytest.raises(ros.tf2_ros.NotImplementedException, match="not implemented"):
            call()


def test_header_is_put_on_an_object(ros, interface, capsys):
    thing = interface.Stamped(ros.geometry.PoseStamped(), ros.Time(seconds=3).to_msg(), "map")
    assert (thing.header.frame_id, thing.header.stamp.sec) == ("map", 3)
    interface.TransformRegistration().add(int, max)
    interface.TransformRegistration().print_me()
    assert "built-in function max" in capsys.readouterr().out
